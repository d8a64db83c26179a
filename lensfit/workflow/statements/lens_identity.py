"""Check whether all views of a focal length are of one lens at one setting.

Where distances are stated, the size of the image implies a focal length; two lenses
make two groups of it with a gap between them. And each view by itself shows how far
points near the edge of the frame are displaced against its middle: a homography and two
radial terms are fitted to it, and compared at `_AT` half diagonals towards the corner.
An anamorphic lens displaces x and y by terms of their own, x (a x^2 + b y^2 + c r^4)
and y (d x^2 + e y^2 + f r^4). Views of one lens agree in that, whatever pose and pitch;
focusing changes it little.
"""

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import cv2
import numpy as np
from scipy.optimize import least_squares

from lensfit.detect.lattice_map import lattice_map
from lensfit.detect.observations import POINT
from lensfit.fitting.chart_view import View
from lensfit.report.evidence import plural, sentence_list
from lensfit.workflow.statements.contradiction import Contradiction

_AT = 0.8
_MOST_POINTS = 240
_FEWEST_POINTS = 40
_LEAST_REACH = 0.75
"""Half diagonals that points must reach."""
_LEAST_GAP_PX, _LEAST_GAP_LOG = 1.0, 0.04
"""Breathing and unknown pupils spread the size of images by less."""
_PUPIL_DIAGONALS = 1.4
_GAP_OVER_SPREAD = 3.0
_MOST_NAMES = 4


def mixed_lenses(takes: Sequence[View]) -> Iterator[Contradiction]:
    """One for each stated focal length that views of two lenses share."""
    for focal_mm in sorted({take.focal_length_mm for take in takes}):
        mine = [take for take in takes if take.focal_length_mm == focal_mm]
        for seen, words in (
            (_groups_by_scale, _scale_words),
            (_groups_by_distortion, _edge_words),
        ):
            parted = seen(mine)
            if parted is not None:
                yield _mixed_lenses(focal_mm, *parted, words)
                break


def _mixed_lenses(
    focal_mm: float,
    fewer: list[View],
    more: list[View],
    difference: float,
    words: Callable[[float], str],
) -> Contradiction:
    others = plural(len(more), "view")
    return lenses_contradiction(
        focal_mm, fewer, f"{words(difference)} the other {others}"
    )


def lenses_contradiction(
    focal_mm: float, takes: Sequence[View], difference: str
) -> Contradiction:
    """That some views of a focal length are of another lens.

    Parameters
    ----------
    takes : Those views.
    difference : What sets them apart, to follow their names.
    """
    names = [Path(take.name).stem for take in takes]
    beyond = len(names) - _MOST_NAMES
    if beyond > 0:
        names = [*names[:_MOST_NAMES], f"{beyond} more"]
    return Contradiction(
        kind="lens_identity",
        limit="unusable",
        text=f"two lenses or zoom settings are mixed at {focal_mm:g} mm, or two sensor "
        f"modes: {sentence_list(names)} {difference}",
        remedy="calibrate them apart, with a shoot file for each lens",
        statement="focal_length_mm",
        stated=focal_mm,
        images=tuple(take.name for take in takes),
    )


def _scale_words(ratio: float) -> str:
    much = f"{100 * abs(ratio - 1):.0f} %"
    return f"image the target {much} {'larger' if ratio > 1 else 'smaller'} than"


def _edge_words(difference_px: float) -> str:
    return f"distort the edge of the frame {difference_px:.1f} px otherwise than"


def _groups_by_distortion(
    takes: list[View],
) -> tuple[list[View], list[View], float] | None:
    found = [(edge_distortion_px(take), take) for take in takes]
    known = sorted(
        ((value, take) for value, take in found if value is not None),
        key=lambda one: one[0],
    )
    parted = _largest_gap([value for value, _ in known], _LEAST_GAP_PX)
    if parted is None:
        return None
    at, gap_px = parted
    groups = [take for _, take in known[:at]], [take for _, take in known[at:]]
    if not _share(groups, "target", "focus_distance_mm", "f_number"):
        return None
    fewer, more = sorted(groups, key=len)
    return fewer, more, gap_px


def _share(groups: Sequence[list[View]], *keys: str) -> bool:
    """Whether a state that is stated alike is in both groups; else it may explain
    their difference, as a chart of another pitch or a lens that breathes does."""
    sides = [{tuple(getattr(t, key) for key in keys) for t in g} for g in groups]
    return bool(sides[0] & sides[1])


def _groups_by_scale(takes: list[View]) -> tuple[list[View], list[View], float] | None:
    """Two groups of at least two views that no target or stated distance explains."""
    found = [(implied_focal_ratio(take), take) for take in takes]
    known = sorted(
        ((float(np.log(value)), take) for value, take in found if value is not None),
        key=lambda one: one[0],
    )
    parted = _largest_gap([value for value, _ in known], _LEAST_GAP_LOG)
    if parted is None:
        return None
    at, _ = parted
    groups = known[:at], known[at:]
    alike = ("target", "target_distance_mm", "focus_distance_mm")
    takes_of = [[take for _, take in group] for group in groups]
    if min(map(len, groups)) < 2 or not _share(takes_of, *alike):
        return None
    fewer, more = sorted(groups, key=len)
    ratio = np.exp(np.mean([v for v, _ in fewer]) - np.mean([v for v, _ in more]))
    return [take for _, take in fewer], [take for _, take in more], float(ratio)


def implied_focal_ratio(take: View) -> float | None:
    """Focal length that size and stated distance of the target imply, over the stated.

    Of a thin lens whose entrance pupil lies as far before the sensor as is usual; None
    where no distance is stated.
    """
    mapped = lattice_map(take.observations)
    if mapped is None or not take.target_distance_mm:
        return None
    middle = np.asarray(take.observations.image_size_px, float) / 2
    cell = mapped.jacobians_px(mapped.lattice_at(middle)[None])[0]
    cell_mm = cell * take.pixel_mm[:, None] / np.asarray(take.pitch_mm)
    magnification = np.sqrt(abs(float(np.linalg.det(cell_mm))) * take.squeeze)
    ahead_mm = _PUPIL_DIAGONALS * float(np.hypot(*take.sensor_size_mm))
    f, focus = take.focal_length_mm, take.focus_distance_mm
    thin_mm = f if focus is None or focus <= 2 * f else f * (1 + f / (focus - f))
    distance_mm = take.target_distance_mm - ahead_mm
    return magnification * distance_mm / thin_mm if distance_mm > f else None


def edge_distortion_px(take: View) -> float | None:
    """How far distortion moves points towards the corner, at `_AT` half diagonals, px;
    None if unseen."""
    seen = take.observations
    half_px = np.asarray(seen.image_size_px) / 2
    diagonal_px = float(np.linalg.norm(half_px))
    good = np.flatnonzero(~seen.overlapping)
    if len(good) < _FEWEST_POINTS:
        return None
    some = good[:: max(1, len(good) // _MOST_POINTS)]
    place = (seen.points_px[some] - half_px) / diagonal_px
    radius = np.linalg.norm(place, axis=1)
    if np.quantile(radius, 0.95) < _LEAST_REACH:
        return None
    board = seen.lattice[some] * np.asarray(take.pitch_mm) / np.mean(take.pitch_mm)
    board = board - board.mean(0)
    board = board / max(np.ptp(board, axis=0).max(), 1e-9)
    normal = np.nan_to_num(seen.normal[some])
    points = (seen.family[some] == POINT)[:, None]
    displaced = _displaced_by_axis if take.anamorphic else _displaced_place

    def residual(p: np.ndarray) -> np.ndarray:
        matrix = np.append(p[:8], 1.0).reshape(3, 3)
        flat = np.column_stack([board, np.ones(len(board))]) @ matrix.T
        straight = flat[:, :2] / flat[:, 2:]
        miss = straight + displaced(straight, p[8:]) - place
        across = (miss * normal).sum(1, keepdims=True) * normal
        return np.where(points, miss, across).ravel()

    central = np.argsort(radius)[: max(20, len(radius) // 3)]
    start, _ = cv2.findHomography(board[central], place[central], 0)
    if start is None:
        return None
    terms = 6 if take.anamorphic else 2
    begin = np.concatenate([(start / start[2, 2]).ravel()[:8], np.zeros(terms)])
    fitted = least_squares(residual, begin, loss="soft_l1", f_scale=1 / diagonal_px).x
    corner = half_px / diagonal_px
    moved = displaced(_AT * corner[None], fitted[8:])[0]
    return float(moved @ corner * diagonal_px)


def _displaced_place(place: np.ndarray, terms: np.ndarray) -> np.ndarray:
    """By two radial terms."""
    r2 = (place**2).sum(1, keepdims=True)
    return place * r2 * (terms[0] + r2 * terms[1])


def _displaced_by_axis(place: np.ndarray, terms: np.ndarray) -> np.ndarray:
    """By three terms of each axis."""
    squares = place**2
    powers = np.column_stack([squares, squares.sum(1) ** 2])
    return place * (powers @ terms.reshape(2, 3).T)


def _largest_gap(values: Sequence[float], least_gap: float) -> tuple[int, float] | None:
    """Where sorted values fall into two groups, and the gap; None where into one."""
    if len(values) < 3:
        return None
    ordered = np.array(values)
    gaps = np.diff(ordered)
    at = int(gaps.argmax()) + 1
    spread = max(np.ptp(ordered[:at]), np.ptp(ordered[at:]))
    gap = float(gaps[at - 1])
    if gap < max(least_gap, _GAP_OVER_SPREAD * spread):
        return None
    return at, gap
