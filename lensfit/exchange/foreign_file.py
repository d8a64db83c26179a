"""A file of another program: which of the known formats it has, and the lens in it."""

from pathlib import Path

from lensfit.errors import ExchangeError
from lensfit.exchange.foreign import ForeignLens, Stated
from lensfit.exchange.lensfun_lens import lens_of_lensfun
from lensfit.exchange.lensfun_xml import read_lensfun
from lensfit.exchange.mrcal import read_mrcal
from lensfit.exchange.opencv import lens_of_opencv, read_opencv
from lensfit.exchange.opentrackio import read_opentrackio
from lensfit.exchange.opentrackio_lens import lens_of_opentrackio
from lensfit.exchange.syntheyes import read_syntheyes
from lensfit.exchange.tde4_node import lens_of_tde4, read_tde4_nodes
from lensfit.exchange.text_file import read_text
from lensfit.exchange.unreal import read_unreal
from lensfit.exchange.usd_camera import read_usd_camera
from lensfit.exchange.uv_map_lens import lens_of_uv_map
from lensfit.io.usd_stage import STARTS

FOREIGN_FORMATS = (
    "opencv",
    "lensfun",
    "opentrackio",
    "nuke",
    "stmap",
    "usd",
    "mrcal",
    "unreal",
    "syntheyes",
)
_EXR_MAGIC = b"\x76\x2f\x31\x01"


def read_foreign(
    path: str | Path,
    stated: Stated,
    *,
    kind: str | None = None,
    camera: str | None = None,
) -> ForeignLens:
    """The lens of a file as the other program describes it.

    Raises
    ------
    ExchangeError : It is of no known format, or malformed.
    ImageError : It is a picture, and no UV map.
    """
    path = Path(path)
    kind = kind or kind_of(path)
    readers = {
        "stmap": lens_of_uv_map,
        "usd": read_usd_camera,
        "mrcal": read_mrcal,
        "unreal": read_unreal,
        "syntheyes": read_syntheyes,
    }
    if kind in readers:
        return readers[kind](path, stated)
    if kind == "nuke":
        return lens_of_tde4(read_tde4_nodes(path), stated, path)
    if kind == "opentrackio":
        return lens_of_opentrackio(read_opentrackio(path), stated, path)
    if kind == "lensfun":
        return lens_of_lensfun(read_lensfun(path), stated, path, camera)
    return lens_of_opencv(read_opencv(path), stated, path)


def kind_of(path: Path) -> str:
    """Which of `FOREIGN_FORMATS` a file is, by its content.

    Raises
    ------
    ExchangeError : It cannot be read, or is none of them.
    """
    if path.is_file():
        with path.open("rb") as file:
            start = file.read(8)
        if start[:4] == _EXR_MAGIC:
            return "stmap"
        if start.startswith(STARTS):
            return "usd"
    text = read_text(path, "exchange file")
    start = text.lstrip()[:1]
    if "LENSMODEL_" in text:
        return "mrcal"
    if start == "{" and '"cameraParameterTables"' in text:
        return "unreal"
    if start == "<" and "<Lens" in text:
        return "syntheyes"
    if start in ("{", "["):
        return "opentrackio"
    if start == "<":
        return "lensfun" if "<lensdatabase" in text else "opencv"
    if "LD_3DE" in text:
        return "nuke"
    if "camera_matrix" in text or "opencv-matrix" in text or text.startswith("%YAML"):
        return "opencv"
    raise ExchangeError(
        "is of no format that is known here",
        where=path,
        remedy=f"say with --from which it is: {', '.join(FOREIGN_FORMATS)}",
    )
