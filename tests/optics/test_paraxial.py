"""First-order laws: Newton, the thin lens as a limit, and traced lenses."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from data_synth.lens import REFERENCE_NM, set_lens
from data_synth.paraxial import first_order
from data_synth.prescription import load_prescription
from lensfit.optics.paraxial import (
    FirstOrder,
    defocus_mm,
    exit_pupil_distance_mm,
    first_order_of,
    magnification,
    rim_sine,
)


def lens(f=50.0, pupil=1.0, offset=52.0):
    return FirstOrder(jnp.asarray(f), jnp.asarray(pupil), jnp.asarray(offset))


def test_a_thin_lens_blurs_by_the_textbook():
    """|S2 - S1| / S2 f^2 / (N (S1 - f)), distances from the lens, pupil in it."""
    f, s1, s2, n = 50.0, 2000.0, 3100.0, jnp.asarray(2.0)
    v = f * s1 / (s1 - f)
    thin = lens(f, 1.0, v)
    behind = defocus_mm(thin, jnp.asarray(s1 + v), jnp.asarray(s2 + v))
    diameter = 2 * rim_sine(thin, n, jnp.asarray(s2 + v)) * behind
    wanted = (s2 - s1) / s2 * f**2 / (float(n) * (s1 - f))
    np.testing.assert_allclose(diameter, wanted, rtol=1e-12)


def test_defocus_is_signed_and_finite_at_infinity():
    far = jnp.asarray(jnp.inf)
    near = jnp.asarray(1000.0)
    assert defocus_mm(lens(), near, far) > 0
    assert defocus_mm(lens(), far, near) < 0
    assert defocus_mm(lens(), far, far) == 0
    slope = jax.grad(defocus_mm, (0, 1, 2))(lens(), near, far)
    assert all(jnp.isfinite(leaf).all() for leaf in jax.tree.leaves(slope))


@pytest.mark.parametrize(
    "name", ["biotar_50", "petzval_50", "nikkor_28", "kreitzer_135", "itoh_zoom"]
)
def test_exit_pupil_and_focal_length_follow_from_the_pupil_magnification(name: str):
    """The traced lens is focused by its smallest spot, hence the tolerance."""
    prescription = load_prescription(name)
    distance = 40 * prescription.states[0].focal_length_mm
    surfaces = set_lens(prescription, focus_distance_mm=distance).surfaces
    data = first_order(surfaces, REFERENCE_NM)
    offset = -data.entrance_pupil_z_mm
    pupil = data.exit_pupil_magnification / data.entrance_pupil_magnification
    ours = lens(data.focal_length_mm, pupil, offset)
    at = jnp.asarray(distance)
    traced = -data.exit_pupil_z_mm
    np.testing.assert_allclose(exit_pupil_distance_mm(ours, at), traced, rtol=6e-3)
    size = -magnification(ours, at)
    principal = size * (distance - offset)
    np.testing.assert_allclose(
        first_order_of(
            principal, jnp.asarray(pupil), jnp.asarray(offset), at
        ).focal_length_mm,
        data.focal_length_mm,
        rtol=1e-12,
    )
