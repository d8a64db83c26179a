"""The spot of one dot: a handful of rays, each with its weight and its width.

Rays fill the opening of the pupil evenly (`optics.pupil`), each standing for a cell of
equal area. The image of a cell is stood for by a round Gaussian of the variance

    kappa A/M |dx/du|^2 / 2,

with A/M the area of a cell: it goes to 0 in focus and at a caustic without singularity,
and the spot's second moment converges like 1/M. Wavelengths are dealt to the rays in
turn when `deal` is set, and so are points of the hole: one set of M rays samples pupil,
band and hole together, as a photograph does, instead of every combination.

Every function takes one dot; callers map it over many with `jax.vmap`.

Reference: P. S. Heckbert, Fundamentals of Texture Mapping and Image Warping (1989), for
elliptical weighted averages; here the footprint's trace is enough.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from lensfit.optics.aberration import (
    Aberration,
    landing_and_jacobian_mm,
    local_wavefront,
)
from lensfit.optics.depth import ObjectShift
from lensfit.optics.pupil import SHARPNESS, Pupil, PupilNodes, pupil_nodes

FOOTPRINT = 0.16
"""kappa: the width of a cell's Gaussian, 0.4 of the spacing of the rays."""
CELL_VARIANCE = 1 / (4 * np.pi)
"""Variance of a round cell of unit area along one axis."""
_PLASTIC = (0.7548776662466927, 0.5698402909980532)


class Blur(eqx.Module):
    """What makes the blur of a lens at one zoom and focus setting."""

    aberration: Aberration
    pupil: Pupil


class Spot(eqx.Module):
    """Rays on the sensor.

    Attributes
    ----------
    landing_mm : From where the green chief ray lands, x right, y down.
    weight : Share of the light, sums to 1.
    cell_mm2 : Area of each ray's cell times |dx/du|^2 / 2: variance per unit kappa.
    """

    landing_mm: Float[Array, "rays 2"]
    weight: Float[Array, " rays"]
    cell_mm2: Float[Array, " rays"]


class Moments(eqx.Module):
    """Light, mean and covariance of a spot."""

    centroid_mm: Float[Array, "2"]
    covariance_mm2: Float[Array, "2 2"]


def field_point(
    field_point_mm: Float[Array, "2"], aberration: Aberration
) -> Float[Array, "2"]:
    """The field point in field radii, as the pupil wants it."""
    return field_point_mm / aberration.field_radius_mm


def spot(
    field_point_mm: Float[Array, "2"],
    nodes: PupilNodes,
    aberration: Aberration,
    defocus_mm: Float[Array, ""],
    chromatic: Float[Array, " wavelengths"],
    lateral_mm: Float[Array, "wavelengths 2"],
    *,
    depth: ObjectShift | None = None,
    deal: bool = True,
) -> Spot:
    """Where the rays of one point of the scene land.

    Parameters
    ----------
    field_point_mm : Where its green chief ray lands, from the principal point.
    nodes : `optics.pupil.pupil_nodes` of this field point.
    defocus_mm : How far the sensor lies behind the sharp image.
    chromatic : Wavelengths of equal weight (`optics.spectrum`).
    lateral_mm : Displacement of each wavelength's chief ray against green's.
    depth : Where the object is not at the distance that the aberrations hold for.
    deal : One wavelength for each ray, in turn; otherwise all for each.
    """
    per_wavelength = jax.vmap(local_wavefront, (None, 0, None, None))
    local = per_wavelength(field_point_mm, chromatic, aberration, depth)
    count, wavelengths = nodes.u.shape[0], chromatic.shape[0]

    def all_rays(u, one, lateral):
        landed, slope = jax.vmap(landing_and_jacobian_mm, (0, None, None))(
            u, defocus_mm, one
        )
        return landed + lateral[None], jnp.sum(slope**2, (-2, -1)) / 2

    cell_area = nodes.weight * nodes.area
    if deal and wavelengths > 1:
        dealt = _dealt(count, wavelengths)
        landed, size = jax.vmap(all_rays)(nodes.u[dealt], local, lateral_mm)
        order = np.argsort(dealt.reshape(-1))
        landed, size = landed.reshape(-1, 2)[order], size.reshape(-1)[order]
        return Spot(landed, nodes.weight, cell_area * size)
    landed, size = jax.vmap(all_rays, (None, 0, 0))(nodes.u, local, lateral_mm)
    weight = jnp.tile(nodes.weight / wavelengths, wavelengths)
    cells = jnp.tile(cell_area, wavelengths)
    return Spot(landed.reshape(-1, 2), weight, cells * size.reshape(-1))


def dot_spot(
    field_point_mm: Float[Array, "2"],
    blur: Blur,
    stop_radius: Float[Array, ""],
    defocus_mm: Float[Array, ""],
    chromatic: Float[Array, " wavelengths"],
    lateral_mm: Float[Array, "wavelengths 2"],
    *,
    rays: int,
    depth: ObjectShift | None = None,
    deal: bool = True,
    sharpness: float = SHARPNESS,
) -> tuple[Spot, Float[Array, ""]]:
    """`pupil_nodes` and `spot` in one: the rays, and the area of the opening.

    Parameters
    ----------
    stop_radius : `paraxial.rim_sine` of the f-number over the reference sine.
    """
    h = field_point(field_point_mm, blur.aberration)
    nodes = pupil_nodes(h, stop_radius, blur.pupil, rays, sharpness)
    landed = spot(
        field_point_mm,
        nodes,
        blur.aberration,
        defocus_mm,
        chromatic,
        lateral_mm,
        depth=depth,
        deal=deal,
    )
    return landed, nodes.area


def through_hole(image: Spot, hole_mm: Float[Array, "2 2"]) -> Spot:
    """The spot of a round hole: every ray comes from another point of it.

    Parameters
    ----------
    hole_mm : Columns: images of the hole's radii along chart x and y (mm on the
        sensor); [[r, 0], [0, r]] for a hole imaged as a disc of radius r.
    """
    count = image.landing_mm.shape[0]
    k = np.arange(1, count + 1)
    radius = np.sqrt(k * _PLASTIC[0] % 1)
    azimuth = 2 * np.pi * (k * _PLASTIC[1] % 1)
    unit = np.stack([radius * np.cos(azimuth), radius * np.sin(azimuth)], -1)
    offset = jnp.asarray(unit, image.landing_mm.dtype) @ hole_mm.T
    # Cells of pupil and hole together: a ray stands for 1/M of the hole too.
    hole = jnp.pi * jnp.sum(hole_mm**2) / 2 / count
    return Spot(image.landing_mm + offset, image.weight, image.cell_mm2 + hole)


def moments(image: Spot, hole_mm: Float[Array, "2 2"] | None = None) -> Moments:
    """Mean and covariance of the light, the cells' own size included.

    Parameters
    ----------
    hole_mm : As in `through_hole`, in closed form; for a spot without hole.
    """
    w = image.weight
    centroid = w @ image.landing_mm
    away = image.landing_mm - centroid[None]
    covariance = jnp.einsum("k,ki,kj->ij", w, away, away)
    own = CELL_VARIANCE * (w @ image.cell_mm2)
    covariance = covariance + own * jnp.eye(2, dtype=covariance.dtype)
    if hole_mm is not None:
        covariance = covariance + hole_mm @ hole_mm.T / 4
    return Moments(centroid, covariance)


def _dealt(count: int, wavelengths: int) -> np.ndarray:
    """(wavelengths, count / wavelengths): which rays each wavelength gets."""
    if count % wavelengths:
        raise ValueError(
            f"{count} rays cannot be dealt to {wavelengths} wavelengths: "
            "take a multiple"
        )
    return np.arange(count).reshape(-1, wavelengths).T
