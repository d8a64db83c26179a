"""The pupil after the knobs are applied: blades, roundness, oval, rims, transmission.

Blades, rotation and roundness replace or change numbers of `lensfit.optics.pupil`; ring
brightness and filter image are a `lensfit.optics.stop_places`. The squeeze stretches
the landing points of the rays, in focus and out of it. Where an adjusted pupil passes
rays that were not measured (in the corners of blades and beyond the rims), they take
the aberration of the nearest measured ray.

The rims are clipping apertures. They move against the stop with the field point h, as
h (a0 + a1 |h|^2), and their radius is r0 + r1 |h|^2. A gain g of the cat's eye gives
every field point h the rims of the field point g h:

    a0 -> g a0,   a1 -> g^3 a1,   r1 -> g^2 r1,

limited so that the corner keeps a sliver of light. A stated cat's eye is one rim as
large as the widest stop, whose shift d at the corner hides a given share of it: two
discs of radius 1 share the area 2 acos(d / 2) - (d / 2) sqrt(4 - d^2).
"""

import math
from dataclasses import replace

import cv2
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from lensfit.errors import ImageError
from lensfit.io.image import read_photograph
from lensfit.optics.pupil import Pupil
from lensfit.optics.stop_places import SIZES_PX, Transmission
from lensfit.preset.knob_groups import BokehKnobs
from lensfit.psf.lens_blur import LensBlur

_SLIVER, _GAINS = 0.4, 65
"""Least overlap of two discs over the smaller radius; gains that are tried."""


def blur_with_adjusted_pupil(
    blur: LensBlur, corner_mm: float, knobs: BokehKnobs
) -> LensBlur:
    """The blur through the adjusted pupil.

    Parameters
    ----------
    blur : Of a lens whose blur was measured, or of a perfect one.
    corner_mm : Of the sensor, from the principal point.

    Raises
    ------
    ImageError : The filter image cannot be read, or lets no light through.
    """
    corner = corner_mm / float(blur.aberration.field_radius_mm)
    pupil = _with_adjusted_blades(with_adjusted_rims(blur, corner, knobs), knobs)
    opens = pupil.rim_shift is not blur.pupil.rim_shift or knobs.blades is not None
    known = opens and bool(blur.aberration.terms)
    oval = None
    if knobs.squeeze != 1:
        half = math.sqrt(knobs.squeeze)
        oval = jnp.asarray([1 / half, half])
    return replace(
        blur,
        pupil=pupil,
        transmission=_transmission(knobs),
        known=replace(blur.pupil, blades=jnp.zeros(())) if known else None,
        oval=oval,
        is_ideal=blur.is_ideal and not pupil.rim_shift.size,
    )


def with_adjusted_rims(blur: LensBlur, corner: float, knobs: BokehKnobs) -> Pupil:
    """The pupil with its rims adjusted.

    Parameters
    ----------
    corner : Of the sensor, in field radii.
    """
    pupil, g = blur.pupil, knobs.cat_eye_gain
    stop = (pupil.stop_shift * blur.stop_radius**2)[None]
    shift, radius = pupil.rim_shift - stop, pupil.rim_radius
    if knobs.cat_eye_percent is not None:
        hidden = _shift_that_hides(knobs.cat_eye_percent / 100)
        shift = jnp.asarray([[hidden / corner, 0.0]])
        radius = jnp.asarray([[1.0, 0.0]])
    elif g == 1:
        return pupil
    if g > 1:
        g = _largest_open(g, np.asarray(shift), np.asarray(radius), corner, blur)
    shift = stop + shift * jnp.asarray([g, g**3])[None]
    return replace(
        pupil, rim_shift=shift, rim_radius=radius * jnp.asarray([1.0, g**2])[None]
    )


def _largest_open(
    gain: float,
    shift: Float[np.ndarray, "rims 2"],
    radius: Float[np.ndarray, "rims 2"],
    corner: float,
    blur: LensBlur,
) -> float:
    """The gain, or the largest at which every two discs overlap in the corner."""

    def room(g: float) -> float:
        h = g * corner
        centre = np.append(h * shift[:, 0] + h**3 * shift[:, 1], 0.0)
        reach = radius[:, 0] + h**2 * radius[:, 1]
        reach = np.append(reach, float(blur.stop_radius))
        apart = np.abs(centre[:, None] - centre)
        smaller = np.minimum(reach[:, None], reach)
        return float((reach[:, None] + reach - apart - _SLIVER * smaller).min())

    tried = np.linspace(1.0, gain, _GAINS)
    closed = [room(g) <= 0 for g in tried]
    return float(tried[max(closed.index(True) - 1, 0)]) if any(closed) else gain


def _shift_that_hides(share: float) -> float:
    """Of one of two unit discs, so that it leaves all but this share of the other."""
    from scipy.optimize import brentq

    def too_much(d: float) -> float:
        left = 2 * math.acos(d / 2) - d / 2 * math.sqrt(4 - d * d)
        return 1 - left / math.pi - share

    return float(brentq(too_much, 0.0, 2.0))  # pyright: ignore[reportArgumentType]


def _with_adjusted_blades(pupil: Pupil, knobs: BokehKnobs) -> Pupil:
    blades = pupil.blades
    if knobs.blades is not None:
        blades = jnp.asarray(knobs.blades, float)
    elif knobs.filter_image is not None:
        blades = jnp.zeros(())
    curvature = pupil.blade_curvature
    if knobs.roundness is not None:
        curvature = jnp.asarray(knobs.roundness, float)
    return replace(
        pupil,
        blades=blades,
        blade_curvature=curvature,
        blade_rotation_rad=pupil.blade_rotation_rad
        + math.radians(knobs.blade_rotation_deg),
    )


def _transmission(knobs: BokehKnobs) -> Transmission | None:
    if knobs.ring_brightness == 0 and knobs.filter_image is None:
        return None
    return Transmission(
        ring_brightness=jnp.asarray(knobs.ring_brightness, float),
        rotation_rad=jnp.asarray(math.radians(knobs.blade_rotation_deg), float),
        filters=()
        if knobs.filter_image is None
        else filter_at_all_sizes(knobs.filter_image),
    )


def filter_at_all_sizes(path: str) -> tuple[Float[jnp.ndarray, "3 side side"], ...]:
    """The picture of a stop at every size, r g b, its middle in the middle.

    Raises
    ------
    ImageError : It cannot be read, or lets no light through.
    """
    try:
        picture = read_photograph(path)
    except ImageError as error:
        raise ImageError(
            f"{error.what}, and is the filter image of the lens",
            where=error.where,
            remedy="give an EXR or PNG with --filter-image",
        ) from error
    pixels = np.nan_to_num(picture.pixels, nan=0.0, posinf=0.0)
    pixels = np.maximum(np.asarray(pixels, np.float32), 0)
    colours = np.broadcast_to(pixels, (*pixels.shape[:2], 3))
    side = max(colours.shape[:2])
    before = [(side - n) // 2 for n in colours.shape[:2]]
    pads = [(b, side - n - b) for b, n in zip(before, colours.shape[:2], strict=True)]
    square = np.pad(colours, (*pads, (0, 0)))
    if not (_light_in_circle(square) > 0).all():
        raise ImageError(
            "lets no light through as a filter",
            where=path,
            remedy="give --filter-image a picture that is bright inside its inscribed "
            "circle, in red, green and blue",
        )
    each = []
    for size in SIZES_PX:
        finer = cv2.INTER_AREA if size < side else cv2.INTER_LINEAR
        resized = cv2.resize(square, (size, size), interpolation=finer)
        each.append(jnp.asarray(np.moveaxis(resized, 2, 0).astype(float)))
    return tuple(each)


def _light_in_circle(
    square: Float[np.ndarray, "side side 3"],
) -> Float[np.ndarray, "3"]:
    """Light of each channel inside the inscribed circle."""
    t = (np.arange(len(square)) + 0.5) / len(square) * 2 - 1
    return square[t**2 + t[:, None] ** 2 <= 1].sum(0)
