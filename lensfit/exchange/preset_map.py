"""lensfit's own distortion, lateral colour and fall-off fitted to another program's.

The direction of every ray is kept: lensfit's undistorted picture is that of a pinhole
whose scale and shift agree with the photograph on the axis, and another program's may
be magnified or shifted against it (`map_aligned_on_axis`). Radial terms and squeeze are
fitted first, then the named terms, then, where the map still differs, the free field
with them; the simplest model within the tolerance is taken. One compiled program serves
all stages, with coefficients that are not yet free held at zero.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from scipy.optimize import least_squares, nnls
from threadpoolctl import threadpool_limits

from lensfit.errors import ExchangeError
from lensfit.exchange.foreign import PointMap, Points
from lensfit.exchange.samples import ExchangeFrame, Residual, Samples, residual_from
from lensfit.optics import distortion as chief_ray
from lensfit.optics import field
from lensfit.optics.bernstein import bernstein
from lensfit.optics.distortion import Distortion, no_distortion
from lensfit.preset import blocks

_RADIAL_TERMS = 5
_FALL_OFF_TERMS = 6
_RADII = 200
_DARKEST = 1e-3


def fit_channel_shift(
    green_mm: Points, channel_mm: Points, lens: Distortion, frame: ExchangeFrame
) -> tuple[blocks.ChannelShift, Residual]:
    """Where a channel lands, of where green lands: linear in all coefficients."""
    centre = np.asarray(lens.principal_point_mm)
    radius = float(lens.reference_radius_mm)
    q = (green_mm - centre) / radius
    x, y = q.T
    r2 = x * x + y * y
    one, zero = np.ones_like(x), np.zeros_like(x)
    shapes = [q * (r2**k)[:, None] for k in range(_RADIAL_TERMS)]
    shapes += [np.stack(s, -1) for s in ((one, zero), (zero, one), (x, -y), (y, x))]
    shapes += [
        np.stack([2 * x * y, r2 + 2 * y * y], -1),
        np.stack([r2 + 2 * x * x, 2 * x * y], -1),
    ]
    columns = np.stack([s.ravel() for s in shapes], -1)
    wanted = ((channel_mm - green_mm) / radius).ravel()
    found, *_ = np.linalg.lstsq(columns, wanted)
    off = np.linalg.norm((columns @ found - wanted).reshape(-1, 2), axis=-1) * radius
    found = np.where(np.abs(found) < 1e-14, 0.0, found)
    ends = np.cumsum([_RADIAL_TERMS, 2, 2]).tolist()
    radial, (sx, sy), strain, decentering = np.split(found, ends)
    block = blocks.ChannelShift(
        radial=tuple(radial.tolist()),
        shift_mm=(float(sx) * radius, float(sy) * radius),
        valid_radius=float(np.sqrt(r2.max())),
        strain=tuple(strain.tolist()) if strain.any() else (),
        decentering=tuple(decentering.tolist()) if decentering.any() else (),
    )
    return block, residual_from(off / frame.pitch_mm)


def fit_fall_off(
    illumination: Callable[[Points], Float[np.ndarray, " points"]],
    f_number: float | None,
    centre_mm: tuple[float, float],
    frame: ExchangeFrame,
) -> tuple[blocks.FallOff, float]:
    """Fall-off as a Bernstein polynomial that never rises outwards; its worst error.

    Sampled on circles about the principal point, whose mean counts.
    """
    centre = np.array(centre_mm)
    corners = np.array(frame.area_mm) / 2 + np.abs(centre)
    reach = float(np.hypot(*corners))
    azimuth = np.linspace(0, 2 * np.pi, 24, endpoint=False)
    circle = np.stack([np.cos(azimuth), np.sin(azimuth)], -1)
    radii = np.sqrt(np.linspace(0, 1, _RADII))
    points = centre + reach * radii[:, None, None] * circle
    with np.errstate(all="ignore"):
        light = illumination(points.reshape(-1, 2)).reshape(len(radii), -1).mean(1)
    light = np.clip(np.nan_to_num(light / light[0], nan=_DARKEST), _DARKEST, 1.0)
    terms = bernstein(radii**2, _FALL_OFF_TERMS)
    steps = np.cumsum(terms[:, ::-1], 1)[:, ::-1]
    found, _ = nnls(steps * light[:, None], -np.log(light) * light)
    control = np.cumsum(found)
    worst = float(np.abs(np.exp(-terms @ control) - light).max())
    numbers = tuple(control.tolist())
    return blocks.FallOff(f_number, reach, numbers, numbers, numbers), worst


FREE_DEGREE = 9
NEAR_ENOUGH_PX = 1e-3
"""Worst difference that is sought."""
_RADIAL = 8
_FEW = 4
_NAMED = field.DECENTERING_TERMS + field.PRISM_TERMS + field.ANAMORPHIC_TERMS
_WORTH = 0.5
_BOX_MARGIN = 0.05
_MOST_STEPS = 30
_STEP = 1e-5


@dataclass(frozen=True, eq=False)
class MapAlignedOnAxis:
    """Another program's map with its undistorted picture as lensfit has it.

    Attributes
    ----------
    map : Theirs.
    axis_mm : Where their axis lands, on their undistorted picture.
    principal_point_mm : Where it lands on the photograph.
    magnification : Of their undistorted picture against lensfit's.
    """

    map: PointMap
    axis_mm: tuple[float, float]
    principal_point_mm: tuple[float, float]
    magnification: float

    def undistorted(self, distorted_mm: Points) -> Points:
        """Of the photograph, in lensfit's undistorted picture."""
        about = self.map.undistorted(distorted_mm) - np.array(self.axis_mm)
        return about / self.magnification + np.array(self.principal_point_mm)

    def distorted(self, undistorted_mm: Points) -> Points:
        """The inverse."""
        about = np.asarray(undistorted_mm, float) - np.array(self.principal_point_mm)
        return self.map.distorted(about * self.magnification + np.array(self.axis_mm))

    @property
    def moved_mm(self) -> float:
        """Shift of the undistorted picture."""
        return float(np.hypot(*np.subtract(self.principal_point_mm, self.axis_mm)))


def map_aligned_on_axis(
    mapping: PointMap, axis_mm: tuple[float, float], unit_mm: float
) -> MapAlignedOnAxis:
    """`mapping` with scale and shift of lensfit's undistorted picture.

    Parameters
    ----------
    axis_mm : Principal point of the other program's undistorted picture.
    unit_mm : Size of the picture.

    Raises
    ------
    ExchangeError : The map is undefined, or turns over, on its axis.
    """
    h = _STEP * unit_mm
    with np.errstate(all="ignore"):
        landed = mapping.distorted(np.array([axis_mm], float))[0]
        around = np.concatenate([landed + h * np.eye(2), landed - h * np.eye(2)])
        back = mapping.undistorted(around)
        slope = (back[:2] - back[2:]).T / (2 * h)
        area = float(np.linalg.det(slope)) if np.isfinite(slope).all() else np.nan
    if not area > 0:
        raise ExchangeError(
            "the distortion is undefined, or turns over, on the axis of the lens"
        )
    x, y = landed.tolist()
    scale = float(np.sqrt(area))
    return MapAlignedOnAxis(
        mapping, axis_mm, (x, y), 1.0 if abs(scale - 1) < 1e-9 else scale
    )


# Matrices this small gain nothing from several BLAS threads, which spin as they wait.
@threadpool_limits.wrap(limits=1, user_api="blas")
def fit_distortion(
    samples: Samples,
    principal_distance_mm: float,
    principal_point_mm: tuple[float, float],
    box: Float[np.ndarray, "2 2"] | None = None,
) -> Distortion:
    """The distortion that puts the undistorted samples where the distorted ones are.

    Parameters
    ----------
    samples : Of an `MapAlignedOnAxis` map.
    box : Low and high corner of the free field, as `box_of`; that of the samples if
        None. States that are to be interpolated need the same.
    """
    start = _start(samples, principal_distance_mm, principal_point_mm)
    if box is not None:
        start = replace(start, box=jnp.asarray(box))
    best = _fit_candidate(start, samples, _FEW, named=False, free=False)
    if best.off_px < NEAR_ENOUGH_PX:
        return _tidy(best.lens)
    lopsided = _fit_candidate(best.lens, samples, _FEW, named=True, free=False)
    named = lopsided.off_px < _WORTH * best.off_px
    best = lopsided if named else best
    for free in (False, True):
        if best.off_px < NEAR_ENOUGH_PX:
            break
        other = _fit_candidate(
            best.lens, samples, _RADIAL, named=named or free, free=free
        )
        best = other if other.off_px < _WORTH * best.off_px else best
    return _tidy(best.lens)


def box_of(
    samples: Samples, principal_point_mm: tuple[float, float]
) -> Float[np.ndarray, "2 2"]:
    """Around the samples before the squeeze, from the sensor centre, half diagonals."""
    return np.asarray(_start(samples, 1.0, principal_point_mm).box)


def residual_without_fit(
    samples: Samples,
    principal_distance_mm: float,
    principal_point_mm: tuple[float, float],
) -> Residual:
    """How far the samples are off with nothing but the squeeze on the axis."""
    start = _start(samples, principal_distance_mm, principal_point_mm)
    landed = np.asarray(_landed_mm(jnp.asarray(samples.undistorted_mm), start))
    off = np.linalg.norm(landed - samples.distorted_mm, axis=-1)
    return residual_from(off / samples.frame.pitch_mm)


class _Candidate(NamedTuple):
    """A fitted lens and its worst difference."""

    lens: Distortion
    off_px: float


def _start(
    samples: Samples, distance_mm: float, point_mm: tuple[float, float]
) -> Distortion:
    """The ideal lens with the slope on the axis as its squeeze."""
    point = np.array(point_mm)
    reference = samples.frame.radius_mm
    apart = np.linalg.norm(samples.distorted_mm - point, axis=-1)
    slope = samples.slope[int(apart.argmin())]
    sizes, axes = np.linalg.eigh((slope + slope.T) / 2)
    ratio, axis = np.log(sizes[1] / sizes[0]), axes[:, 1]
    twice = 2 * np.arctan2(axis[1], axis[0])
    squeeze = ratio * np.array([np.cos(twice), np.sin(twice)])
    radius = np.linalg.norm(samples.undistorted_mm - point, axis=-1).max() / reference
    count = len(field.free_degrees(FREE_DEGREE))
    lens = replace(
        no_distortion(distance_mm, reference),
        principal_point_mm=jnp.asarray(point),
        radial=jnp.zeros(_RADIAL),
        valid_radius=jnp.asarray(float(radius)),
        squeeze=jnp.asarray(squeeze),
        free=jnp.zeros((2, count)),
        degree=FREE_DEGREE,
    )
    return replace(lens, box=jnp.asarray(_box(lens, samples)))


def _box(lens: Distortion, samples: Samples) -> np.ndarray:
    """Around the samples before the squeeze, from the sensor centre."""
    straight = replace(
        lens,
        principal_point_mm=jnp.zeros(2),
        squeeze=-lens.squeeze,
        reference_radius_mm=jnp.asarray(1.0),
    )
    about = jnp.asarray(samples.distorted_mm) / lens.reference_radius_mm
    spread = np.asarray(_unsqueezed_mm(about, straight))
    low, high = spread.min(0), spread.max(0)
    margin = _BOX_MARGIN * (high - low)
    return np.stack([low - margin, high + margin])


def _fit_candidate(
    lens: Distortion, samples: Samples, radial_terms: int, *, named: bool, free: bool
) -> _Candidate:
    """So many radial terms and the squeeze fitted, with the other terms or not."""
    before = np.concatenate(
        [lens.radial, lens.squeeze, lens.named, np.asarray(lens.free).ravel()]
    )
    open_ = np.ones(len(before), bool)
    open_[radial_terms:_RADIAL] = False
    open_[_RADIAL + 2 : _RADIAL + 2 + _NAMED] = named
    open_[_RADIAL + 2 + _NAMED :] = free
    args = (
        lens,
        jnp.asarray(samples.undistorted_mm),
        jnp.asarray(samples.distorted_mm / samples.frame.pitch_mm),
        jnp.asarray(samples.frame.pitch_mm),
    )

    def whole(change: np.ndarray) -> Array:
        filled = before.copy()
        filled[open_] += change
        return jnp.asarray(filled)

    def off_px(change: np.ndarray) -> np.ndarray:
        return np.asarray(_off_px(whole(change), *args))

    def slope_px(change: np.ndarray) -> np.ndarray:
        return np.asarray(_slope_px(whole(change), *args))[:, open_]

    # The first trust radius is the size of the start, and 1 where that is exactly
    # nothing: a start of mere rounding would end the search before it began. Changes
    # are fitted, therefore, whose unit makes up for the whole difference.
    unchanged = np.zeros(int(open_.sum()))
    found = least_squares(
        off_px,
        unchanged,
        jac=slope_px,  # pyright: ignore[reportArgumentType]
        x_scale=_unit_changes(off_px(unchanged), slope_px(unchanged)),
        xtol=1e-11,
        ftol=1e-11,
        gtol=1e-11,
        max_nfev=_MOST_STEPS,
    )
    worst = float(np.linalg.norm(found.fun.reshape(-1, 2), axis=-1).max())
    return _Candidate(_with_values(whole(found.x), lens), worst)


def _unit_changes(off: np.ndarray, slope: np.ndarray) -> np.ndarray:
    """Of each value, the change that moves the samples by as much as they are off."""
    sizes = np.linalg.norm(slope, axis=0)
    known = (sizes > 0) & bool(off.any())
    return np.where(known, np.linalg.norm(off) / np.where(sizes > 0, sizes, 1.0), 1.0)


def _with_values(values: Float[Array, " values"], lens: Distortion) -> Distortion:
    ends = np.cumsum([_RADIAL, 2, _NAMED]).tolist()
    radial, squeeze, named, free = jnp.split(values, ends)
    return replace(
        lens, radial=radial, squeeze=squeeze, named=named, free=free.reshape(2, -1)
    )


_landed_mm = jax.jit(jax.vmap(chief_ray.distorted_from_undistorted, (0, None)))
_unsqueezed_mm = jax.jit(jax.vmap(chief_ray.on_sensor_mm, (0, None)))


def _off(values: Array, lens: Distortion, u: Array, target_px: Array, pitch: Array):
    made = _with_values(values, lens)
    landed = _landed_mm(u, made)
    return (landed / pitch - target_px).ravel()


_off_px = jax.jit(_off)
_slope_px = jax.jit(jax.jacfwd(_off))


def _tidy(lens: Distortion) -> Distortion:
    """Without coefficients that are nothing but rounding."""

    def clean(values: Array) -> Array:
        known = np.asarray(values)
        return jnp.asarray(np.where(np.abs(known) < 1e-15, 0.0, known))

    lens = replace(
        lens,
        radial=clean(lens.radial),
        named=clean(lens.named),
        squeeze=clean(lens.squeeze),
        free=clean(lens.free),
    )
    return chief_ray.without_idle_degrees(lens)
