"""The chart as the fitted lens would photograph it: its drawing and its brightness.

Only marks that were detected are drawn, each where the model predicts it. A drawing
holds how much of every small pixel the marks cover (discs, lines, squares; smoothly at
their edges), or how much light falls there (dots whose blur was measured). Small pixels
are those of `small_photograph`.

The brightness of a photograph is predicted from a drawing of its marks:

    light = base + (field + contrast * marks) * fall-off

The lens determines where marks lie, how they are blurred (if it was measured) and how
light falls off. Base, field and contrast depend on the chart's brightness: they are
found by least squares over the pixels among the marks, twice, the second time without
pixels whose residual in the first exceeds half a mark (dirt, print, fingers). Where
marks are dark the field between them shows uneven lighting of the chart, which the lens
does not explain: field and contrast are then quadratic over the frame. Where blur was
not measured the drawing is blurred by one Gaussian for all marks, the best-fitting one.
"""

from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Bool, Float, Float32

from lensfit.detect.observations import POINT, Observations
from lensfit.workflow.calibration.small_photograph import SmallPhotograph
from lensfit.workflow.pictures.chart_shapes import discs, lines, squares
from lensfit.workflow.pictures.predicted_points import PredictedPoints, drawn_light

_LARGE_PX = 3000
_PROFILE_PX, _PROFILE_STEPS, _PROFILES = 12.0, 49, 400
_LEAST_RADIUS_PX = 0.35
_MOST_RADIUS_PX = 200.0


class Drawing(NamedTuple):
    """What the model expects, but for how bright it is.

    Attributes
    ----------
    marks : How much of each small pixel is mark, or how much light is there.
    inside : Small pixels among the marks.
    blurred : Whether the lens' own blur is in it.
    field_is_bright : Whether marks are darker than what is around them, or squares.
    """

    marks: Float32[np.ndarray, "height width"]
    inside: Bool[np.ndarray, "height width"]
    blurred: bool
    field_is_bright: bool = False


def drawing_of(
    seen: Observations,
    predicted: PredictedPoints,
    photograph: SmallPhotograph,
    kind: str,
    hole_diameter_mm: float | None,
) -> Drawing:
    """The marks of one photograph.

    Parameters
    ----------
    seen : The marks as found.
    predicted : Where the model puts them.
    photograph : On whose pixels to draw; lines take their width from it.
    kind : Of the target, as the shoot file says.
    hole_diameter_mm : Of a dot; None for the diameter seen.
    """
    scale, shape = np.asarray(photograph.scale), photograph.light.shape
    points = predicted.points_px * scale
    stretch = predicted.stretch_px * scale[:, None]
    gap_px = _gap_px(stretch, predicted.pitch_mm)
    of_lines = bool((seen.family != POINT).any())
    of_squares = kind in ("checkerboard", "charuco")
    # Lines and squares go on beyond the last mark, where nothing is drawn.
    inside = _among(points, 0.0 if of_lines or of_squares else gap_px, shape)
    if predicted.light is not None:
        light = drawn_light(
            predicted.light,
            seen.image_size_px,
            -(-max(seen.image_size_px) // _LARGE_PX),
        )
        return Drawing(_averaged_pixels(light, shape), inside, True)
    if of_lines:
        normals = seen.normal * scale
        width = _line_width_px(photograph.light, points, normals, gap_px)
        marks = lines(points, seen, width, shape)
    elif of_squares:
        marks = squares(points, seen.lattice, shape)
    else:
        marks = discs(points, _radii(stretch, seen, scale, hole_diameter_mm), shape)
    return Drawing(marks, inside, False, of_squares or not seen.bright)


def _radii(
    stretch: np.ndarray,
    seen: Observations,
    scale: np.ndarray,
    hole_diameter_mm: float | None,
) -> np.ndarray:
    """Half axes of every dot's ellipse: of the hole, or as large as dots look."""
    if hole_diameter_mm is not None:
        return stretch * hole_diameter_mm / 2
    looks = float(np.nanmedian(seen.diameter_px)) / 2 * np.sqrt(scale[0] * scale[1])
    usual = np.sqrt(np.median(np.abs(np.linalg.det(stretch))))
    radius = np.clip(np.nan_to_num(looks), _LEAST_RADIUS_PX, _MOST_RADIUS_PX)
    return stretch * (radius / usual)


def _gap_px(stretch: np.ndarray, pitch_mm: tuple[float, float]) -> float:
    """From mark to mark, the shorter way of the target, as a rule."""
    return min(pitch_mm) * float(np.sqrt(np.median(np.abs(np.linalg.det(stretch)))))


def _among(points: np.ndarray, gap_px: float, shape: tuple[int, int]) -> np.ndarray:
    """The convex hull of the marks, and half a gap around it."""
    hull = cv2.convexHull(points.astype(np.float32))
    mask = np.zeros(shape, np.uint8)
    cv2.fillPoly(mask, [np.rint(hull).astype(np.int32)], (1,))
    side = 2 * max(round(gap_px / 2), 1) + 1
    return cv2.dilate(mask, np.ones((side, side), np.uint8)) > 0


def _line_width_px(
    light: np.ndarray, points: np.ndarray, normals: np.ndarray, gap_px: float
) -> float:
    """Of the profile across the lines, as far as half way to the next, its area over
    its height."""
    chosen = np.linspace(0, len(points) - 1, min(len(points), _PROFILES)).astype(int)
    reach = min(_PROFILE_PX, 0.45 * gap_px)
    steps = np.linspace(-reach, reach, _PROFILE_STEPS)
    unit = normals[chosen] / np.linalg.norm(normals[chosen], axis=-1, keepdims=True)
    # OpenCV counts from the middle of the first pixel.
    at = points[chosen, None] + steps[None, :, None] * unit[:, None] - 0.5
    x, y = np.moveaxis(at.astype(np.float32), -1, 0)
    found = cv2.remap(light.astype(np.float32), x, y, cv2.INTER_LINEAR)
    profile = np.median(found, axis=0)
    contrast = profile - (profile[0] + profile[-1]) / 2
    height = contrast[len(steps) // 2]
    area = contrast.sum() * (steps[1] - steps[0])
    width = area / height if height else 1.0
    return float(np.clip(width, 2 * _LEAST_RADIUS_PX, 2 * reach))


def _averaged_pixels(canvas: np.ndarray, shape: tuple[int, int]) -> np.ndarray:
    size = shape[1], shape[0]
    return cv2.resize(canvas, size, interpolation=cv2.INTER_AREA).astype(np.float32)


_SOFTNESS_PX = (0.0, 0.5, 0.8, 1.2, 1.8, 2.7)
_STRIDE = 4
"""Levels are found on every fourth pixel of every fourth row."""
_FAR_OFF = 0.5
"""Of the contrast of a mark."""


class ModelledLight(NamedTuple):
    """What the model expects of a photograph.

    Attributes
    ----------
    light : In units of the photograph.
    explained : Share of the variance among the marks that is no residual.
    """

    light: Float32[np.ndarray, "height width"]
    explained: float


def modelled_light(
    photograph: Float[np.ndarray, "height width"],
    drawing: Drawing,
    fall_off: Float[np.ndarray, "height width"],
    *,
    dark: bool = False,
) -> ModelledLight:
    """The drawing as bright as the photograph.

    Parameters
    ----------
    photograph : Light of the small pixels.
    drawing : Of its marks.
    fall_off : Relative illumination there; 1 on the axis.
    dark : Whether marks lie on a bright field.
    """
    seen = photograph.astype(np.float32)
    every, some = _pixels_of(seen.shape), _pixels_of(seen.shape, _STRIDE)
    at = (slice(None, None, _STRIDE), slice(None, None, _STRIDE))
    inside = drawing.inside[at]
    lit = _lighting(some, fall_off[at], dark)[:, inside]
    tries = []
    for softness in (0.0,) if drawing.blurred else _SOFTNESS_PX:
        marks = _softened_marks(drawing.marks, softness)
        tries.append((*_levels(lit, marks[at][inside], seen[at][inside]), marks))
    _, levels, marks = min(tries, key=lambda one: one[0])
    base, field, contrast = levels.astype(np.float32)
    light = np.full_like(seen, 0.0)
    for column, of_base, of_field, of_contrast in zip(
        _lighting(every, fall_off, dark), base, field, contrast, strict=True
    ):
        light += column * (of_field + of_contrast * marks) + of_base
    return ModelledLight(light, _explained_share(seen, light, drawing.inside))


def _pixels_of(shape: tuple[int, ...], stride: int = 1) -> tuple[np.ndarray, ...]:
    """x and y of pixels, -1 to 1 over the picture, to be broadcast."""
    x, y = (
        np.linspace(-1, 1, side, dtype=np.float32)[::stride] for side in shape[::-1]
    )
    return x[None], y[:, None]


def _lighting(
    pixels: tuple[np.ndarray, ...], fall_off: np.ndarray, dark: bool
) -> Float32[np.ndarray, "columns height width"]:
    """What the field may be a sum of."""
    x, y = pixels
    one = fall_off.astype(np.float32)[None]
    if not dark:
        return one
    return np.concatenate([one * term for term in (1, x, y, x * x, x * y, y * y)])


def _levels(
    lit: Float[np.ndarray, "columns pixels"], marks: np.ndarray, light: np.ndarray
) -> tuple[float, Float[np.ndarray, "3 columns"]]:
    """What is left, as a mean of squares; base, field and contrast of each column."""
    count = len(lit)
    design = np.concatenate([np.ones_like(lit[:1]), lit, lit * marks]).T
    design = design.astype(np.float64)
    keep, levels, limit = np.ones(len(light), bool), np.zeros(2 * count + 1), 0.0
    left = light.astype(np.float64)
    for _ in range(2):
        some = design[keep]
        levels = np.linalg.lstsq(some.T @ some, some.T @ light[keep], rcond=None)[0]
        left = light - design @ levels
        contrast = np.abs(design[:, 1 + count :] @ levels[1 + count :])
        limit = _FAR_OFF * float(contrast.max(initial=0.0))
        keep = np.abs(left) <= limit
        if not keep.any():
            break
    base = np.zeros(count)
    base[0] = levels[0]
    found = np.stack([base, levels[1 : 1 + count], levels[1 + count :]])
    return float(np.mean(np.minimum(np.abs(left), limit) ** 2)), found


def _softened_marks(marks: np.ndarray, softness_px: float) -> np.ndarray:
    if not softness_px:
        return marks
    return np.asarray(cv2.GaussianBlur(marks, (0, 0), softness_px))


def _explained_share(
    seen: np.ndarray, light: np.ndarray, inside: Bool[np.ndarray, "height width"]
) -> float:
    variance = float(np.var(seen[inside])) if inside.any() else 0.0
    if variance <= 0:
        return 0.0
    return max(0.0, 1.0 - float(np.mean((seen - light)[inside] ** 2)) / variance)
