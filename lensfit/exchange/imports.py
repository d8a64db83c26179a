"""Convert another program's lens to a preset.

lensfit's own terms are fitted to the lens of a file in one of the known formats. The
residuals are reported in pixels of the photograph, with what the file does not contain.
Half a pixel is what a compositor begins to see between plate and CG. A fit that is
several pixels off and leaves half of the distortion unexplained has failed: the preset
would be another lens.
"""

import hashlib
from collections.abc import Callable
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from lensfit.errors import ExchangeError
from lensfit.exchange.foreign import ForeignLens, StatedValues
from lensfit.exchange.imported_entry import (
    SampledState,
    StateFit,
    entry_of_state,
)
from lensfit.exchange.lensfun_lens import lens_of_lensfun
from lensfit.exchange.lensfun_xml import read_lensfun
from lensfit.exchange.mrcal import read_mrcal
from lensfit.exchange.opencv import lens_of_opencv, read_opencv
from lensfit.exchange.opentrackio import read_opentrackio
from lensfit.exchange.opentrackio_lens import lens_of_opentrackio
from lensfit.exchange.preset_map import MapAlignedOnAxis, box_of
from lensfit.exchange.samples import ExchangeFrame, Residual
from lensfit.exchange.syntheyes import read_syntheyes
from lensfit.exchange.tde4_node import lens_of_tde4, read_tde4_nodes
from lensfit.exchange.text_file import read_text
from lensfit.exchange.unreal import read_unreal
from lensfit.exchange.usd_camera import read_usd_camera
from lensfit.exchange.uv_map_lens import lens_of_uv_map
from lensfit.io.camera.usd import STARTS
from lensfit.io.exr_header import MAGIC as EXR_MAGIC
from lensfit.preset.blocks import Camera
from lensfit.preset.schema import LensName, Preset, Provenance, SourceImage
from lensfit.progress import Progress, silent

Reader = Callable[[Path, StatedValues, str | None], ForeignLens]
"""Of a file, what is stated beside it, and the name of the camera in a database."""


def _single_lens_reader(read: Callable[[Path, StatedValues], ForeignLens]) -> Reader:
    return lambda path, stated, _: read(path, stated)


@dataclass(frozen=True)
class Format:
    """Another program's file: how it is read, and what tells it from the others.

    Attributes
    ----------
    read : Its reader.
    starts : First bytes, one of them, of a file that is no text.
    opens : What a text opens with, one of them, white space aside; empty if anything.
    words : Of which one stands in the text; empty if none need to.
    """

    read: Reader
    starts: tuple[bytes, ...] = ()
    opens: tuple[str, ...] = ()
    words: tuple[str, ...] = ()

    def holds(self, text: str) -> bool:
        """Whether a text is such a file."""
        opened = text.lstrip().startswith(self.opens or "")
        named = not self.words or any(word in text for word in self.words)
        return not self.starts and opened and named


FOREIGN_FORMATS: dict[str, Format] = {
    "stmap": Format(_single_lens_reader(lens_of_uv_map), starts=(EXR_MAGIC,)),
    "usd": Format(_single_lens_reader(read_usd_camera), starts=STARTS),
    "mrcal": Format(_single_lens_reader(read_mrcal), words=("LENSMODEL_",)),
    "unreal": Format(
        _single_lens_reader(read_unreal),
        opens=("{",),
        words=('"cameraParameterTables"',),
    ),
    "opentrackio": Format(
        lambda path, stated, _: lens_of_opentrackio(
            read_opentrackio(path), stated, path
        ),
        opens=("{", "["),
    ),
    "syntheyes": Format(
        _single_lens_reader(read_syntheyes), opens=("<",), words=("<Lens",)
    ),
    "lensfun": Format(
        lambda path, stated, camera: lens_of_lensfun(
            read_lensfun(path), stated, path, camera
        ),
        opens=("<",),
        words=("<lensdatabase",),
    ),
    "nuke": Format(
        lambda path, stated, _: lens_of_tde4(read_tde4_nodes(path), stated, path),
        words=("LD_3DE",),
    ),
    "opencv": Format(
        lambda path, stated, _: lens_of_opencv(read_opencv(path), stated, path),
        words=("camera_matrix", "opencv-matrix", "opencv_storage", "%YAML"),
    ),
}
"""The first that holds a file is it."""


def read_foreign(
    path: str | Path,
    stated: StatedValues,
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
    if kind not in FOREIGN_FORMATS:
        raise ExchangeError(
            f"{kind!r} is no format", remedy=f"known are {', '.join(FOREIGN_FORMATS)}"
        )
    return FOREIGN_FORMATS[kind].read(path, stated, camera)


def kind_of(path: Path) -> str:
    """Which of `FOREIGN_FORMATS` a file is, by its content.

    Raises
    ------
    ExchangeError : It cannot be read, or is none of them.
    """
    if path.is_file():
        with path.open("rb") as file:
            start = file.read(8)
        for kind, one in FOREIGN_FORMATS.items():
            if one.starts and start.startswith(one.starts):
                return kind
    text = read_text(path, "exchange file")
    for kind, one in FOREIGN_FORMATS.items():
        if one.holds(text):
            return kind
    raise ExchangeError(
        "is of no format that is known here",
        where=path,
        remedy=f"say with --from which it is: {', '.join(FOREIGN_FORMATS)}",
    )


_VISIBLE_PX = 0.5
_FAR_PX = 3.0
_UNEXPLAINED = 0.5
"""Part of the distortion (rms, after the squeeze) that a failed fit leaves."""


def refuse_failed_fit(
    state: str, left: Residual, distortion: Residual, path: Path
) -> None:
    """Nothing, where the fit explains the distortion at all.

    Parameters
    ----------
    left : How far the fitted lens is off.
    distortion : How far a lens without distortion, but with the squeeze, is off.

    Raises
    ------
    ExchangeError : The worst difference is above 3 px, and the rms above half of that
        of no distortion; or either is not a number.
    """
    near = left.worst_px <= _FAR_PX
    explained = left.rms_px <= _UNEXPLAINED * distortion.rms_px
    if near or explained:
        return
    raise ExchangeError(
        f"lensfit's terms cannot follow the distortion at {state}: {left}, where no "
        f"distortion at all would leave rms {distortion.rms_px:.2g} px",
        where=path,
        remedy="check that the file is whole, and the size and units that it states",
    )


def visible_notes(state: str, left: Residual, colour: Residual | None) -> list[str]:
    """A sentence for each that is worse than half a pixel somewhere."""
    known = {"distortion": left, "lateral colour": colour}
    return [
        f"the preset differs visibly from the file: {name} at {state}: {residual}"
        for name, residual in known.items()
        if residual is not None and residual.worst_px > _VISIBLE_PX
    ]


_OVERSCAN_PERCENT = 10.0
_NOTICED = 1e-5
_SENSOR_MM = (0.05, 5000.0)
_FOCAL_MM = (0.01, 1e5)
_SLIMMEST = 50.0
_UNKNOWN = (
    "the file knows no uncertainty and no blur: the preset holds none, and its depth "
    "of field is that of a perfect lens"
)


@dataclass(frozen=True, eq=False)
class Imported:
    """A preset, how near each of its entries is, and what to know."""

    preset: Preset
    fits: tuple[StateFit, ...]
    notes: tuple[str, ...]


def import_preset(
    path: str | Path,
    stated: StatedValues,
    *,
    kind: str | None = None,
    camera: str | None = None,
    progress: Progress = silent,
) -> Imported:
    """The lens of a file as a preset.

    Parameters
    ----------
    kind : One of `FOREIGN_FORMATS`; found from the content if None.
    camera : Part of the name of a camera in a lensfun database.

    Raises
    ------
    LensfitError : The file cannot be read, or its lens is none that a preset holds.
    """
    path = Path(path)
    return preset_of_foreign(
        read_foreign(path, stated, kind=kind, camera=camera), path, progress
    )


def preset_of_foreign(
    lens: ForeignLens, path: Path, progress: Progress = silent
) -> Imported:
    """lensfit's terms fitted to a lens, an entry for each of its states.

    Raises
    ------
    ExchangeError : The lens is none of a camera, folds the frame over, or is far from
        all that lensfit's terms can follow.
    """
    entries, fits, notes = [], [], list(lens.notes)
    camera = Camera(lens.camera_model, *lens.sensor_size_mm, *lens.size_px)
    frame = ExchangeFrame(lens.size_px, lens.sensor_size_mm[0], _OVERSCAN_PERCENT)
    _check(lens, path)
    try:
        seen = [SampledState.of(state, frame) for state in lens.states]
    except ExchangeError as error:
        raise ExchangeError(error.what, where=path, remedy=error.remedy) from error
    boxes = np.stack([box_of(s.fit, s.axis.principal_point_mm) for s in seen])
    # States that differ in the box of their free field cannot be interpolated.
    box = np.stack([boxes[:, 0].min(0), boxes[:, 1].max(0)])
    progress("fit", 0, len(seen))
    for one in seen:
        entry, fit = entry_of_state(one, lens, camera, box)
        refuse_failed_fit(fit.state, fit.distortion, one.without_distortion(), path)
        entries.append(entry)
        fits.append(fit)
        notes += visible_notes(fit.state, fit.distortion, fit.colour)
        notes += _notes(one.axis, one.frame)
        progress("fit", len(entries), len(seen))
    preset = Preset(
        lens=LensName(lens.name, lens.serial),
        camera=camera,
        entries=tuple(entries),
        provenance=_provenance(lens, path),
    )
    return Imported(preset, tuple(fits), tuple(dict.fromkeys([*notes, _UNKNOWN])))


def _check(lens: ForeignLens, path: Path) -> None:
    """Refuse a camera that nobody can have built."""
    width, height = lens.sensor_size_mm
    within = {
        f"a sensor of {width:g} x {height:g} mm": (min(width, height), *_SENSOR_MM),
        f"a sensor {width:g} mm wide": (max(width, height), *_SENSOR_MM),
        f"a picture of {lens.size_px[0]} x {lens.size_px[1]} pixels": (
            max(lens.size_px) / min(lens.size_px),
            0.0,
            _SLIMMEST,
        ),
    }
    for state in lens.states:
        for focal in (state.focal_length_mm, state.principal_distance_mm):
            within[f"a focal length of {focal:g} mm"] = (focal, *_FOCAL_MM)
    for what, (value, least, most) in within.items():
        if not least <= value <= most:
            raise ExchangeError(
                f"states {what}, which is not one of a camera",
                where=path,
                remedy="check its units",
            )


def _provenance(lens: ForeignLens, path: Path) -> Provenance:
    from lensfit import __version__

    digest = hashlib.sha256(path.read_bytes()).hexdigest()
    return Provenance(
        created=datetime.now(UTC).isoformat(timespec="seconds"),
        lensfit_version=__version__,
        versions={},
        images=(SourceImage(path.name, digest, f"imported from {lens.source}"),),
    )


def _notes(axis: MapAlignedOnAxis, frame: ExchangeFrame) -> list[str]:
    notes = []
    if abs(axis.magnification - 1) > _NOTICED:
        notes.append(
            f"the other program's undistorted picture is {axis.magnification:.5f} "
            "times as large as the preset's: render CG with the principal distance of "
            "the preset"
        )
    moved_px = axis.moved_mm / frame.pitch_mm
    if moved_px > 1e-3:
        notes.append(
            f"the other program's undistorted picture is moved by {moved_px:.2f} px "
            "against the preset's, whose axis stays where it is on the photograph"
        )
    if frame.overscan_percent < _OVERSCAN_PERCENT:
        notes.append("the file knows nothing beyond the frame: no overscan was fitted")
    return notes
