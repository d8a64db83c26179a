"""The brightness of a photograph as the model predicts it from a drawing of its marks.

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

from lensfit.workflow.pictures.chart_drawing import Drawing

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
        marks = _softened(drawing.marks, softness)
        tries.append((*_levels(lit, marks[at][inside], seen[at][inside]), marks))
    _, levels, marks = min(tries, key=lambda one: one[0])
    base, field, contrast = levels.astype(np.float32)
    light = np.full_like(seen, 0.0)
    for column, of_base, of_field, of_contrast in zip(
        _lighting(every, fall_off, dark), base, field, contrast, strict=True
    ):
        light += column * (of_field + of_contrast * marks) + of_base
    return ModelledLight(light, _explained(seen, light, drawing.inside))


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


def _softened(marks: np.ndarray, softness_px: float) -> np.ndarray:
    if not softness_px:
        return marks
    return np.asarray(cv2.GaussianBlur(marks, (0, 0), softness_px))


def _explained(
    seen: np.ndarray, light: np.ndarray, inside: Bool[np.ndarray, "height width"]
) -> float:
    variance = float(np.var(seen[inside])) if inside.any() else 0.0
    if variance <= 0:
        return 0.0
    return max(0.0, 1.0 - float(np.mean((seen - light)[inside] ** 2)) / variance)
