"""Detection in one photograph: selects the detector by the kind of target.

A region of interest is cropped before detection, so that nothing outside it has an
effect; positions are returned in pixels of the whole photograph. Problems such as
clipping, touching marks or poor coverage of the frame are listed in
`Observations.notes`; a photograph that cannot be used raises a `DetectionError`.
"""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from lensfit.detect.corners import find_charuco, find_checkerboard
from lensfit.detect.dots import find_dots, primitive_cells
from lensfit.detect.lines import find_lines
from lensfit.detect.observations import Observations, only
from lensfit.detect.second_chart import larger_chart
from lensfit.errors import DetectionError
from lensfit.photograph import Photograph

KINDS = ("dot-grid", "line-grid", "checkerboard", "circle-grid", "charuco")
SMALLEST_REGION_PX = 32
MOSTLY = 0.5
"""Part of the picture, or of the marks, from which clipping is to blame or to note."""
LITTLE_OF_THE_FRAME = 0.25
_LATTICES_OF_POINTS = ("dot-grid", "checkerboard", "circle-grid")


def observe(
    photograph: Photograph,
    kind: str,
    *,
    polarity: str | None = None,
    roi: tuple[float, float, float, float] | None = None,
    board: Mapping[str, Any] | None = None,
) -> Observations:
    """Find a target of a known kind on a photograph.

    Parameters
    ----------
    photograph : The picture, scene-linear.
    kind : "dot-grid", "line-grid", "checkerboard", "circle-grid" or "charuco".
    polarity : "bright" or "dark" marks; None lets the picture say.
    roi : x0, y0, x1, y1 in pixels: only marks inside are used.
    board : What else is known of the target, by the shoot file's keys: `asymmetric`
        for circle grids; `squares`, `dictionary`, `marker_ratio` for ChArUco.

    Raises
    ------
    DetectionError : an unknown kind, a region without area, a blank or over-exposed
        picture, or no such target on it; the sentence says which and what to do.
    """
    if kind not in KINDS:
        raise DetectionError(
            f"'{kind}' is no kind of target",
            where=photograph.path,
            remedy=f"use one of {', '.join(KINDS)}",
        )
    board = board or {}
    part, corner = _cut_out(photograph, roi)
    _refuse_blank(part, kind)
    try:
        found = _find(part, kind, polarity, board)
    except DetectionError as error:
        raise _blame_exposure(part, error) from error
    found = _moved_to_whole_photograph(found, photograph, corner, roi)
    if not len(found):
        raise DetectionError(
            f"no marks of the {kind} lie inside the region {list(roi or ())}",
            where=photograph.path,
            remedy="make the region larger",
        )
    found, of_another = _without_second_chart(
        found, kind, bool(board.get("asymmetric"))
    )
    notes = found.notes + of_another + _notes(photograph, kind, found, board)
    return replace(found, notes=notes)


def _without_second_chart(
    found: Observations, kind: str, asymmetric: bool
) -> tuple[Observations, tuple[str, ...]]:
    """The larger of two charts whose lattices join, and what was left out; points of
    lines are numbered along them, and squares of a ChArUco board by their markers."""
    if kind not in _LATTICES_OF_POINTS:
        return found, ()
    cells = primitive_cells(np.rint(found.lattice).astype(int), asymmetric)
    larger = larger_chart(cells, found.points_px)
    if larger is None:
        return found, ()
    lost = found.points_px[~larger]
    (x0, y0), (x1, y1) = np.floor(lost.min(0)), np.ceil(lost.max(0))
    note = (
        f"Two charts are in the picture and join to one grid; {len(lost)} of "
        f"{len(larger)} points, between x {x0:.0f} to {x1:.0f} and y {y0:.0f} to "
        f"{y1:.0f} px, are of the smaller one and left out; take it away, or state roi."
    )
    kept = only(found, larger)
    least = kept.lattice.min(0)
    if asymmetric:
        least -= [0, least.sum() % 2]  # keep i + j even
    return replace(kept, lattice=kept.lattice - least), (note,)


def _find(
    photograph: Photograph,
    kind: str,
    polarity: str | None,
    board: Mapping[str, Any],
) -> Observations:
    if kind == "line-grid":
        return find_lines(photograph, polarity=polarity)
    if kind == "checkerboard":
        return find_checkerboard(photograph)
    if kind == "charuco":
        return find_charuco(photograph, board)
    asymmetric = bool(board.get("asymmetric"))
    return find_dots(photograph, polarity=polarity, asymmetric=asymmetric)


def _cut_out(
    photograph: Photograph, roi: tuple[float, float, float, float] | None
) -> tuple[Photograph, tuple[int, int]]:
    """The part of the photograph inside the region, and its top left corner."""
    if roi is None:
        return photograph, (0, 0)
    width, height = photograph.size_px
    x0, y0 = (max(0, int(np.floor(value))) for value in roi[:2])
    x1, y1 = min(width, int(np.ceil(roi[2]))), min(height, int(np.ceil(roi[3])))
    if x1 - x0 < SMALLEST_REGION_PX or y1 - y0 < SMALLEST_REGION_PX:
        raise DetectionError(
            f"the region of interest {list(roi)} covers too little of the photograph "
            f"of {width} x {height} pixels",
            where=photograph.path,
            remedy="give roi as [x0, y0, x1, y1] in pixels, x0 < x1 and y0 < y1",
        )
    return photograph.cropped(x0, y0, x1, y1), (x0, y0)


def _refuse_blank(photograph: Photograph, kind: str) -> None:
    image = photograph.luminance_channel
    if not np.isfinite(image).all():
        raise DetectionError(
            f"{np.count_nonzero(~np.isfinite(image))} samples are no finite numbers",
            where=photograph.path,
            remedy="write the photograph again without NaN or infinity",
        )
    low, high = np.percentile(image, [0.01, 99.99])
    if high - low <= max(1e-3 * abs(high), photograph.quantisation_step / 2, 1e-9):
        clipped = bool(low >= photograph.saturation)
        raise DetectionError(
            f"no {kind} found: the picture is "
            + ("over-exposed throughout" if clipped else "blank"),
            where=photograph.path,
            remedy="expose less" if clipped else "check that it is the right file",
        )


def _blame_exposure(photograph: Photograph, error: DetectionError) -> DetectionError:
    """The same refusal; over-exposure named where most of the picture is clipped."""
    clipped = np.mean(photograph.luminance_channel >= photograph.saturation)
    if clipped < MOSTLY or "over-exposed" in error.what:
        return error
    return DetectionError(
        f"{error.what}, and {clipped:.0%} of the picture is over-exposed",
        where=error.where,
        remedy="expose less, so that neither marks nor background clip",
    )


def _moved_to_whole_photograph(
    found: Observations,
    photograph: Photograph,
    corner: tuple[int, int],
    roi: tuple[float, float, float, float] | None,
) -> Observations:
    """Positions in pixels of the whole photograph, without marks outside the region."""
    points = found.points_px + corner
    inside = np.ones(len(points), bool)
    if roi is not None:
        inside &= ((points >= roi[:2]) & (points <= roi[2:])).all(1)
    found = only(found, inside)
    return replace(
        found,
        points_px=found.points_px + corner,
        channel_points_px=found.channel_points_px + corner,
        image_size_px=photograph.size_px,
    )


def _notes(
    photograph: Photograph,
    kind: str,
    found: Observations,
    board: Mapping[str, Any] | None,
) -> tuple[str, ...]:
    """What the person who photographed it should know, a sentence each."""
    notes = []
    count = len(found)
    clipped, touching = int(found.saturated.sum()), int(found.overlapping.sum())
    if clipped:
        notes.append(
            f"{clipped} of {count} marks touch clipped samples; expose less to use "
            "their brightness."
        )
    if touching > MOSTLY * count:
        notes.append(
            f"{touching} of {count} marks blur into their neighbours; use a wider "
            "pitch or less defocus."
        )
    span = np.ptp(found.points_px, axis=0) / found.image_size_px
    if span.prod() < LITTLE_OF_THE_FRAME:
        notes.append(
            f"The {kind} spans {span[0]:.0%} of the width and {span[1]:.0%} of the "
            "height; distortion outside it is extrapolated."
        )
    if photograph.chroma_subsampled:
        notes.append(
            "Red and blue are stored at lower resolution: lateral colour, and blur of "
            "what is in focus, are uncertain; hand in the photograph as it was before "
            "JPEG."
        )
    squares = (board or {}).get("squares")
    if squares is not None and kind == "checkerboard":
        seen = np.sort(np.ptp(found.lattice, axis=0)) + 2
        if (seen > np.sort(squares)).any():
            notes.append(
                f"{seen[1]:.0f} x {seen[0]:.0f} squares are seen, but the target has "
                f"{max(squares)} x {min(squares)}."
            )
    return tuple(notes)
