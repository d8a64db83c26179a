"""A measured fall-off: one for each f-number, a polynomial for each channel.

The logarithm of the relative illumination is minus a Bernstein polynomial of the
squared radius (`lensfit.optics.falloff`), which goes on as it ends beyond the largest
radius.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from lensfit.optics.bernstein import continued_bernstein


@dataclass(frozen=True, eq=False)
class FallOffFit:
    """Fall-off of three channels at one f-number.

    Attributes
    ----------
    f_number : None when nobody said.
    control : b_1 ... b_n of r, g and b.
    valid_radius_mm : Largest radius that the control values are for.
    covariance : Of each channel's control values.
    """

    f_number: float | None
    control: Float[np.ndarray, "3 terms"]
    valid_radius_mm: float
    covariance: Float[np.ndarray, "3 terms terms"]

    def deviation(
        self, radius_mm: Float[np.ndarray, " points"]
    ) -> Float[np.ndarray, "3 points"]:
        """Standard deviation of the relative illumination of r, g and b."""
        terms = self.terms_at(radius_mm)
        loss = terms @ self.control.T
        return np.exp(-loss.T) * self._of_terms(terms)

    def deviation_about_mean(
        self, radius_mm: Float[np.ndarray, " points"]
    ) -> Float[np.ndarray, "3 points"]:
        """Standard deviation of the logarithm of the illumination, less its mean over
        these points: what no exposure would undo."""
        terms = self.terms_at(radius_mm)
        return self._of_terms(terms - terms.mean(0))

    def terms_at(
        self, radius_mm: Float[np.ndarray, " points"]
    ) -> Float[np.ndarray, "points terms"]:
        """What every control value adds to the loss."""
        s = (radius_mm / self.valid_radius_mm) ** 2
        return continued_bernstein(s, self.control.shape[1])

    def _of_terms(self, terms: np.ndarray) -> np.ndarray:
        variance = np.einsum("pi,cij,pj->cp", terms, self.covariance, terms)
        return np.sqrt(np.maximum(variance, 0.0))
