"""Fall-off at f-numbers that were not photographed, from the shape of the pupil.

The area of the pupil, in direction cosines, over that on the axis is the relative
illumination (`lensfit.optics.pupil`): rims that clip at a wide stop do not clip a
smaller one. The remaining loss is natural fall-off, which has little effect on the
shape of dots. So the fall-off measured at the nearest f-number is multiplied by the
ratio that the pupil predicts between the two f-numbers. It is stored as measured
fall-off is (`lensfit.optics.falloff`): a Bernstein polynomial of the squared radius
whose control values never fall, by least squares with non-negative steps, for the mean
over all azimuths.
"""

import math
from collections.abc import Iterable

import jax
import jax.numpy as jnp
import msgspec
import numpy as np
from jaxtyping import Array, Float

from lensfit.optics.bernstein import bernstein, continued_bernstein
from lensfit.optics.pupil import Pupil, relative_illumination
from lensfit.preset.blocks import FallOff
from lensfit.preset.blur_of_block import lens_blur
from lensfit.preset.entry import Entry
from lensfit.preset.photographed_stops import SAME_STOP

RADII = 48
_AZIMUTHS = 8


def squared_radii() -> Float[np.ndarray, " radii"]:
    """Where losses are stated: shares of the largest squared radius, the last one 1."""
    return (np.arange(RADII) + 1) / RADII


def pupil_loss(
    pupil: Pupil,
    stop_radius: Float[Array, ""],
    field_radius_mm: float,
    largest_mm: float,
) -> Float[np.ndarray, " radii"]:
    """-ln of the relative illumination at `squared_radii`, mean of all azimuths.

    Parameters
    ----------
    field_radius_mm : Unit of the pupil's field point.
    largest_mm : The largest radius.
    """
    azimuth = (np.arange(_AZIMUTHS) + 0.5) * (2 * np.pi / _AZIMUTHS)
    outward = np.stack([np.cos(azimuth), np.sin(azimuth)], -1)
    points_mm = np.sqrt(squared_radii())[:, None, None] * outward * largest_mm
    return np.asarray(
        _mean_loss(jnp.asarray(points_mm) / field_radius_mm, stop_radius, pupil)
    )


def loss_of(control: Float[np.ndarray, " terms"]) -> Float[np.ndarray, " radii"]:
    """-ln of the illumination at `squared_radii`."""
    return _basis(len(control)) @ control


def control_of(
    loss: Float[np.ndarray, " radii"], terms: int
) -> Float[np.ndarray, " terms"]:
    """The control values whose loss is nearest."""
    from scipy.optimize import nnls

    basis = _basis(terms)
    steps, _ = nnls(np.cumsum(basis[:, ::-1], axis=1)[:, ::-1], loss)
    return np.cumsum(steps)


@jax.jit
def _mean_loss(
    h: Float[Array, "radii azimuths 2"], stop_radius: Float[Array, ""], pupil: Pupil
) -> Float[Array, " radii"]:
    over = jax.vmap(jax.vmap(relative_illumination, (0, None, None)), (0, None, None))
    return -jnp.mean(jnp.log(over(h, stop_radius, pupil)), -1)


def _basis(terms: int) -> Float[np.ndarray, "radii terms"]:
    return bernstein(squared_radii(), terms)


TERMS = 7
"""Control values: enough for the kink where a rim begins to clip."""
FULL_STOPS = (1.0, 1.4, 2.0, 2.8, 4.0, 5.6, 8.0, 11.0, 16.0, 22.0)


def predicted_fall_off(
    entry: Entry, f_numbers: Iterable[float], valid_radius_mm: float | None = None
) -> tuple[FallOff, ...]:
    """Fall-off of an entry that has a blur, at each f-number; marked as predicted.

    Parameters
    ----------
    entry : Only its blur, projection, focus and measured fall-off are read; without the
        last, the pupil alone determines it.
    valid_radius_mm : From the principal point, where the control values end; that of
        the measured fall-off, or of the measured distortion, when left out.

    Raises
    ------
    ValueError : The entry has no blur.
    """
    if valid_radius_mm is None:
        valid_radius_mm = _measured_radius_mm(entry)
    return tuple(_fall_off(entry, float(n), valid_radius_mm) for n in f_numbers)


def with_predicted_fall_off(entry: Entry) -> Entry:
    """The entry with fall-off at the full stops that were not photographed.

    Nothing is added to an entry without a blur, or whose fall-off belongs to no stated
    f-number.
    """
    measured = [one.f_number for one in entry.fall_off]
    if entry.blur is None or not entry.blur.stops or None in measured:
        return entry
    known = [one for one in measured if one is not None]
    widest = min([*known, *(stop.f_number for stop in entry.blur.stops)])
    wanted = [
        number
        for number in FULL_STOPS
        if number > widest / SAME_STOP
        and all(not 1 / SAME_STOP < number / one < SAME_STOP for one in known)
    ]
    every = (*entry.fall_off, *predicted_fall_off(entry, wanted))
    ordered = sorted(every, key=lambda one: one.f_number or 0.0)
    return msgspec.structs.replace(entry, fall_off=tuple(ordered))


def _measured_radius_mm(entry: Entry) -> float:
    if entry.fall_off:
        return max(one.valid_radius_mm for one in entry.fall_off)
    return entry.distortion.valid_radius * entry.distortion.reference_radius_mm


def _fall_off(entry: Entry, f_number: float, valid_radius_mm: float) -> FallOff:
    loss = _pupil_loss(entry, f_number, valid_radius_mm)
    measured = {one.f_number: one for one in entry.fall_off if not one.predicted}
    stops = [number for number in measured if number is not None]
    of_channels = [loss] * 3
    if stops:
        stop = min(stops, key=lambda number: abs(math.log(number / f_number)))
        nearest = measured[stop]
        change = loss - _pupil_loss(entry, stop, valid_radius_mm)
        of_channels = [
            _loss_at(nearest, control, valid_radius_mm) + change
            for control in (nearest.r, nearest.g, nearest.b)
        ]
    r, g, b = (tuple(control_of(one, TERMS).tolist()) for one in of_channels)
    return FallOff(f_number, valid_radius_mm, r, g, b, predicted=True)


def _pupil_loss(
    entry: Entry, f_number: float, valid_radius_mm: float
) -> Float[np.ndarray, " radii"]:
    blur = lens_blur(entry, f_number, entry.focus_distance_mm)
    return pupil_loss(
        blur.pupil,
        blur.stop_radius,
        float(blur.aberration.field_radius_mm),
        valid_radius_mm,
    )


def _loss_at(
    measured: FallOff, control: tuple[float, ...], valid_radius_mm: float
) -> Float[np.ndarray, " radii"]:
    share = squared_radii() * (valid_radius_mm / measured.valid_radius_mm) ** 2
    return continued_bernstein(share, len(control)) @ np.array(control)
