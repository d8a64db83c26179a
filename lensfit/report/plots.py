"""Figures of one entry (focal length, focus distance): the lens itself, residuals.

Figures of the lens show the distortion as a bent grid (exaggerated when small, with the
factor stated) and as percent of the radius with its 1-sigma band, lateral colour of red
and blue against green, fall-off at each f-number, and the standard deviation of the map
over the frame. Colours are those of Okabe and Ito ("Color Universal Design", 2008),
which are distinct to colour-blind eyes.

Breathing is shown as the image magnification over the focus distance.

A residual is the observed minus the predicted position, in image pixels. Arrows are
enlarged by a stated factor and thinned to one per cell of a fine mesh (the point
nearest to the cell's centre), so that dense charts stay legible and no point is
picked for its error. Coverage draws the points of all takes of one focal length, and
shades the cells that have none.
"""

from collections.abc import Callable, Sequence

import numpy as np
from jaxtyping import Float

from lensfit.report.evidence import (
    COLUMNS,
    ROWS,
    Residuals,
    cell_counts,
    cell_means,
    numbers,
    pattern_px,
    residuals_of,
)
from lensfit.report.heatmap import fall_off_surface, uncertainty
from lensfit.report.markup import Markup, number, stated_value, tag
from lensfit.report.plain_numbers import round_up
from lensfit.report.svg import Axes, Figure, Frame, drawing, path, sensor_frame, words

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
    return [
        _coverage_figure(residuals, size_px, len(takes)),
        _common(residuals, size_px),
    ]


def _coverage_figure(
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


def entry_figures(entry: dict, camera: dict) -> list[Figure]:
    """The figures of one entry; those without data are left out."""
    makers: tuple[Callable[[dict, dict], Figure | None], ...] = (
        distortion_grid, radial_profile, lateral_colour, fall_off, fall_off_surface,
        uncertainty,
    )  # fmt: skip
    return [figure for make in makers if (figure := make(entry, camera)) is not None]


def distortion_grid(entry: dict, camera: dict) -> Figure | None:
    """The image of a straight grid through the lens."""
    grid = entry.get("distortion_grid") or {}
    x, y, dx, dy = (numbers(grid.get(k)) for k in ("x_mm", "y_mm", "dx_mm", "dy_mm"))
    if dx.ndim != 2 or dx.shape != (y.size, x.size) or dy.shape != dx.shape:
        return None
    frame = sensor_frame(camera, x, y)
    largest = float(np.nanmax(np.hypot(dx, dy), initial=0.0))
    factor = _exaggeration(largest, frame.high[0] - frame.low[0])
    flat_x, flat_y = np.meshgrid(x, y)
    shapes = [_net(frame, flat_x, flat_y, "faint")]
    shapes.append(_net(frame, flat_x + factor * dx, flat_y + factor * dy, "strong"))
    centre = entry.get("distortion_centre_mm")
    if centre:
        shapes.append(_cross(frame, *centre))
    times = "true to scale" if factor == 1 else f"drawn {factor:g} times too strong"
    moved = number(largest, "mm", 2) + _pixels_text(largest, camera)
    caption = f"A straight grid (pale) as the lens images it, {times}. The farthest "
    caption += f"point moves by {moved}. The cross is the centre of distortion."
    picture = drawing("Distortion grid", *shapes, frame.border(), height=frame.height)
    return Figure("distortion-grid", "Distortion", picture, caption)


def radial_profile(entry: dict, camera: dict) -> Figure | None:
    """Distortion in percent of the radius, with its error band."""
    profile = entry.get("radial_profile") or {}
    radius = numbers(profile.get("radius_mm"))
    percent = numbers(profile.get("distortion_percent"))
    if radius.size < 2 or percent.shape != radius.shape:
        return None
    sd = _same_size(profile.get("standard_deviation_percent"), radius)
    axes = Axes(span(radius, zero=True), span(percent, sd, zero=True))
    shapes = [axes.furniture("radius on the sensor (mm)", "distortion (%)")]
    shapes += _corner_mark(axes, camera)
    shapes.append(axes.band(radius, percent - sd, percent + sd, "s1"))
    shapes.append(axes.line(radius, percent, "s1"))
    at_end = f"{number(percent[-1], '%')} at {number(radius[-1], 'mm')}"
    known = f", known to {number(float(sd[-1]), '%', 2)} (1σ)" if sd[-1] > 0 else ""
    kind = "barrel" if percent[-1] < 0 else "pincushion"
    caption = f"{at_end} ({kind}){known}. The band is one standard deviation."
    picture = drawing("Radial distortion", *shapes)
    return Figure("radial-profile", "Distortion along the radius", picture, caption)


def lateral_colour(entry: dict, camera: dict) -> Figure | None:
    """Radial shift of red and blue against green."""
    colour = entry.get("lateral_colour") or {}
    radius = numbers(colour.get("radius_mm"))
    curves = {c: numbers(colour.get(f"{c}_px")) for c in ("r", "b")}
    curves = {c: shift for c, shift in curves.items() if shift.shape == radius.shape}
    if radius.size < 2 or not curves:
        return None
    deviations = {c: _same_size(colour.get(f"{c}_sd_px"), radius) for c in curves}
    values = np.concatenate(list(curves.values()))
    spread = np.concatenate(list(deviations.values()))
    axes = Axes(_radii(radius), span(values, spread, zero=True))
    shapes = [axes.furniture("radius on the sensor (mm)", "shift against green (px)")]
    shapes += _corner_mark(axes, camera)
    names = {"r": "red", "b": "blue"}
    for channel, shift in curves.items():
        sd = deviations[channel]
        shapes.append(axes.band(radius, shift - sd, shift + sd, names[channel]))
        shapes.append(axes.line(radius, shift, names[channel]))
    ends = [(radius[-1], v[-1], names[c], names[c]) for c, v in curves.items()]
    shapes += axes.labels(ends)
    said = [f"{names[c]} {number(shift[-1], 'px', 2)}" for c, shift in curves.items()]
    caption = f"At the outermost radius: {', '.join(said)}; outward is positive."
    picture = drawing("Lateral colour", *shapes)
    return Figure("lateral-colour", "Lateral colour", picture, caption)


def fall_off(entry: dict, camera: dict) -> Figure | None:
    """Relative illumination against radius, a family of curves over f-number."""
    stops = [one for one in entry.get("fall_off") or [] if _is_whole(one)]
    stops.sort(key=lambda one: one.get("f_number") or 0.0)
    if not stops:
        return None
    radii = np.concatenate([numbers(one["radius_mm"]) for one in stops])
    top = max(1.0, *(float(np.nanmax(_green(one))) for one in stops))
    axes = Axes(_radii(radii), (0.0, 1.02 * top))
    shapes = [axes.furniture("radius on the sensor (mm)", "relative illumination")]
    shapes += _corner_mark(axes, camera)
    losses, ends = [], []
    for index, one in enumerate(stops):
        shapes += _fall_off_curves(axes, one, f"s{index % 5 + 1}")
        loss = -np.log2(max(float(_green(one)[-1]), 1e-6))
        losses.append(f"{_stop_name(one)} {round(loss, 2) + 0.0:.2f} stops")
        class_ = f"s{index % 5 + 1}"
        ends.append((one["radius_mm"][-1], _green(one)[-1], _stop_name(one), class_))
    shapes += axes.labels(ends)
    caption = f"Lost at the outermost radius: {', '.join(losses)}. Solid green, dotted "
    caption += "red and blue channel."
    if any(one.get("lighting_too") for one in stops):
        caption += " Of lens and lighting together: the chart was lit from its front."
    return Figure("fall-off", "Fall-off", drawing("Fall-off", *shapes), caption)


def _exaggeration(largest_mm: float, width_mm: float) -> float:
    """1 when the distortion is plain to see, else a round factor that makes it so."""
    wanted = 0.02 * width_mm / largest_mm if largest_mm > 0 else 1.0
    return 1.0 if wanted <= 1.0 else min(round_up(wanted), 1000.0)


def _net(frame: Frame, x: np.ndarray, y: np.ndarray, class_: str) -> Markup:
    """Lines along the rows and columns of a grid, as one path."""
    gap_row, gap_column = (
        np.full((x.shape[0], 1), np.nan),
        np.full((x.shape[1], 1), np.nan),
    )
    flat = [
        np.concatenate(
            [np.hstack([c, gap_row]).ravel(), np.hstack([c.T, gap_column]).ravel()]
        )
        for c in (x, y)
    ]
    return path(*frame.place(flat[0], flat[1]), class_=f"net {class_}")


def _cross(frame: Frame, x_mm: float, y_mm: float) -> Markup:
    x, y = frame.place(np.array([x_mm]), np.array([y_mm]))
    arm = np.array([-7.0, 7.0, np.nan, 0.0, 0.0])
    return path(x[0] + arm, y[0] + np.array([0.0, 0.0, np.nan, -7.0, 7.0]), "cross")


def _pixels_text(length_mm: float, camera: dict) -> str:
    width_mm, width_px = camera.get("sensor_width_mm"), camera.get("image_width_px")
    if not width_mm or not width_px:
        return ""
    return f" ({number(length_mm / width_mm * width_px, 'px', 3)})"


def _same_size(values: list | None, like: np.ndarray) -> np.ndarray:
    array = numbers(values)
    return np.nan_to_num(array) if array.shape == like.shape else np.zeros_like(like)


def span(
    values: np.ndarray, spread: np.ndarray | float = 0.0, zero: bool = False
) -> tuple[float, float]:
    """A range that holds all values with their spread, and zero when asked."""
    low = float(np.nanmin(values - spread, initial=np.inf))
    high = float(np.nanmax(values + spread, initial=-np.inf))
    if zero:
        low, high = min(low, 0.0), max(high, 0.0)
    if not high > low:
        return low - 0.5, low + 0.5
    room = 0.06 * (high - low)
    return (low if low == 0 else low - room), (high if high == 0 else high + room)


def _radii(radius_mm: np.ndarray) -> tuple[float, float]:
    """From the centre to the last radius, with room for the names of the curves."""
    return 0.0, 1.12 * float(np.nanmax(radius_mm))


def _corner_mark(axes: Axes, camera: dict) -> list[Markup]:
    width, height = camera.get("sensor_width_mm"), camera.get("sensor_height_mm")
    corner = np.hypot(width or 0.0, height or 0.0) / 2
    inside = axes.x_range[0] < corner < axes.x_range[1]
    return [axes.mark(float(corner), "frame corner")] if inside else []


def _is_whole(one: dict) -> bool:
    radius = numbers(one.get("radius_mm"))
    return radius.size >= 2 and _green(one).shape == radius.shape


def _green(one: dict) -> np.ndarray:
    return numbers(one.get("g") or one.get("r") or one.get("b") or [1.0])


def _fall_off_curves(axes: Axes, one: dict, class_: str) -> list[Markup]:
    radius, green = numbers(one["radius_mm"]), _green(one)
    sd = _same_size(one.get("sd"), radius)
    shapes = [axes.band(radius, green - sd, green + sd, class_)]
    for channel in ("r", "b"):
        values = numbers(one.get(channel))
        if values.shape == radius.shape:
            shapes.append(axes.line(radius, values, f"{class_} dotted"))
    return [*shapes, axes.line(radius, green, class_)]


def _stop_name(one: dict) -> str:
    stop = one.get("f_number")
    return f"f/{stated_value(round(stop, 1))}" if stop else "f-number not stated"


def breathing(curve: dict) -> Figure | None:
    """The curve with its band, and the focus distances that were photographed.

    Parameters
    ----------
    curve : "focus_dioptres" (1/m from the sensor), "larger_percent" against the
        farthest of them, "sd_percent" where it is known; "photographed_dioptres".
    """
    focus, larger = numbers(curve["focus_dioptres"]), numbers(curve["larger_percent"])
    if focus.size < 2:
        return None
    sd = numbers(curve["sd_percent"])
    known = np.nan_to_num(sd)
    axes = Axes(span(focus), span(larger, known, zero=True))
    shapes: list[Markup] = [axes.furniture("focus (1/m)", "image larger by (%)")]
    shapes += [axes.mark(at, "") for at in curve["photographed_dioptres"]]
    shapes.append(axes.band(focus, larger - sd, larger + sd, "s1"))
    shapes.append(axes.line(focus, larger, "s1"))
    caption = f"{number(larger[-1], '%', 2)} larger focused nearest than farthest. "
    caption += (
        "Dashed: focus distances that were photographed. The band is one standard "
    )
    caption += "deviation there, nearest and farthest counted as independent."
    return Figure("breathing", "Breathing", drawing("Breathing", *shapes), caption)
