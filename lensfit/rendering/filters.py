"""Interpolating filters of the warp, with their cost and error.

RMS error of a shifted sine of unit amplitude, by its frequency in cycles/px:

    filter        taps   0.05     0.1      0.2      0.3      0.4     order
    linear           4   9.0e-3   3.6e-2   1.4e-1   3.0e-1   5.0e-1    2
    cv2 cubic       16   1.1e-2   2.2e-2   1.7e-2   8.9e-2   3.4e-1    1
    cubic           16   3.4e-3   1.2e-2   3.3e-2   1.3e-1   3.7e-1    2
    catmull-rom     16   3.9e-4   3.7e-3   4.0e-2   1.6e-1   3.9e-1    3
    keys-6          36   2.0e-5   4.7e-4   1.4e-2   9.8e-2   3.3e-1    4
    lanczos3        36   3.8e-3   4.4e-3   1.7e-2   1.6e-2   2.5e-1    0
    sinc-16        256   4.5e-4   1.3e-4   6.9e-4   2.3e-3   5.7e-3    2
    spline          16+  1.7e-5   2.9e-4   6.3e-3   4.9e-2   2.4e-1    4

OpenCV's cubic (a = -0.75) does not reproduce a ramp; `cubic` is the same kernel, read
at the fraction where it does, so that OpenCV can do the work
(`resample.remapped_pixels`). On a picture with a natural spectrum (amplitude as 1/f) it
is as good as catmull-rom; on a smooth picture the others are better. A prefiltered
cubic spline is the most accurate for its taps, but its prefilter rings over a dozen
pixels, which a highlight of a thousand times its surroundings makes visible. All
filters here have compact support and leave sample positions untouched, and catmull-rom
and keys-6 reproduce quadratics and cubics. sinc-16 is the sinc under a Hann window,
which is long enough to keep what lies close to the sampling limit, reproduces a ramp
and reads sixteen times the samples: for pictures that are warped there and back
(`lensfit undistort`, then `lensfit apply`).

Reference: R. G. Keys, IEEE Trans. ASSP 29 (1981) 1153-1160.
"""

import math
from collections.abc import Callable
from typing import Literal, NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float

Filter = Literal["cubic", "catmull-rom", "keys-6", "sinc-16"]

Plane = Float[Array, "height width"]


def tap_weights(name: Filter, fraction: Plane) -> list[Plane]:
    """Weights of the taps at `first_tap(name)`, + 1, ... for a fraction in [0, 1)."""
    return _KERNELS[name].weights(fraction)


def first_tap(name: Filter) -> int:
    """Offset of the first tap from the sample at or below the position."""
    return 1 - _KERNELS[name].reach


def longest_reach() -> int:
    """How many samples beside a position the longest filter reads."""
    return max(kernel.reach for kernel in _KERNELS.values())


def filter_for(tolerance: float) -> Filter:
    """The cheapest filter for an error of the picture, rms, display-referred.

    Measured on shifted pictures (standard deviation .18) whose amplitude falls as 1/f,
    blurred as a lens and its sensor would (to 1/e at .2 cycles/px), or free of detail
    finer than ten pixels; the last column is the unblurred 1/f itself:

        filter        blurred   smooth    1/f
        cv2 cubic      1.8e-3   1.7e-3   1.7e-2
        cubic          1.1e-3   6.5e-4   1.9e-2
        catmull-rom    9.7e-4   1.2e-4   2.0e-2
        keys-6         4.5e-4   1.3e-5   1.7e-2
    """
    if tolerance >= _CUBIC_TOLERANCE:
        return "cubic"
    return "catmull-rom" if tolerance >= _CATMULL_ROM_TOLERANCE else "keys-6"


_CUBIC_TOLERANCE, _CATMULL_ROM_TOLERANCE = 1e-3, 5e-4


def ramp_fraction(fraction: Plane) -> Plane:
    """Where OpenCV's cubic kernel must be read to return `fraction` from a ramp.

    Its ramp is s + s (1 - s)(1 - 2 s)/2; with u = s - 1/2 that is the cubic equation
    u^3 + 3/4 u = t - 1/2, solved by sinh(3 x) = 4 sinh(x)^3 + 3 sinh(x).
    """
    return 0.5 + jnp.sinh(jnp.arcsinh(4 * fraction - 2) / 3)


class _Kernel(NamedTuple):
    """A filter.

    Attributes
    ----------
    reach : Taps on either side of a position.
    weights : Of all taps in order, for a fraction in [0, 1).
    """

    reach: int
    weights: Callable[[Plane], list[Plane]]


def _piecewise_kernel(*pieces: Callable[[Plane], Plane]) -> _Kernel:
    """An even kernel given by a polynomial of the distance on every unit of it."""
    reach = len(pieces)

    def weights(fraction: Plane) -> list[Plane]:
        below = [pieces[k](fraction + k) for k in range(reach - 1, -1, -1)]
        above = [pieces[k]((1 - fraction) + k) for k in range(reach)]
        return below + above

    return _Kernel(reach, weights)


def _exact_on_ramps(kernel: _Kernel) -> _Kernel:
    """OpenCV's kernel, read where it reproduces a ramp."""
    return kernel._replace(weights=lambda t: kernel.weights(ramp_fraction(t)))


def _sinc_weights(fraction: Plane) -> list[Plane]:
    """Of all taps at once: at a distance of t - k the sine of the sinc is that of t but
    for its sign, and the cosine of the window follows from one sine and one cosine."""
    reach = _SINC_REACH
    sine = jnp.sin(jnp.pi * fraction) / (2 * jnp.pi)
    slow_sine, slow_cosine = (f(jnp.pi / reach * fraction) for f in (jnp.sin, jnp.cos))
    weights = []
    for tap in range(1 - reach, reach + 1):
        distance = fraction - tap
        turn = math.pi * tap / reach
        window = 1 + slow_cosine * math.cos(turn) + slow_sine * math.sin(turn)
        there = jnp.abs(distance) < _ON_TAP
        read = (-1) ** tap * sine * window / jnp.where(there, 1, distance)
        weights.append(jnp.where(there, 1, read))
    total = sum(weights[1:], weights[0])
    return [weight / total for weight in weights]


_SINC_REACH = 8
_ON_TAP = 1e-4
"""Nearer to a sample its weight is 1 to float32's resolution."""


def _opencv_inner(x: Plane) -> Plane:
    return (1.25 * x - 2.25) * x * x + 1


def _opencv_outer(x: Plane) -> Plane:
    return ((3.75 - 0.75 * x) * x - 6) * x + 3


def _catmull_rom_inner(x: Plane) -> Plane:
    return (1.5 * x - 2.5) * x * x + 1


def _catmull_rom_outer(x: Plane) -> Plane:
    return ((2.5 - 0.5 * x) * x - 4) * x + 2


def _keys6_inner(x: Plane) -> Plane:
    return (4 / 3 * x - 7 / 3) * x * x + 1


def _keys6_middle(x: Plane) -> Plane:
    return ((3 - 7 / 12 * x) * x - 59 / 12) * x + 2.5


def _keys6_outer(x: Plane) -> Plane:
    return ((x / 12 - 2 / 3) * x + 1.75) * x - 1.5


_KERNELS: dict[Filter, _Kernel] = {
    "cubic": _exact_on_ramps(_piecewise_kernel(_opencv_inner, _opencv_outer)),
    "catmull-rom": _piecewise_kernel(_catmull_rom_inner, _catmull_rom_outer),
    "keys-6": _piecewise_kernel(_keys6_inner, _keys6_middle, _keys6_outer),
    "sinc-16": _Kernel(_SINC_REACH, _sinc_weights),
}
