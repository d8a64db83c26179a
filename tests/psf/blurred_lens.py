"""A fast, badly corrected, strongly clipping lens for the kernel's tests."""

from dataclasses import replace
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np

from lensfit.optics.aberration import Aberration, no_aberration
from lensfit.optics.pupil import Pupil, clear_pupil
from lensfit.optics.pupil_nodes import pupil_nodes
from lensfit.optics.spectrum import bands, chromatic_coordinate
from lensfit.optics.terms import rotational_terms
from lensfit.psf.spot import Spot, landed_rays, split_by_wavelength, spot_of

ONE = jnp.asarray(1.0)
CHROMATIC = chromatic_coordinate(bands(3).wavelengths_nm)[1]
NO_LATERAL = jnp.zeros((3, 2))
TERMS = rotational_terms(7)
COLOURS = rotational_terms(3)


class Blur(NamedTuple):
    """What makes the blur of a lens."""

    aberration: Aberration
    pupil: Pupil


class Moments(NamedTuple):
    """Mean and covariance of a spot's light."""

    centroid_mm: jnp.ndarray
    covariance_mm2: jnp.ndarray


def spot_at(
    field, blur: Blur, dz, rays: int, stop=ONE, chromatic=CHROMATIC, lateral=NO_LATERAL
) -> Spot:
    """The spot of a field point, mm from the axis; rays a multiple of wavelengths."""
    aberration = blur.aberration
    count = -(-rays // len(chromatic)) * len(chromatic)
    nodes = pupil_nodes(field / aberration.field_radius_mm, stop, blur.pupil, count)
    u = split_by_wavelength(nodes.u, len(chromatic))
    landed = landed_rays(u, field, aberration, dz, chromatic)
    return spot_of(landed, nodes, lateral)


def moments(spot: Spot) -> Moments:
    """The cells' own size included: a round cell of unit area has 1/(4 pi) of it."""
    centroid = spot.weight @ spot.landing_mm
    away = spot.landing_mm - centroid[None]
    covariance = jnp.einsum("k,ki,kj->ij", spot.weight, away, away)
    own = spot.weight @ spot.cell_mm2 / (4 * np.pi)
    return Moments(centroid, covariance + own * jnp.eye(2))


def perfect(blur: Blur) -> Blur:
    """The same aperture without aberrations and rims."""
    zero = replace(
        blur.aberration,
        coefficients_um=jnp.zeros_like(blur.aberration.coefficients_um),
        colour_um=jnp.zeros_like(blur.aberration.colour_um),
    )
    return Blur(zero, clear_pupil())


def blurred_lens(seed: int = 0, size_um: float = 6.0, terms=TERMS) -> Blur:
    """f/1.4 over a field of 15 mm radius."""
    rng = np.random.default_rng(seed)
    empty = no_aberration(
        terms, COLOURS, field_radius_mm=15.0, f_number=1.4, exit_pupil_distance_mm=80.0
    )
    aberration = replace(
        empty,
        coefficients_um=jnp.asarray(rng.normal(0, size_um, len(terms))),
        colour_um=jnp.asarray(rng.normal(0, size_um / 4, (2, len(COLOURS)))),
    )
    pupil = replace(
        clear_pupil(2),
        rim_shift=jnp.array([[0.5, 0.1], [-0.5, 0.0]]),
        rim_radius=jnp.array([[1.1, 0.0], [1.2, 0.0]]),
        stretch=jnp.array([[-0.1, 0.0], [-0.03, 0.0]]),
    )
    return Blur(aberration, pupil)
