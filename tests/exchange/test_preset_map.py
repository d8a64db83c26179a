"""lensfit's terms fitted to a map: a start of mere rounding is as good as nothing."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from lensfit.exchange.lensfun import LensfunMap
from lensfit.exchange.preset_map import fit_distortion, residual_without_fit
from lensfit.exchange.samples import ExchangeFrame, Samples
from lensfit.optics import distortion as chief_ray

FRAME = ExchangeFrame((320, 240), 24.0, 10.0)
CENTRE_MM = (0.0, 0.0)
DISTANCE_MM = 35.0


def barrel(stretch: float) -> Samples:
    """A round lens whose slope is stretched, at each point, by rounding or by none."""
    lens = LensfunMap("poly5", (-0.08, 0.01), 9.0, CENTRE_MM)
    samples = Samples.of(lens, FRAME)
    axis = int(np.linalg.norm(samples.distorted_mm, axis=-1).argmin())
    slope = samples.slope.copy()
    slope[axis] = np.diag([1.0 + stretch, 1.0])
    return replace(samples, slope=slope)


@pytest.mark.slow
@pytest.mark.parametrize("stretch", [0.0, 2.3e-16, 4.5e-16, 1e-12])
def test_a_squeeze_of_mere_rounding_does_not_end_the_fit(stretch: float):
    """The first trust radius must not be as small as the start."""
    samples = barrel(stretch)
    assert residual_without_fit(samples, DISTANCE_MM, CENTRE_MM).worst_px > 5
    lens = fit_distortion(samples, DISTANCE_MM, CENTRE_MM)
    land = jax.vmap(chief_ray.distorted_from_undistorted, (0, None))
    landed = np.asarray(land(jnp.asarray(samples.undistorted_mm), lens))
    off_px = (landed - samples.distorted_mm) / FRAME.pitch_mm
    assert np.linalg.norm(off_px, axis=-1).max() < 1e-3
    assert np.abs(np.asarray(lens.squeeze)).max() < 1e-6
