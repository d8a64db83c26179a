"""What pictures say of themselves, before anything is fitted to them.

Size, channels, encoding and windows; the camera state with the source that each value
came from, and those that it overruled; and how much of the picture is clipped, since a
clipped dot has no centre. `lensfit.workflow.draft_shoot` turns the same facts into a
shoot file.
"""

import math
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path

from lensfit.chart.layout import described
from lensfit.chart.pattern import Pattern
from lensfit.coords import Window
from lensfit.detect.chart_code import read_chart_code
from lensfit.errors import ImageError, LensfitError
from lensfit.io.exr_header import check_exr
from lensfit.io.image import read_photograph
from lensfit.io.metadata import CameraState
from lensfit.io.sequence import expand_frames
from lensfit.photograph import Photograph
from lensfit.progress import Progress, silent
from lensfit.workflow.camera_sources import CameraSources
from lensfit.workflow.known import Known
from lensfit.workflow.plate_camera import BadEntry, PlateCamera
from lensfit.workflow.plate_header import header_entries, plate_header


@dataclass(frozen=True)
class Inspection:
    """The facts about one picture.

    Attributes
    ----------
    size_px : Width and height of the picture as it is used (upright; the display
        window of an EXR).
    channels : Names of everything stored, part by part for an EXR.
    bit_depth : Bits of a colour sample in the file.
    encoding : How it is decoded unless the shoot file says otherwise.
    data_window, display_window : Of an EXR; None otherwise.
    clipped_fraction : Part of the pixels with a channel at its ceiling; None when the
        file's ceiling is not known, as for EXR.
    chroma_subsampled : Colour is stored at lower resolution.
    orientation : EXIF orientation that was undone; 1 for none.
    state : The camera state, with its sources.
    overruled : By quantity, what other sources say of it, the next best first.
    notes : What was assumed of the camera.
    undecided : What only a preset can turn into a camera state: a field of view
        without a sensor height, a focus distance from the pinhole.
    problems : What is wrong with entries of the header that would count.
    passed_over : By quantity, header entries that are wrong and do not count.
    chart : What the code of a lensfit chart says; None where none was looked for, or
        read.
    """

    path: Path
    format: str
    size_px: tuple[int, int]
    channels: tuple[str, ...]
    bit_depth: int
    encoding: str
    data_window: Window | None
    display_window: Window | None
    clipped_fraction: float | None
    chroma_subsampled: bool
    orientation: int
    state: CameraState
    problems: tuple[str, ...] = ()
    passed_over: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    overruled: Mapping[str, tuple[Known, ...]] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    undecided: Mapping[str, Known] = field(default_factory=dict)
    chart: Pattern | None = None


def inspect_images(
    images: Iterable[str | Path],
    progress: Progress = silent,
    sources: CameraSources | None = None,
    *,
    charts: bool = False,
) -> tuple[list[Inspection], list[LensfitError]]:
    """Look at pictures; one that cannot be read does not stop the others.

    Parameters
    ----------
    images : Paths; a frame pattern such as ``plate.####.exr`` means all its frames.
    sources : Where the camera is described beside the headers; settings beside the
        pictures if None.
    charts : Look for the code of a lensfit chart too.

    Returns
    -------
    The facts about each picture that can be read, and an error for each that cannot.
    """
    paths: list[Path] = []
    errors: list[LensfitError] = []
    sources = sources or CameraSources()
    for image in images:
        try:
            paths += [path for _, path in expand_frames(image)]
        except ImageError as error:
            errors.append(error)
    found: list[Inspection] = []
    for done, path in enumerate(paths, 1):
        try:
            found.append(_inspect(path, sources, charts))
        except LensfitError as error:
            errors.append(error)
        progress("inspect", done, len(paths))
    return found, errors


def facts(inspection: Inspection) -> list[tuple[str, str, str]]:
    """The lines of a table about one picture: what, its value, and where from."""
    size = "{} x {} px".format(*inspection.size_px)
    lines = [("size", size, ""), ("channels", ", ".join(inspection.channels), "")]
    subsampled = ", chroma subsampled" * inspection.chroma_subsampled
    depth = f"{inspection.format}, {inspection.bit_depth} bit{subsampled}"
    lines += [("stored as", depth, ""), ("decoded as", inspection.encoding, "")]
    if inspection.orientation != 1:
        lines.append(
            ("turned upright", f"orientation {inspection.orientation}", "EXIF")
        )
    if inspection.data_window != inspection.display_window:
        lines.append(("display window", _box(inspection.display_window), ""))
        lines.append(("data window", _box(inspection.data_window), ""))
    clipped = inspection.clipped_fraction
    lines.append(("clipped", "unknown" if clipped is None else f"{clipped:.2%}", ""))
    for name, value in inspection.state.known().items():
        lines.append((name, _shown(value), inspection.state.sources[name]))
        lines += _overruled(name, inspection)
    for name, known in inspection.undecided.items():
        from_pinhole = " from the pinhole" * known.from_pupil
        lines.append((name, f"{known.value:g}{from_pinhole}", known.source))
        lines += _overruled(name, inspection)
    if inspection.chart is not None:
        lines.append(("chart", ", ".join(described(inspection.chart)), "its code"))
    told = {*inspection.state.known(), *inspection.undecided}
    for name in inspection.overruled:
        if name not in told:
            lines += [(name, "unknown", "see problem"), *_overruled(name, inspection)]
    lines += [("problem", problem, "header") for problem in inspection.problems]
    return lines


def as_json(inspection: Inspection) -> dict[str, object]:
    """The facts in types that JSON knows; an infinite distance is the text "inf"."""
    record: dict[str, object] = asdict(inspection)
    record |= {"path": str(inspection.path)}
    state = inspection.state.known() | {"sources": dict(inspection.state.sources)}
    record["state"] = {k: "inf" if v == math.inf else v for k, v in state.items()}
    record["overruled"] = {
        name: [_as_record(known) for known in others]
        for name, others in inspection.overruled.items()
    }
    undecided = inspection.undecided.items()
    record["undecided"] = {name: _as_record(known) for name, known in undecided}
    return record


def _overruled(name: str, inspection: Inspection) -> list[tuple[str, str, str]]:
    others = inspection.overruled.get(name, ())
    lines = [("", _shown(k.value), f"overruled: {k.source}") for k in others]
    wrong = inspection.passed_over.get(name, ())
    return lines + [("", what, "passed over") for what in wrong]


def _shown(value: float | str) -> str:
    return f"{value:g}" if isinstance(value, float) else str(value)


def _as_record(known: Known) -> dict[str, object]:
    value = "inf" if known.value == math.inf else known.value
    record: dict[str, object] = {"value": value, "source": known.source}
    return record | ({"from": "pinhole"} if known.from_pupil else {})


def _box(window: Window | None) -> str:
    return "" if window is None else "({}, {}) to ({}, {})".format(*window)


def _inspect(path: Path, sources: CameraSources, charts: bool) -> Inspection:
    photograph = read_photograph(path)
    metadata = photograph.metadata
    header = _header(path, metadata)
    camera = sources.described(path, header, photograph.size_px)
    decided = camera.state.known()
    undecided = {n: k for n, k in camera.known.items() if n not in decided}
    return Inspection(
        path=path,
        format=str(metadata["format"]),
        size_px=photograph.size_px,
        channels=_channels(path, photograph),
        bit_depth=int(str(metadata["bit_depth"])),
        encoding=photograph.encoding,
        data_window=_window(metadata, "data_window"),
        display_window=_window(metadata, "display_window"),
        clipped_fraction=_clipped_fraction(photograph),
        chroma_subsampled=photograph.chroma_subsampled,
        orientation=int(str(metadata["orientation"])),
        state=camera.state,
        problems=tuple(str(e.error) for _, e in _bad(camera) if e.counts),
        passed_over=_passed_over(camera),
        chart=read_chart_code(photograph) if charts else None,
        overruled=camera.overruled,
        notes=camera.notes,
        undecided=undecided,
    )


def _bad(camera: PlateCamera) -> list[tuple[str, BadEntry]]:
    return [(name, entry) for name, found in camera.bad.items() for entry in found]


def _passed_over(camera: PlateCamera) -> dict[str, tuple[str, ...]]:
    found: dict[str, tuple[str, ...]] = {}
    for name, entry in _bad(camera):
        if not entry.counts:
            found[name] = (*found.get(name, ()), entry.error.what)
    return found


def _header(path: Path, metadata: Mapping[str, object]) -> Mapping[str, object]:
    """Of all parts of an EXR, as it is rendered by them."""
    if metadata["format"] == "exr":
        return header_entries(plate_header(path))
    header = metadata["header"]
    assert isinstance(header, Mapping)
    return header


def _window(metadata: Mapping[str, object], key: str) -> Window | None:
    window = metadata.get(key)
    return window if isinstance(window, Window) else None


def _channels(path: Path, photograph: Photograph) -> tuple[str, ...]:
    if photograph.metadata["format"] == "exr":
        return tuple(name for part in check_exr(path) for name in part.channels)
    return ("grey",) if photograph.pixels.shape[2] == 1 else ("r", "g", "b")


def _clipped_fraction(photograph: Photograph) -> float | None:
    if math.isinf(photograph.saturation):
        return None
    return float((photograph.pixels >= photograph.saturation).any(-1).mean())
