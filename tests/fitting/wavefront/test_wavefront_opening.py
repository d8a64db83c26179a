"""The pupil's width from distances, and the same spots by another pupil."""

import jax.numpy as jnp
import numpy as np
import pytest
from drawn_lens import LAYOUT, SCALE, Seidel, dots_at

from lensfit.fitting.wavefront.opening import of_opening, ratio_of
from lensfit.fitting.wavefront.rays import spot_and_pullback
from lensfit.fitting.wavefront.shapes import Colour

STATED_MM = np.array([0.0, -0.9, 0.7])
DEVIATION_MM = np.array([0.004, 0.006, 0.005])


@pytest.mark.parametrize("ratio", [0.93, 1.0, 1.07])
def test_a_share_that_all_defocus_has_is_the_pupil(ratio):
    fitted_mm = 0.08 + STATED_MM / ratio
    found = ratio_of(fitted_mm, STATED_MM, DEVIATION_MM, 0.05)
    assert found == pytest.approx(ratio, abs=3e-3)


def test_what_distances_do_not_tell_the_f_number_does():
    """One focus distance is as well a focus scale that is off."""
    found = ratio_of(np.array([0.95]), np.array([0.9]), np.array([0.005]), 0.05)
    assert found == pytest.approx(1, abs=0.002)
    assert ratio_of(np.array([0.1]), np.zeros(1), np.ones(1), 0.05) == 1.0


def test_a_distance_that_is_mistaken_opens_no_lens_beyond_bounds():
    found = ratio_of(2 * STATED_MM, STATED_MM, DEVIATION_MM, 0.05)
    assert found == 0.8


@pytest.mark.parametrize(
    "lens",
    [Seidel(coma_um=6.0), Seidel(spherical_um=4.0), Seidel(defocus_mm=(0.05, 0, 0))],
    ids=["coma", "spherical", "defocus"],
)
def test_a_wider_pupil_draws_the_same_spot(lens):
    """To first order in the squared direction cosine, which is .06 at the rim."""
    dot = dots_at(np.array([[9.0, 5.0]]), 0, 0, 0.01)
    dot = type(dot)(*(None if part is None else jnp.asarray(part[0]) for part in dot))
    grey = Colour(jnp.zeros(1), jnp.zeros((1, 2)))
    spots = []
    for ratio in (1.0, 1.02):
        scale = SCALE._replace(reference_sine=ratio * SCALE.reference_sine)
        numbers = jnp.asarray(of_opening(lens.parameters(), LAYOUT, ratio))
        spots.append(spot_and_pullback(numbers, dot, grey, LAYOUT, scale, 192)[0])
    still, wider = (np.asarray(one.landing_mm) for one in spots)
    np.testing.assert_allclose(wider, still, atol=6e-3 * np.abs(still).max())
