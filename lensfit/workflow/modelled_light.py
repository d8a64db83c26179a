"""A photograph as the model has it: how bright a drawing of its marks is.

    light = base + field * fall-off + contrast * fall-off * marks

The lens says where marks lie, how they are blurred (if it was measured) and how light
falls off; how bright the chart was is for the photograph to say: base, field and
contrast are found by least squares over the pixels among the marks, twice, the second
time without those that the first leaves off by more than half a mark (dirt, print,
fingers). Where blur was not measured the drawing is softened by one Gaussian for all
marks, the one that suits best.
"""

from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Bool, Float, Float32

from lensfit.workflow.chart_drawing import Drawing

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
) -> ModelledLight:
    """The drawing as bright as the photograph.

    Parameters
    ----------
    photograph : Light of the small pixels.
    drawing : Of its marks.
    fall_off : Relative illumination there; 1 on the axis.
    """
    seen = photograph.astype(np.float32)
    some = (slice(None, None, _STRIDE), slice(None, None, _STRIDE))
    inside = drawing.inside[some]
    tries = []
    for softness in (0.0,) if drawing.blurred else _SOFTNESS_PX:
        marks = _softened(drawing.marks, softness)
        design = _design(marks[some][inside], fall_off[some][inside])
        tries.append((*_levels(design, seen[some][inside]), marks))
    _, levels, marks = min(tries, key=lambda one: one[0])
    shape = seen.shape
    light = _design(marks.ravel(), fall_off.ravel()) @ levels.astype(np.float32)
    light = light.reshape(shape)
    return ModelledLight(light, _explained(seen, light, drawing.inside))


def _design(marks: np.ndarray, fall_off: np.ndarray) -> Float32[np.ndarray, "pixels 3"]:
    columns = np.ones_like(marks), fall_off, fall_off * marks
    return np.stack(columns, -1).astype(np.float32)


def _levels(design: np.ndarray, light: np.ndarray) -> tuple[float, np.ndarray]:
    """What is left, as a mean of squares, and the three levels."""
    keep = np.ones(len(light), bool)
    levels, left, mark = np.zeros(3), light, 0.0
    for _ in range(2):
        some = design[keep].astype(np.float64)
        levels = np.linalg.lstsq(some.T @ some, some.T @ light[keep], rcond=None)[0]
        left = light - design @ levels
        mark = float(np.abs(levels[2]) * design[:, 2].max(initial=0.0))
        keep = np.abs(left) <= _FAR_OFF * mark
        if not keep.any():
            break
    return float(np.mean(np.minimum(np.abs(left), _FAR_OFF * mark) ** 2)), levels


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
