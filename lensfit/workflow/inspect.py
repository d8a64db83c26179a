"""Describe pictures from their headers and samples, before anything is fitted to them.

Size, channels, encoding and windows; the camera state with the source of each value and
the values that it overrides; and the clipped share of the picture, since a clipped dot
has no centre. `lensfit.workflow.shoot.draft` turns the same facts into a shoot file.
"""

import math
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING

from lensfit.chart.layout import pattern_description
from lensfit.chart.pattern import Pattern
from lensfit.coords import Window
from lensfit.detect.chart_code import read_chart_code
from lensfit.detect.mosaic_seen import mosaic_seen
from lensfit.errors import ImageError, LensfitError
from lensfit.io.exr_header import check_exr
from lensfit.io.image import read_photograph
from lensfit.io.metadata import CameraState
from lensfit.io.sequence import expand_frames
from lensfit.mosaic import Mosaic
from lensfit.photograph import Photograph
from lensfit.plate.camera.camera_facts import (
    CameraFacts,
    camera_facts,
    camera_record,
    camera_rows,
)
from lensfit.plate.camera.sources import CameraSources
from lensfit.plate.plate_file import (
    PlateView,
    header_entries,
    other_cameras_note,
    plate_header,
    plate_views,
)
from lensfit.progress import Progress, silent

if TYPE_CHECKING:
    from lensfit.preset.schema import Preset


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
    camera : Its camera state and knobs, with the source of each value.
    mosaic : Of the colour filters, where a raw file states it or the noise of an
        interpolated picture shows it.
    chart : What the code of a lensfit chart says; None where none was looked for, or
        read.
    exposed_at : Date and time of the exposure, as the header has them.
    views : Names of a stereo picture's; the camera is that of the first.
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
    camera: CameraFacts
    mosaic: Mosaic | None = None
    chart: Pattern | None = None
    exposed_at: str | None = None
    views: tuple[str, ...] = ()

    @property
    def state(self) -> CameraState:
        """The camera state, with its sources."""
        return self.camera.state


def inspect_images(
    images: Iterable[str | Path],
    progress: Progress = silent,
    sources: CameraSources | None = None,
    *,
    charts: bool = False,
    preset: "Preset | None" = None,
) -> tuple[list[Inspection], list[LensfitError]]:
    """Look at pictures; one that cannot be read does not stop the others.

    Parameters
    ----------
    images : Paths; a frame pattern such as ``plate.####.exr`` means all its frames.
    sources : Where the camera is described beside the headers; settings beside the
        pictures if None.
    charts : Look for the code of a lensfit chart too.
    preset : The lens that the pictures would be rendered with, if that is known.

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
            found.append(_inspect(path, sources, charts, preset))
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
    if inspection.views:
        whose = f"the camera is that of {inspection.views[0]}"
        lines.append(("views", ", ".join(inspection.views), whose))
    if inspection.orientation != 1:
        lines.append(
            ("turned upright", f"orientation {inspection.orientation}", "EXIF")
        )
    if inspection.data_window != inspection.display_window:
        lines.append(("display window", _box(inspection.display_window), ""))
        lines.append(("data window", _box(inspection.data_window), ""))
    clipped = inspection.clipped_fraction
    lines.append(("clipped", "unknown" if clipped is None else f"{clipped:.2%}", ""))
    if inspection.mosaic is not None:
        source = "its file" if inspection.format == "raw" else "its noise"
        lines.append(("mosaic", inspection.mosaic, source))
    if inspection.chart is not None:
        lines.append(
            ("chart", ", ".join(pattern_description(inspection.chart)), "its code")
        )
    return lines + camera_rows(inspection.camera)


def as_json(inspection: Inspection) -> dict[str, object]:
    """The facts in types that JSON knows; an infinite distance is the text "inf"."""
    names = [one.name for one in fields(inspection) if one.name != "camera"]
    record: dict[str, object] = {n: getattr(inspection, n) for n in names}
    record |= {"path": str(inspection.path)}
    if inspection.chart is not None:
        record["chart"] = asdict(inspection.chart)
    return record | camera_record(inspection.camera)


def _box(window: Window | None) -> str:
    return "" if window is None else "({}, {}) to ({}, {})".format(*window)


def _inspect(
    path: Path, sources: CameraSources, charts: bool, preset: "Preset | None"
) -> Inspection:
    photograph = read_photograph(path)
    metadata = photograph.metadata
    header, views = _header(path, metadata)
    camera = camera_facts(path, header, photograph.size_px, sources, preset)
    if len(views) > 1:
        notes = (*camera.notes, other_cameras_note(views, path))
        camera = replace(camera, notes=notes)
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
        camera=camera,
        mosaic=photograph.mosaic or mosaic_seen(photograph),
        chart=read_chart_code(photograph) if charts else None,
        exposed_at=_exposed_at(header),
        views=tuple(one.view.name for one in views if one.view.name),
    )


def _exposed_at(header: Mapping[str, object]) -> str | None:
    """Date and time as the header has it, if it does."""
    for key in ("DateTimeOriginal", "capDate", "DateTime"):
        value = header.get(key)
        if isinstance(value, str) and value.strip():
            return value.strip()
    return None


def _header(
    path: Path, metadata: Mapping[str, object]
) -> tuple[Mapping[str, object], list[PlateView]]:
    """Of all parts of an EXR's first view, as it is rendered by them, and its views."""
    if metadata["format"] == "exr":
        views = plate_views(plate_header(path), path)
        return header_entries(views[0].header), views
    header = metadata["header"]
    assert isinstance(header, Mapping)
    return header, []


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
