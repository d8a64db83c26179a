"""Lateral colour: where red and blue land when green lands here.

On the photograph, relative to the principal point and in reference radii,

    x_c = x_g + shift + q (c0 + c1 r^2 + c2 r^4 + ...) + strain + decentering,

the change of magnification with wavelength and its dependence on field height; and, for
a lens whose elements are tilted or off the axis, what that adds to first order of the
tilt: a shift, a magnification that differs between two azimuths (s cos 2a, s sin 2a),
and Brown's two decentering terms, as in `lensfit.optics.field`. The displacement of
real lenses is thousandths of the radius, so that its inverse is a fast contraction; a
guard keeps it one for any coefficients, and beyond the photographed radius the
displacement stays what it was there.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from lensfit.optics.field import named_basis

MAX_GRADIENT = 0.5
_STEPS = 60
_BROWN_GRADIENT = 6.0
"""Steepest change of a decentering term, per unit coefficient and radius."""


class ChannelShift(eqx.Module):
    """Displacement of one channel against green.

    Attributes
    ----------
    radial : c0, c1, ...
    shift_mm : The same displacement everywhere.
    valid_radius : Largest photographed radius, in reference radii.
    strain : s cos 2a, s sin 2a.
    decentering : Brown's two coefficients.
    """

    radial: Float[Array, " terms"]
    shift_mm: Float[Array, "2"]
    valid_radius: Float[Array, ""]
    strain: Float[Array, "2"] = eqx.field(default_factory=lambda: jnp.zeros(2))
    decentering: Float[Array, "2"] = eqx.field(default_factory=lambda: jnp.zeros(2))


LateralColour = tuple[ChannelShift, ChannelShift] | None
"""Of red and blue; None where all channels land alike."""


def no_lateral_colour() -> tuple[ChannelShift, ChannelShift]:
    """Of red and blue that land with green."""
    none = ChannelShift(jnp.zeros(1), jnp.zeros(2), jnp.ones(()))
    return none, none


def lopsided_basis(q: Float[Array, "2"]) -> Float[Array, "4 2"]:
    """Displacements per unit of the two strains and the two decentering terms."""
    x, y = q[0], q[1]
    strain = jnp.stack([jnp.stack([x, -y]), jnp.stack([y, x])])
    return jnp.concatenate([strain, named_basis(q)[:2]])


def channel_from_green(
    green_mm: Float[Array, "2"],
    shift: ChannelShift,
    principal_point_mm: Float[Array, "2"],
    reference_radius_mm: Float[Array, ""],
) -> Float[Array, "2"]:
    """Where the channel's chief ray lands when green's lands at `green_mm`."""
    q = (green_mm - principal_point_mm) / reference_radius_mm
    return green_mm + shift.shift_mm + _displacement(q, shift) * reference_radius_mm


def green_from_channel(
    channel_mm: Float[Array, "2"],
    shift: ChannelShift,
    principal_point_mm: Float[Array, "2"],
    reference_radius_mm: Float[Array, ""],
) -> Float[Array, "2"]:
    """Inverse of `channel_from_green`."""
    target = channel_mm - shift.shift_mm - principal_point_mm
    target = target / reference_radius_mm

    def step(_, q):
        return target - _displacement(q, shift)

    q = jax.lax.fori_loop(0, _STEPS, step, target)
    return principal_point_mm + q * reference_radius_mm


def displacement_basis(
    q: Float[Array, "2"], valid_radius: Float[Array, ""], radial_terms: int
) -> Float[Array, "terms 2"]:
    """Displacements per unit of the shift along x and y (in reference radii), the two
    strains, the two decentering terms and c0, c1, ...; bounded like the displacement,
    without its guard, which real lenses never feel."""
    inside = q * (valid_radius / jnp.maximum(jnp.linalg.norm(q), valid_radius))
    r2 = jnp.sum(inside**2)
    radial = [(inside * r2**k)[None] for k in range(radial_terms)]
    return jnp.concatenate([jnp.eye(2), lopsided_basis(inside), *radial])


def _displacement(q: Array, shift: ChannelShift) -> Array:
    degree = jnp.arange(shift.radial.shape[0], dtype=q.dtype)
    squared = jnp.sum(q**2)
    limit = shift.valid_radius**2
    bounded = jnp.minimum(squared, limit)
    steepness = (2 * degree + 1) * limit**degree
    bound = jnp.sum(jnp.abs(shift.radial) * steepness)
    bound += jnp.linalg.norm(shift.strain)
    bound += _BROWN_GRADIENT * shift.valid_radius * jnp.linalg.norm(shift.decentering)
    guard = (1 + (bound / MAX_GRADIENT) ** 10) ** -0.1
    outside = jnp.sqrt(limit / jnp.maximum(squared, limit))
    relative = jnp.zeros_like(bounded)
    for k in range(shift.radial.shape[0] - 1, -1, -1):
        relative = relative * bounded + shift.radial[k]
    inside = q * outside
    lopsided = jnp.concatenate([shift.strain, shift.decentering])
    return guard * (inside * relative + lopsided @ lopsided_basis(inside))
