"""Depth channels as renderers write them, converted to one definition.

Distances come in any unit, measured along the optical axis (*perpendicular*) or along
the ray through the pixel (*ray*), inverted (1/z), or normalised between two planes.
The sky is infinite, zero, negative or a huge number. The result is perpendicular
distance in millimetres from the pinhole of the CG camera, infinite for the sky.

Half floats end at 65504, which stands for the sky there.
"""

from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
from jaxtyping import Float, Float32

from lensfit.coords import Window, pixels_over_window
from lensfit.errors import ImageError
from lensfit.io.exr import ExrImage, ExrPart, is_vector
from lensfit.units import MILLIMETRES_PER_INCH, MILLIMETRES_PER_METRE

DepthKind = Literal["perpendicular", "ray", "inverse", "normalised"]
KINDS: tuple[DepthKind, ...] = ("perpendicular", "ray", "inverse", "normalised")

UNITS_MM = {
    "mm": 1.0,
    "cm": 10.0,
    "m": MILLIMETRES_PER_METRE,
    "in": MILLIMETRES_PER_INCH,
    "ft": 12 * MILLIMETRES_PER_INCH,
}
HUGE = 1e9
"""From here on a number is no distance, in any unit: renderers write 1e10, 1e30."""

_LEAVES = ("z", "depth", "zdepth", "depthz")
_HALF_SKY = 65_000


@dataclass(frozen=True)
class DepthMeaning:
    """What the numbers of a depth channel say.

    Attributes
    ----------
    unit_mm : Millimetres of one unit.
    kind : Along the axis, along the ray, one over the distance along the axis, or a
        share of the way from `near` (0) to `far` (1).
    near, far : Planes of a normalised depth, in its unit.
    """

    unit_mm: float = MILLIMETRES_PER_METRE
    kind: DepthKind = "perpendicular"
    near: float = 0.0
    far: float = 1.0


class FoundDepth(NamedTuple):
    """A depth channel of a file."""

    part: ExrPart
    name: str


def unit_in_mm(text: str) -> float:
    """Millimetres of a unit: a name of `UNITS_MM`, or how many millimetres it has.

    Raises
    ------
    ImageError : Neither.
    """
    if text in UNITS_MM:
        return UNITS_MM[text]
    try:
        value = float(text)
    except ValueError:
        value = 0.0
    if not 0 < value < np.inf:
        raise ImageError(
            f"{text!r} is no unit of depth",
            remedy=f"give one of {', '.join(UNITS_MM)}, or its length in millimetres",
        )
    return value


def find_depth(
    image: ExrImage, name: str | None = None, beside: ExrPart | None = None
) -> FoundDepth | None:
    """The depth channel of a file, or None when it has none.

    Parameters
    ----------
    name : Its exact name, with or without the name of its part before a dot; by
        default ``Z``, ``depth.Z``, ``depth`` and the like, in any case.
    beside : The part that is looked at first: that of the colours.

    Raises
    ------
    ImageError : No channel is called `name`.
    """
    parts = [part for part in image.parts if part is not beside]
    parts = parts if beside is None else [beside, *parts]
    if name is not None:
        for part in parts:
            for own in part.channels:
                if name in (own, f"{part.name}.{own}"):
                    return FoundDepth(part, own)
        available = ", ".join(n for part in image.parts for n in part.channels)
        raise ImageError(
            f"has no channel {name!r} to read depth from",
            remedy=f"its channels are {available or 'none'}",
        )
    found = [
        (rank, FoundDepth(part, own))
        for part in parts
        for own in part.channels
        if (rank := _rank(part, own)) is not None
    ]
    return min(found, key=lambda f: f[0])[1] if found else None


def is_depth_name(name: str) -> bool:
    """Whether a channel of this name may be a depth: ``Z``, ``depth.Z``, ``fg.depth``
    and the like."""
    return name.rpartition(".")[2].lower() in _LEAVES


def _rank(part: ExrPart, name: str) -> int | None:
    """How surely a channel is the depth of the picture; less is surer."""
    layer, _, leaf = name.lower().rpartition(".")
    if leaf in _LEAVES:
        if is_vector(part, name.rpartition(".")[0]):
            return None
        known = layer in ("", "depth", "z", "p", part.name.lower())
        return (0 if known else 20) + _LEAVES.index(leaf)
    if part.name.lower() in _LEAVES and len(part.channels) == 1:
        return 10
    return None


def depth_over_window(
    part: ExrPart, name: str, window: Window
) -> Float32[np.ndarray, "height width"]:
    """The samples of a channel over another data window; NaN where it has none."""
    samples = part.channels[name]
    whole = samples.astype(np.float32)  # a copy, and one that has a NaN
    result = pixels_over_window(whole, part.data_window, window, np.nan)
    if samples.dtype == np.float16:
        result[result >= _HALF_SKY] = np.inf
    return result


def perpendicular_mm(
    samples: Float32[np.ndarray, "*shape"],
    meaning: DepthMeaning,
    slant: Float[np.ndarray, "*#shape"] | float,
) -> Float32[np.ndarray, "*shape"]:
    """Perpendicular distance in millimetres; the sky is infinite, NaN stays NaN.

    Parameters
    ----------
    samples : As written.
    meaning : What they say.
    slant : Length of the ray through each pixel to a plane at distance 1.
    """
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        value = np.asarray(samples, np.float64)
        if meaning.kind == "inverse":
            # One over it: the sky is 0, and nothing is nearer than a millionth.
            distance = np.where(
                value > 0, 1 / value, np.where(value <= 0, np.inf, value)
            )
            distance = np.where(np.isposinf(value), np.inf, distance)
        elif meaning.kind == "normalised":
            distance = meaning.near + value * (meaning.far - meaning.near)
            # The sky is at the far plane and beyond, whichever of the two that is.
            if meaning.far < meaning.near:
                value = 1 - value
            distance = np.where((value >= 1) | (value < 0), np.inf, distance)
        else:
            distance = value / slant if meaning.kind == "ray" else value
        sky = (distance <= 0) | (distance >= HUGE)
        distance = np.where(sky, np.inf, distance * meaning.unit_mm)
        return distance.astype(np.float32)


def without_nan(
    depth_mm: Float32[np.ndarray, "height width"],
) -> Float32[np.ndarray, "height width"]:
    """The plane with the distance of the nearest pixel that has one where it is NaN;
    infinite if none has."""
    missing = np.isnan(depth_mm)
    if not missing.any():
        return depth_mm
    if missing.all():
        return np.full_like(depth_mm, np.inf)
    from scipy.ndimage import distance_transform_edt

    rows, columns = distance_transform_edt(
        missing, return_distances=False, return_indices=True
    )  # pyright: ignore[reportGeneralTypeIssues]
    return depth_mm[rows, columns]


def ray_slant(
    offsets_mm: Float[np.ndarray, "height width 2"], focal_length_mm: float
) -> Float[np.ndarray, "height width"]:
    """Length of the ray through each pixel of a pinhole picture to a plane at distance
    1: what ray distance is divided by to become perpendicular distance."""
    across = np.hypot(offsets_mm[..., 0], offsets_mm[..., 1])
    return np.hypot(1.0, across / focal_length_mm)
