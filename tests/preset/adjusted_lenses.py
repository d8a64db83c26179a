"""A measured lens and an ideal one, turned by knobs, for tests of what these do."""

from typing import Any

import jax
import jax.numpy as jnp
import msgspec
import numpy as np
from preset_makers import make_blur, make_entry, make_preset

from lensfit.lens import Lens
from lensfit.optics.aberration import landing_and_jacobian_mm, local_wavefront
from lensfit.preset.blocks import (
    AberrationTerm,
    ChannelShift,
    Distortion,
    LateralColour,
    Projection,
    Pupil,
    Rim,
)
from lensfit.preset.knobs import NEUTRAL, adjusted_knobs
from lensfit.preset.thin_lens import ThinCamera, thin_lens_preset

CORNER_MM = float(np.hypot(24.89, 18.6675)) / 2
FOCUS_MM = 2000.0
FOCAL_TERMS = (
    AberrationTerm(2, 0, 0, 0, "re", 2.0, (3.0, -1.0)),
    AberrationTerm(2, 0, 2, 0, "re", 9.0, (1.5,)),
    AberrationTerm(2, 0, 4, 0, "re", -4.0),
    AberrationTerm(2, 2, 2, 2, "re", 6.0, (0.5,)),
    AberrationTerm(2, 2, 4, 2, "re", -3.0),
    AberrationTerm(2, 2, 6, 2, "re", 1.0),
)
TERMS = (
    *FOCAL_TERMS,
    AberrationTerm(3, 1, 1, 1, "re", -4.0, (0.7,)),
    AberrationTerm(3, 1, 3, 1, "re", 1.5),
    AberrationTerm(5, 1, 1, 1, "re", 0.5),
    AberrationTerm(4, 0, 0, 0, "re", 3.0, (0.5, 0.1)),
    AberrationTerm(6, 0, 0, 0, "re", -1.0),
    AberrationTerm(3, 3, 3, 3, "re", 2.0),
    AberrationTerm(4, 2, 2, 2, "re", -1.0),
)
RIMS = (Rim((0.45, 0.1), (1.1, 0.0)), Rim((-0.5, 0.0), (1.15, 0.02)))


def measured_preset(*terms: AberrationTerm, **changes: Any):
    """Centred, of these terms (or all of `TERMS`), with rims that clip its corners."""
    blur = make_blur(
        aberrations=terms or TERMS,
        pupil=Pupil(RIMS, (0.01, 0.002), (-0.08, 0.01), (-0.03, 0.005)),
    )
    entry = make_entry(
        **(
            {
                "projection": Projection(51.3, (0.0, 0.0), 60.0),
                "distortion": Distortion(
                    "rectilinear",
                    15.6,
                    1.02,
                    (-0.8, -0.6, 0.8, 0.6),
                    radial_log_slope=(-0.06, 0.02),
                    decentering=(1e-4, -2e-4),
                ),
                "lateral_colour": LateralColour(
                    ChannelShift((1e-4, -3e-4), (1e-4, 0.0), 1.02),
                    ChannelShift((-2e-4,), (0.001, 0.0), 1.02),
                ),
                "blur": blur,
            }
            | changes
        )
    )
    return make_preset(entry)


def measured(preset=None, f_number: float = 1.4, **knobs: Any) -> Lens:
    """The measured lens as it was turned."""
    chosen = preset or measured_preset()
    return chosen.at(50.0, f_number, knobs=adjusted_knobs(NEUTRAL, knobs))


def ideal(f_number: float = 2.0, **knobs: Any) -> Lens:
    """A thin lens as it was turned, focused at 2 m."""
    camera = ThinCamera(50.0, f_number, FOCUS_MM / 1000, 24.89, 2048, 1536)
    preset = thin_lens_preset(camera)
    return preset.at(50.0, f_number, FOCUS_MM, knobs=adjusted_knobs(NEUTRAL, knobs))


def plain(preset, **changes: Any):
    """A preset whose blur has other blocks."""
    entry = preset.entries[0]
    blur = msgspec.structs.replace(entry.blur, **changes)
    return make_preset(msgspec.structs.replace(entry, blur=blur))


def landings_um(lens: Lens, h, u, chromatic: float = 0.0) -> np.ndarray:
    """Where rays through pupil points land by aberrations alone, (rays, 2)."""
    found = _landed(
        jnp.asarray(h, float),
        jnp.asarray(u, float),
        jnp.asarray(chromatic, float),
        lens.blur.aberration,
    )
    return 1e3 * np.asarray(found)


@jax.jit
def _landed(h, u, chromatic, aberration):
    local = local_wavefront(h * aberration.field_radius_mm, chromatic, aberration)
    landed = jax.vmap(landing_and_jacobian_mm, (0, None, None))
    return landed(u, jnp.zeros(()), local)[0]


def focal_surfaces_um(lens: Lens, radius: float, chromatic: float = 0.0):
    """Tangential and sagittal focus at a field radius, as slopes of narrow fans."""
    step = 1e-5
    found = landings_um(lens, (radius, 0), [(step, 0), (0, step)], chromatic) / step
    return found[0, 0], found[1, 1]


def disc_points(rings: int = 40, spokes: int = 48) -> np.ndarray:
    """An even filling of the unit disc."""
    radius = np.sqrt((np.arange(rings) + 0.5) / rings)
    azimuth = (np.arange(spokes) + 0.5) * (2 * np.pi / spokes)
    grid = radius[:, None] * np.exp(1j * azimuth)
    return np.stack([grid.real.ravel(), grid.imag.ravel()], -1)


def rms_spot_um(lens: Lens, h) -> float:
    """Radius about the centroid, over the widest opening."""
    landed = landings_um(lens, h, disc_points())
    away = landed - landed.mean(0)
    return float(np.sqrt((away**2).sum(1).mean()))
