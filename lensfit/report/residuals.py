"""Figures of the residuals: arrows, histogram, and coverage of the frame.

A residual is the observed minus the predicted position, in image pixels. Arrows are
enlarged by a stated factor and thinned to one per cell of a fine mesh (the point
nearest to the cell's centre), so that dense charts stay legible and no point is
picked for its error. Coverage draws the points of all takes of one focal length, and
shades the cells that have none.
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from lensfit.report.frame_coverage import (
    COLUMNS,
    ROWS,
    Residuals,
    cell_counts,
    cell_means,
    pattern_px,
    residuals_of,
)
from lensfit.report.markup import Markup, number, tag
from lensfit.report.plain_numbers import round_up
from lensfit.report.svg import Axes, Figure, Frame, drawing, words

_ARROW_CELLS = 30
_LONGEST_ARROW = 26.0


def take_figures(take: dict, size_px: tuple[float, float]) -> list[Figure]:
    """The figures of one take; none when it has no residuals."""
    residuals = residuals_of([take])
    if not len(residuals.points_px):
        return []
    size_px = size_px if all(size_px) else tuple(residuals.points_px.max(axis=0))
    return [arrows(residuals, size_px), histogram(residuals)]


def arrows(residuals: Residuals, size_px: tuple[float, float]) -> Figure:
    """Residual vectors where they belong on the frame, enlarged."""
    frame = Frame((0.0, 0.0), size_px)
    chosen = _one_per_cell(residuals.points_px, size_px, _ARROW_CELLS)
    errors = residuals.errors_px[chosen]
    factor, unit_px = _arrow_scale(errors, frame.scale)
    x, y = frame.place(*residuals.points_px[chosen].T)
    shapes = [frame.border(), *_strokes(x, y, errors * factor * frame.scale)]
    shapes.append(frame.ruler(unit_px * factor * frame.scale, _pixels(unit_px)))
    picture = drawing("Residual arrows", *shapes, height=frame.height)
    thinned = len(chosen) < len(residuals.points_px)
    shown = (
        f"{len(chosen)} points, one per cell" if thinned else f"{len(chosen)} points"
    )
    caption = f"Observed minus predicted, {number(factor, digits=2)} times enlarged; "
    caption += f"{shown}. The dot is where the point is."
    return Figure("residual-arrows", "Residuals", picture, caption)


def histogram(residuals: Residuals) -> Figure:
    """How often each error occurs, across and down, with outliers counted aside."""
    errors = residuals.errors_px
    spread = 1.4826 * np.median(np.abs(errors - np.median(errors, axis=0)), axis=0)
    usual = max(float(spread.max()), 1e-6)
    largest = float(np.abs(errors).max())
    reach = min(largest * 1.05, 5 * usual) or 1.0
    edges = np.linspace(-reach, reach, 42)
    counts = [np.histogram(errors[:, k], edges)[0] for k in (0, 1)]
    axes = Axes((-reach, reach), (0.0, 1.08 * max(int(c.max()) for c in counts) or 1.0))
    shapes = [axes.furniture("observed minus predicted (px)", "points")]
    for tally, name, class_ in zip(
        counts, ("across", "down"), ("s1", "s2"), strict=True
    ):
        x = np.repeat(edges, 2)
        y = np.concatenate([[0], np.repeat(tally, 2), [0]]).astype(float)
        shapes.append(axes.band(x, np.zeros_like(y), y, class_))
        shapes.append(axes.line(x, y, class_))
        place = {"across": 36.0, "down": 57.0}[name]
        shapes.append(words(76, place, f"— {name}", f"tag {class_}", "start"))
    beyond = int(np.sum(np.abs(errors).max(axis=1) > reach))
    rms = np.sqrt(np.mean(errors**2, axis=0))
    caption = f"Rms {number(float(rms[0]), 'px', 2)} across and "
    caption += f"{number(float(rms[1]), 'px', 2)} down; {beyond} beyond the picture "
    caption += f"(largest {number(largest, 'px', 2)})."
    picture = drawing("Residual histogram", *shapes)
    return Figure("residual-histogram", "Spread of the residuals", picture, caption)


def coverage(takes: Sequence[dict], size_px: tuple[float, float]) -> list[Figure]:
    """Where the points of some takes were, and what they have in common in error."""
    residuals = residuals_of(takes)
    if not len(residuals.points_px) or not all(size_px):
        return []
    return [_covered(residuals, size_px, len(takes)), _common(residuals, size_px)]


def _covered(
    residuals: Residuals, size_px: tuple[float, float], take_count: int
) -> Figure:
    frame = Frame((0.0, 0.0), size_px)
    counts = cell_counts(residuals.points_px, size_px)
    width, height = size_px[0] / COLUMNS, size_px[1] / ROWS
    holes = [
        frame.cell(
            i * width, j * height, (i + 1) * width, (j + 1) * height, class_="hole"
        )
        for j, i in np.argwhere(counts == 0)
    ]
    chosen = _one_per_cell(residuals.points_px, size_px, 110)
    x, y = frame.place(*residuals.points_px[chosen].T)
    shapes = [*holes, _dots(x, y), frame.border()]
    picture = drawing("Coverage", *shapes, height=frame.height)
    share = float(np.mean(counts > 0))
    views = "one take" if take_count == 1 else f"{take_count} takes"
    caption = f"Points of {views} reach {share:.0%} of the frame's {counts.size} cells."
    caption += (
        "" if share == 1 else " Shaded: no point at all, the map is extrapolated."
    )
    return Figure("coverage", "Where the points were", picture, caption)


def _common(residuals: Residuals, size_px: tuple[float, float]) -> Figure:
    frame = Frame((0.0, 0.0), size_px)
    columns, rows = 2 * COLUMNS, 2 * ROWS
    counts = cell_counts(residuals.points_px, size_px, columns, rows)
    means = cell_means(residuals, size_px, columns, rows)[0]
    j, i = np.nonzero(counts >= 4)
    factor, unit_px = _arrow_scale(means[j, i], frame.scale)
    x, y = frame.place((i + 0.5) * size_px[0] / columns, (j + 0.5) * size_px[1] / rows)
    shapes = [*_strokes(x, y, means[j, i] * factor * frame.scale), frame.border()]
    shapes.append(frame.ruler(unit_px * factor * frame.scale, _pixels(unit_px)))
    picture = drawing("Common residual", *shapes, height=frame.height)
    pattern = pattern_px(residuals, size_px, columns)
    caption = "Mean residual of each cell: what the model does not explain. With the "
    caption += f"noise taken off it amounts to {number(pattern, 'px', 2)} rms."
    return Figure("common-residual", "What all points have in common", picture, caption)


def _one_per_cell(
    points_px: Float[np.ndarray, "points 2"], size_px: tuple[float, float], across: int
) -> np.ndarray:
    """Indices of the point nearest to the centre of each cell of a square mesh."""
    pitch = size_px[0] / across
    cell = np.floor(points_px / pitch)
    distance = np.sum((points_px / pitch - cell - 0.5) ** 2, axis=1)
    order = np.lexsort((distance, cell[:, 0], cell[:, 1]))
    _, first = np.unique(cell[order], axis=0, return_index=True)
    return order[first]


def _arrow_scale(
    errors_px: Float[np.ndarray, "points 2"], units_per_px: float
) -> tuple[float, float]:
    """Enlargement that suits the longer arrows, and a round length (px) to state."""
    lengths = np.hypot(errors_px[:, 0], errors_px[:, 1])
    long = float(np.percentile(lengths, 95)) if lengths.size else 0.0
    long = max(long, 1e-9)
    factor = round_up(_LONGEST_ARROW / (long * units_per_px) / 2)
    return factor, round_up(long)


def _strokes(x: np.ndarray, y: np.ndarray, arrow: np.ndarray) -> list[Markup]:
    starts = zip(x.tolist(), y.tolist(), arrow.tolist(), strict=True)
    data = "".join(f"M{a:.1f} {b:.1f}l{v[0]:.1f} {v[1]:.1f}" for a, b, v in starts)
    return [tag("path", d=data, class_="arrow"), _dots(x, y, "tail")]


def _dots(x: np.ndarray, y: np.ndarray, class_: str = "points") -> Markup:
    pairs = zip(x.tolist(), y.tolist(), strict=True)
    data = "".join(f"M{a:.1f} {b:.1f}h0" for a, b in pairs)
    return tag("path", d=data, class_=class_)


def _pixels(length_px: float) -> str:
    return f"{length_px:.6g} px" if length_px >= 1e-4 else number(length_px, "px", 1)
