"""Lateral colour and fall-off of lensfit fitted to another program's."""

from collections.abc import Callable

import numpy as np
from jaxtyping import Float
from scipy.optimize import nnls

from lensfit.fitting.exchange.samples import ExchangeFrame, Residual, residual_from
from lensfit.optics.bernstein import bernstein
from lensfit.optics.distortion import Distortion
from lensfit.preset import blocks
from lensfit.preset.exchange.foreign import Points

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
