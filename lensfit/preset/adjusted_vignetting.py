"""Fall-off after the knobs are applied: natural, optical and mechanical parts.

A photograph shows only their product (`lensfit.optics.falloff`). In -ln(illumination),
where they add up, the photographed loss is divided by what is known of the lens:

- natural: the foreshortening of the pupil that was measured (`optics.pupil`), or the
  fourth power of the cosine of the field angle where no pupil was;
- optical: what the measured rims hide beyond that;
- mechanical: the rest.

No part is larger than what the parts before it leave of the photographed loss, so that
none is negative and a lens that shows no loss has none. Adjusted rims
(`lensfit.preset.adjusted_pupil`) hide more or less by their own shape.

A stated loss is the same in all colours: it takes the shape of green's part, or, where
that is too faint to have one, the foreshortening, the second or the third power of the
squared radius. The sum is stored as measured fall-off is: a Bernstein polynomial of a
degree that represents the photographed one exactly, by least squares over control
values that never fall.
"""

import math
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from lensfit.lens import Lens
from lensfit.optics.falloff import Illumination
from lensfit.optics.many_points import undistort
from lensfit.optics.pupil import Pupil
from lensfit.preset.knob_groups import AberrationKnobs
from lensfit.preset.predicted_fall_off import (
    control_of,
    loss_of,
    pupil_loss,
    squared_radii,
)

_GREEN = 1
_TERMS = 12
_NOTHING = 1e-6
_LARGEST_LOSS = 40.0
_FAINT = 0.02
"""What is left of a loss after its other parts has no shape below this: fall-off is
known to about 2 % of the illumination."""

Loss = Float[np.ndarray, " radii"]


class Parts(NamedTuple):
    """Losses over the squared radius, of one channel."""

    natural: Loss
    optical: Loss
    mechanical: Loss


def adjusted_illumination(
    lens: Lens, edge_mm: float, rims: Pupil | None, knobs: AberrationKnobs
) -> Illumination | None:
    """The adjusted fall-off; the same object if no knob applies.

    Parameters
    ----------
    lens : As it was measured.
    edge_mm : Edge of the field, from the principal point.
    rims : Its pupil with adjusted rims; None if they are as measured.
    """
    stated = _stated_vignetting(knobs)
    if rims is None and stated == _NEUTRAL:
        return lens.illumination
    known = lens.illumination
    if known is None:
        known = Illumination(jnp.zeros((3, 1)), jnp.asarray(edge_mm, float))
    valid_mm, share = float(known.valid_radius_mm), squared_radii()
    natural = _natural(lens, np.sqrt(share) * valid_mm)
    before, after = (_optical(lens, p, valid_mm, natural) for p in (None, rims))
    edge = min(edge_mm / valid_mm, 1.0) ** 2
    each = [
        _parts_of_loss(loss_of(c), natural, before) for c in np.asarray(known.control)
    ]
    shapes = Parts(natural, np.maximum(after, 0), each[_GREEN].mechanical)
    control = []
    for measured, parts in zip(np.asarray(known.control), each, strict=True):
        optical = np.maximum(parts.optical + after - before, 0)
        total = _total(parts._replace(optical=optical), shapes, stated, share, edge)
        terms = max(len(measured), _TERMS)
        control.append(control_of(np.minimum(total, _LARGEST_LOSS), terms))
    return Illumination(jnp.asarray(np.array(control)), known.valid_radius_mm)


def photographed_parts(lens: Lens) -> tuple[bool, bool, bool]:
    """Whether the photographed fall-off has a natural, optical and mechanical part."""
    known = lens.illumination
    if known is None:
        return False, False, False
    valid_mm = float(known.valid_radius_mm)
    natural = _natural(lens, np.sqrt(squared_radii()) * valid_mm)
    optical = _optical(lens, None, valid_mm, natural)
    each = [
        _parts_of_loss(loss_of(c), natural, optical) for c in np.asarray(known.control)
    ]
    first, second, third = (max(p.max() for p in of) for of in zip(*each, strict=True))
    return first > _NOTHING, second > _NOTHING, third > _NOTHING


class _Stated(NamedTuple):
    gains: tuple[float, float, float]
    stops: tuple[float | None, float | None, float | None]


_NEUTRAL = _Stated((1.0, 1.0, 1.0), (None, None, None))


def _stated_vignetting(knobs: AberrationKnobs) -> _Stated:
    return _Stated(
        (
            knobs.natural_vignetting_gain,
            knobs.optical_vignetting_gain,
            knobs.mechanical_vignetting_gain,
        ),
        (
            knobs.natural_vignetting_stops,
            knobs.optical_vignetting_stops,
            knobs.mechanical_vignetting_stops,
        ),
    )


def _parts_of_loss(loss: Loss, natural: Loss, optical: Loss) -> Parts:
    first = np.minimum(natural, loss)
    second = np.clip(optical, 0, loss - first)
    return Parts(first, second, loss - first - second)


def _total(
    parts: Parts, shapes: Parts, stated: _Stated, share: Loss, edge: float
) -> Loss:
    """Parts at their gains, or at their stated loss, one upon the other.

    Parameters
    ----------
    edge : Squared radius of the edge of the field, in that of the last of `share`.
    """
    total = np.zeros_like(share)
    plain = (_grown(share / edge, power) for power in (1, 2, 3))
    for part, shape, other, gain, stops in zip(
        parts, shapes, plain, *stated, strict=True
    ):
        if stops is not None:
            form = shape if np.interp(edge, share, shape) > _FAINT else other
            part = form * (stops * math.log(2) / np.interp(edge, share, form))
        total += gain * part
    return total


def _grown(share: Loss, power: int) -> Loss:
    """A power up to 1, and on as its tangent."""
    return np.minimum(share, 1) ** power + power * np.maximum(share - 1, 0)


def _natural(lens: Lens, radius_mm: Loss) -> Loss:
    if lens.blur is not None:
        square = (radius_mm / float(lens.blur.aberration.field_radius_mm)) ** 2
        stretch = np.asarray(lens.blur.pupil.stretch).sum(0)
        return np.maximum(-(stretch[0] * square + stretch[1] * square**2), 0)
    centre = lens.distortion.principal_point_mm
    points = centre[None] + jnp.asarray(np.stack([radius_mm, 0 * radius_mm], -1))
    seen = undistort(points, lens.distortion)
    slope = np.asarray(seen - centre[None]) / float(
        lens.distortion.principal_distance_mm
    )
    return np.nan_to_num(2 * np.log1p(np.sum(slope**2, -1)), nan=_LARGEST_LOSS)


def _optical(lens: Lens, rims: Pupil | None, largest_mm: float, natural: Loss) -> Loss:
    """What rims hide beyond the natural loss: those given, or the lens' own."""
    blur = lens.blur
    pupil = rims or (blur and blur.pupil)
    if blur is None or pupil is None or not pupil.rim_shift.size:
        return np.zeros_like(natural)
    field_mm = float(blur.aberration.field_radius_mm)
    return pupil_loss(pupil, blur.stop_radius, field_mm, largest_mm) - natural
