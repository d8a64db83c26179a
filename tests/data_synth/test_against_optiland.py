"""The tracer against optiland, ray by ray: two codes that share nothing agree.

Every medium is given to optiland as a constant index at the traced wavelength, so that
the comparison is one of geometry and refraction (1e-9 mm is asked, 1e-12 met); the
dispersion formula of a Sellmeier glass is compared by itself.
"""

import math

import numpy as np
import pytest

from data_synth.glass import glass_from_sellmeier
from data_synth.lens import set_lens
from data_synth.prescription import load_prescription, prescription_names

pytest.importorskip("optiland")
# optiland uses features that its own dependencies deprecate.
pytestmark = pytest.mark.filterwarnings("ignore")

FOCUS_MM = 1500.0


def optiland_landing(surfaces, origin_mm, direction, wavelength_nm):
    """Landing points on the sensor plane by optiland."""
    from optiland.materials import IdealMaterial
    from optiland.optic import Optic
    from optiland.rays import RealRays

    optic = Optic()
    optic.add_surface(index=0, radius=math.inf, thickness=100.0)
    for number, surface in enumerate(surfaces, start=1):
        optic.add_surface(
            index=number,
            thickness=surface.thickness_mm,
            material=IdealMaterial(surface.glass.refractive_index(wavelength_nm)),
            is_stop=surface.is_stop,
            **optiland_shape(surface),
        )
    optic.add_surface(index=len(surfaces) + 1)
    optic.add_wavelength(value=wavelength_nm * 1e-3, is_primary=True)
    front_z_mm = -sum(surface.thickness_mm for surface in surfaces)
    start = origin_mm - np.array([0.0, 0.0, front_z_mm])
    rays = RealRays(
        *start.T, *direction.T, np.ones(len(start)), np.full(len(start), 0.5)
    )
    for surface in list(optic.surface_group.surfaces)[1:]:
        surface.trace(rays)
    return np.stack([rays.x, rays.y], -1)


def optiland_shape(surface) -> dict:
    """A surface's shape in optiland's terms."""
    if surface.is_toric:
        x, y = (
            1.0 / c if c else math.inf
            for c in (surface.curvature_x_per_mm, surface.curvature_y_per_mm)
        )
        return {"surface_type": "toroidal", "radius_x": x, "radius_y": y, "tol": 1e-13}
    curvature = surface.curvature_x_per_mm
    shape = {
        "radius": 1.0 / curvature if curvature else math.inf,
        "conic": surface.conic,
    }
    if surface.even_coefficients:
        shape |= {
            "surface_type": "even_asphere",
            "coefficients": [0.0, *surface.even_coefficients],
            "tol": 1e-13,
        }
    return shape


def bundles(lens):
    """Rays from points on and off the axis, spread over the entrance pupil."""
    half = np.array(lens.prescription.sensor_size_mm) / 2
    scale = FOCUS_MM / lens.focal_length_mm
    fields = np.array([[0.0, 0.0], [0.5, 0.0], [0.0, -0.7], [0.8, 0.7]]) * half * scale
    pupil = np.random.default_rng(3).uniform(-0.6, 0.6, (40, 2)) * lens.pupil_radius_mm
    target = np.column_stack([pupil, np.full(len(pupil), lens.pupil_z_mm)])
    origins, directions = [], []
    for field in fields:
        direction = target - np.array([*field, -FOCUS_MM])
        origins.append(target)
        directions.append(direction / np.linalg.norm(direction, axis=1, keepdims=True))
    # Both codes start where the rays cross the front vertex plane: no digits are lost.
    origin, direction = np.concatenate(origins), np.concatenate(directions)
    front = -sum(surface.thickness_mm for surface in lens.surfaces)
    advance = (front - 5.0 - origin[:, 2]) / direction[:, 2]
    return origin + advance[:, None] * direction, direction


@pytest.mark.parametrize("wavelength_nm", [460.0, 546.07, 640.0])
@pytest.mark.parametrize("name", prescription_names())
def test_landing_points_agree(name, wavelength_nm):
    lens = set_lens(load_prescription(name), focus_distance_mm=FOCUS_MM)
    origin, direction = bundles(lens)
    ours = lens.trace(origin, direction, wavelength_nm).landing_mm
    theirs = optiland_landing(lens.surfaces, origin, direction, wavelength_nm)
    both = np.isfinite(ours).all(axis=1) & np.isfinite(theirs).all(axis=1)
    assert both.sum() > 100
    assert np.isfinite(ours).all(axis=1).sum() == both.sum()
    assert np.abs(ours - theirs)[both].max() < 1e-9


def test_sellmeier_index_agrees():
    from optiland.materials import Material

    theirs = Material("N-SK16", reference="schott")
    ours = glass_from_sellmeier(
        (1.34317774, 0.00704687339, 0.241144399, 0.0229005, 0.994317969, 92.7508526)
    )
    for wavelength_nm in (435.8, 546.07, 656.3):
        assert ours.refractive_index(wavelength_nm) == pytest.approx(
            float(np.squeeze(theirs.n(wavelength_nm * 1e-3))), abs=2e-6
        )
