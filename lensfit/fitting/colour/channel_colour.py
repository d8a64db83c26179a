"""A measured lateral colour: of red or of blue, against green.

Its terms, in this order: a shift, two of strain, two of decentering, radial ones
(`lensfit.optics.lateral`).
"""

from dataclasses import dataclass

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from lensfit.optics.lateral import ChannelShift
from lensfit.optics.many_points import lateral_deviations

CENTRED, SHIFTED, LOPSIDED = 0, 2, 6
"""Terms besides the radial ones: none, the shift, and strain and decentering too."""


@dataclass(frozen=True, eq=False)
class ChannelColour:
    """Lateral displacement of one channel against green.

    Attributes
    ----------
    radial : c0, c1, ..., zero where they were left.
    shift_mm : Constant displacement.
    strain, decentering : As in `lensfit.optics.lateral`; empty when left.
    covariance : Of (shift x, shift y, strain, decentering, c0, c1, ...), in reference
        radii, also of what was left.
    valid_radius : Largest radius measured, in reference radii.
    """

    radial: tuple[float, ...]
    shift_mm: tuple[float, float]
    strain: tuple[float, ...]
    decentering: tuple[float, ...]
    covariance: Float[np.ndarray, "parameters parameters"]
    valid_radius: float

    def radial_px(
        self, radius: Float[np.ndarray, " radii"], px_per_radius: float
    ) -> tuple[np.ndarray, np.ndarray]:
        """Outward displacement at radii (in reference radii), and its sigma; px.

        The mean over azimuths, over which shift, strain and decentering cancel.
        """
        powers = radius[:, None] ** (2 * np.arange(len(self.radial)) + 1)
        value = powers @ np.asarray(self.radial) if self.radial else 0 * radius
        part = self.covariance[LOPSIDED:, LOPSIDED:]
        variance = np.einsum("ri,ij,rj->r", powers, part, powers)
        return value * px_per_radius, np.sqrt(np.maximum(variance, 0)) * px_per_radius

    def deviations(
        self, q: Float[np.ndarray, "points 2"]
    ) -> Float[np.ndarray, "points 2"]:
        """Standard deviation along x and y at radius vectors, in reference radii."""
        known = lateral_deviations(
            jnp.asarray(q), self.optics(), jnp.asarray(self.covariance)
        )
        return np.asarray(known)

    def optics(self) -> ChannelShift:
        """The same for computing."""
        strain, decentering = (
            np.array([*part, 0.0, 0.0][:2]) for part in (self.strain, self.decentering)
        )
        return ChannelShift(
            jnp.asarray(np.array(self.radial, float)),
            jnp.asarray(np.array(self.shift_mm)),
            jnp.asarray(self.valid_radius),
            jnp.asarray(strain),
            jnp.asarray(decentering),
        )

    def lopsided(self, radius: float) -> float:
        """Largest displacement by strain and decentering at a radius, reference radii.

        A decentering term moves by three times its coefficient along its own axis.
        """
        strain = np.linalg.norm(self.strain)
        decentering = np.linalg.norm(self.decentering)
        return float(strain * radius + 3 * decentering * radius**2)
