"""A fast, badly corrected, strongly clipping lens for the kernel's tests."""

from dataclasses import replace

import jax.numpy as jnp
import numpy as np

from lensfit.kernel.spot import Blur
from lensfit.optics.aberration import no_aberration
from lensfit.optics.pupil import clear_pupil
from lensfit.optics.spectrum import bands, chromatic_coordinate
from lensfit.optics.terms import rotational_terms

ONE = jnp.asarray(1.0)
CHROMATIC = chromatic_coordinate(bands(3).wavelengths_nm)[1]
NO_LATERAL = jnp.zeros((3, 2))
TERMS = rotational_terms(7)
COLOURS = rotational_terms(3)


def blurred_lens(seed: int = 0, size_um: float = 6.0) -> Blur:
    """f/1.4 over a field of 15 mm radius."""
    rng = np.random.default_rng(seed)
    empty = no_aberration(
        TERMS, COLOURS, field_radius_mm=15.0, f_number=1.4, exit_pupil_distance_mm=80.0
    )
    aberration = replace(
        empty,
        coefficients_um=jnp.asarray(rng.normal(0, size_um, len(TERMS))),
        colour_um=jnp.asarray(rng.normal(0, size_um / 4, (2, len(COLOURS)))),
    )
    pupil = replace(
        clear_pupil(2),
        rim_shift=jnp.array([[0.5, 0.1], [-0.5, 0.0]]),
        rim_radius=jnp.array([[1.1, 0.0], [1.2, 0.0]]),
        stretch=jnp.array([[-0.1, 0.0], [-0.03, 0.0]]),
    )
    return Blur(aberration, pupil)
