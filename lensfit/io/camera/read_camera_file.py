"""Choose the reader of a camera file by its name and its beginning."""

import re
from collections.abc import Callable, Iterable
from pathlib import Path

from lensfit.bounded import read_beginning
from lensfit.errors import CameraError
from lensfit.io.camera.makers import (
    FRAME_HEADING,
    SONY_XML_ROOT,
    read_arri,
    read_blackmagic,
    read_canon,
    read_red_frames,
    read_red_static,
    read_sony,
    read_sony_xml,
)
from lensfit.io.camera.nuke_camera import NODE, read_chan, read_nuke_camera
from lensfit.io.camera.slates import ALE_HEADING, read_ale
from lensfit.io.camera.table import CameraFile, sniff
from lensfit.io.camera.tracking import (
    is_mosys_f4,
    read_mosys_f4,
    read_opentrackio_stream,
)
from lensfit.io.camera.usd import is_usd, read_usd_shot

_BY_COLUMN: tuple[tuple[str, Callable[[Path], CameraFile]], ...] = (
    ("Lens Distance Unit", read_arri),
    ("Lens Linear Iris", read_arri),
    ("FrameNo", read_red_frames),
    ("Camera PIN", read_red_static),
    ("FocusPosition", read_canon),
    ("Focus Distance (ft)", read_sony),
)


def read_camera_file(
    path: str | Path, name: str | None = None, unit_mm: float | None = None
) -> CameraFile:
    """A sidecar or a camera, of whichever kind it is.

    Parameters
    ----------
    name : Of the camera, in a file that may hold several.
    unit_mm : Millimetres of the scene's unit, for distances of a CG camera.

    Raises
    ------
    CameraError : The file cannot be read, is of no known kind, or is malformed.
    """
    path = Path(path)
    suffix = path.suffix.lower()
    if suffix == ".chan":
        return read_chan(path)
    if is_usd(path):
        return read_usd_shot(path, name)
    if suffix == ".f4" or is_mosys_f4(read_beginning(path, 4096, error=CameraError)):
        return read_mosys_f4(path)
    beginning = sniff(path)
    if suffix == ".nk" or NODE.search(beginning):
        return read_nuke_camera(path, name, unit_mm)
    if beginning.lstrip()[:1] in ("{", "["):
        return read_opentrackio_stream(path)
    if beginning.lstrip()[:1] == "<" and f"<{SONY_XML_ROOT}" in beginning:
        return read_sony_xml(path)
    first = next((line for line in beginning.splitlines() if line.strip()), "")
    if first.strip().lower() == ALE_HEADING:
        return read_ale(path)
    for column, reader in _BY_COLUMN:
        if column in (cell.strip(' "') for cell in re.split(r"[\t,]", first)):
            return reader(path)
    blackmagic = re.search(r"^Clip Metadata\s*$", beginning, re.MULTILINE)
    if blackmagic or any(map(FRAME_HEADING.fullmatch, beginning.splitlines())):
        return read_blackmagic(path)
    raise CameraError(
        "is no camera file that lensfit knows",
        where=path,
        remedy="give a table of ARRI, RED, Sony VENICE or Canon (a first line with "
        f"{_or(column for column, _ in _BY_COLUMN)} tells whose), "
        "Blackmagic's text, an ALE, Sony's XML, Mo-Sys F4, OpenTrackIO, .chan, .nk or "
        "USD",
    )


def _or(columns: Iterable[str]) -> str:
    quoted = [f'"{column}"' for column in columns]
    return f"{', '.join(quoted[:-1])} or {quoted[-1]}"
