"""Chief rays and fall-off of many points at once, as compiled programs.

They take arrays only: the state of a `Lens` is static, and a program compiled for one
focus distance must serve the next. Lengths are sensor millimetres.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from lensfit.optics import distortion as chief_ray
from lensfit.optics.bernstein import continued_bernstein
from lensfit.optics.distortion import Distortion
from lensfit.optics.falloff import log_loss
from lensfit.optics.lateral import (
    ChannelShift,
    channel_from_green,
    displacement_basis,
    green_from_channel,
)
from lensfit.optics.projection import PupilShift, equivalent_chart_point


def displaced_positions_mm(
    green_mm: Float[Array, "points 2"],
    distortion: Distortion,
    shift: ChannelShift | None,
) -> Float[Array, "points 2"]:
    """Where a channel lands. A program of its own: that of the chief rays, which takes
    longer to compile, then serves all channels."""
    if shift is None:
        return green_mm
    centre, radius = distortion.principal_point_mm, distortion.reference_radius_mm
    return _channel_from_green(green_mm, shift, centre, radius)


def displaced_back(
    points_mm: Float[Array, "points 2"],
    distortion: Distortion,
    shift: ChannelShift | None,
) -> Float[Array, "points 2"]:
    """Inverse of `displaced_positions_mm`."""
    if shift is None:
        return points_mm
    centre, radius = distortion.principal_point_mm, distortion.reference_radius_mm
    return _green_from_channel(points_mm, shift, centre, radius)


_each = (0, None, None, None)
_channel_from_green = eqx.filter_jit(jax.vmap(channel_from_green, _each))
_green_from_channel = eqx.filter_jit(jax.vmap(green_from_channel, _each))


@eqx.filter_jit
def project(
    points: Float[Array, "points 3"],
    pupil_mm: Float[Array, ""],
    distortion: Distortion,
    pupil_shift: PupilShift | None,
) -> Float[Array, "points 2"]:
    """Where green chief rays of object points land."""

    def one(point):
        direction = equivalent_chart_point(point.at[2].add(-pupil_mm), pupil_shift)
        return chief_ray.distorted_from_direction(direction, distortion)

    return jax.vmap(one)(points)


@eqx.filter_jit
def distort(
    points: Float[Array, "points 2"], distortion: Distortion
) -> Float[Array, "points 2"]:
    """Where points of the undistorted picture land."""
    return jax.vmap(chief_ray.distorted_from_undistorted, (0, None))(points, distortion)


@eqx.filter_jit
def undistort(
    points: Float[Array, "points 2"], distortion: Distortion
) -> Float[Array, "points 2"]:
    """Inverse of `distort`; NaN where there is none."""
    return jax.vmap(chief_ray.undistorted_from_distorted, (0, None))(points, distortion)


@eqx.filter_jit
def illuminate(
    points: Float[Array, "points 2"],
    centre_mm: Float[Array, "2"],
    valid_radius_mm: Float[Array, ""],
    control: Float[Array, " terms"],
) -> Float[Array, " points"]:
    """Relative illumination; see `optics.falloff`."""

    def one(point):
        squared = jnp.sum(((point - centre_mm) / valid_radius_mm) ** 2)
        return jnp.exp(-log_loss(squared, control))

    return jax.vmap(one)(points)


@eqx.filter_jit
def lateral_deviations_mm(
    green_mm: Float[Array, "points 2"],
    distortion: Distortion,
    shift: ChannelShift,
    covariance: Float[Array, "terms terms"],
) -> Float[Array, "points 2"]:
    """Standard deviation along x and y of how far a channel lands from green.

    Parameters
    ----------
    covariance : Of what `lateral.displacement_basis` counts, in reference radii.
    """
    centre, radius = distortion.principal_point_mm, distortion.reference_radius_mm
    q = (green_mm - centre[None]) / radius
    return radius * lateral_deviations(q, shift, covariance)


@eqx.filter_jit
def lateral_deviations(
    q: Float[Array, "points 2"],
    shift: ChannelShift,
    covariance: Float[Array, "terms terms"],
) -> Float[Array, "points 2"]:
    """`lateral_deviations_mm` at radius vectors; all in reference radii."""

    def one(q):
        basis = displacement_basis(q, shift.valid_radius, shift.radial.shape[0])
        variance = jnp.sum(basis * (covariance @ basis), 0)
        return jnp.sqrt(jnp.maximum(variance, 0.0))

    return jax.vmap(one)(q)


@eqx.filter_jit
def light_deviations(
    points_mm: Float[Array, "points 2"],
    centre_mm: Float[Array, "2"],
    valid_radius_mm: Float[Array, ""],
    control: Float[Array, " terms"],
    covariance: Float[Array, "terms terms"],
) -> Float[Array, " points"]:
    """Standard deviation of the relative illumination."""

    def one(point):
        squared = jnp.sum(((point - centre_mm) / valid_radius_mm) ** 2)
        terms = continued_bernstein(squared, control.shape[0])
        variance = jnp.maximum(terms @ covariance @ terms, 0.0)
        return jnp.exp(-terms @ control) * jnp.sqrt(variance)

    return jax.vmap(one)(points_mm)
