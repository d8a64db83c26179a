"""Bands and the chromatic coordinate."""

import jax.numpy as jnp
import numpy as np
import pytest

from data_synth.glass import glass_from_abbe
from lensfit.optics.spectrum import bands, chromatic_coordinate, lateral_at


@pytest.mark.parametrize("nodes", [2, 3])
def test_bands_keep_mean_and_width(nodes: int):
    wavelengths = np.asarray(bands(nodes).wavelengths_nm)
    np.testing.assert_allclose(wavelengths.mean(axis=1), [610, 540, 460])
    np.testing.assert_allclose(wavelengths.std(axis=1), 26)


def test_the_refractive_index_is_a_parabola_in_the_coordinate():
    glass = glass_from_abbe(1.80416, 46.6)
    wavelengths = np.linspace(430, 650, 40)
    index = np.array([glass.refractive_index(float(w)) for w in wavelengths])
    w = np.asarray(chromatic_coordinate(jnp.asarray(wavelengths)))
    linear, parabola = (index - np.polyval(np.polyfit(w, index, n), w) for n in (1, 2))
    spread = np.ptp(index)
    assert np.abs(parabola).max() < 0.004 * spread
    assert np.abs(linear).max() < 0.04 * spread


def test_lateral_colour_passes_through_the_channels():
    means = chromatic_coordinate(jnp.array([610.0, 540.0, 460.0]))
    red, blue = jnp.array([0.003, 0.001]), jnp.array([-0.002, 0.004])
    at = lateral_at(means, red, blue, means)
    np.testing.assert_allclose(at, jnp.stack([red, jnp.zeros(2), blue]), atol=1e-18)
