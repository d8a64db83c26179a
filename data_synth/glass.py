"""Refractive index of glass against wavelength.

A glass is known either by its Sellmeier coefficients or, as in patents, by n_d and the
Abbe number V_d alone. The latter is turned into a three-term Cauchy series
n = a + b/w^2 + c/w^4 (w in micrometres) that has exactly that n_d and V_d, and the
partial dispersion P_gF = 0.6438 - 0.001682 V_d of Schott's normal line, so that the
secondary spectrum is that of an ordinary glass.

References
----------
Schott, Technical Information TIE-29, Refractive Index and Dispersion (2016).
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np

LINE_G_NM = 435.8343
LINE_F_NM = 486.1327
LINE_D_NM = 587.5618
LINE_C_NM = 656.2725


@dataclass(frozen=True)
class Glass:
    """A dispersion formula and its coefficients (wavelength in micrometres)."""

    formula: Literal["cauchy", "sellmeier"]
    coefficients: tuple[float, ...]

    def refractive_index(self, wavelength_nm: float) -> float:
        """Index against vacuum at one wavelength."""
        square_um2 = (wavelength_nm * 1e-3) ** 2
        if self.formula == "cauchy":
            a, b, c = self.coefficients
            return a + b / square_um2 + c / square_um2**2
        strength = np.asarray(self.coefficients[0::2])
        resonance_um2 = np.asarray(self.coefficients[1::2])
        terms = strength * square_um2 / (square_um2 - resonance_um2)
        return float(np.sqrt(1.0 + terms.sum()))


AIR = Glass("cauchy", (1.0, 0.0, 0.0))


def glass_from_abbe(index_d: float, abbe_number: float) -> Glass:
    """The glass of the normal line with this n_d and V_d.

    An index of 1, or an Abbe number of 0 (no dispersion known), gives a constant index.
    """
    if index_d == 1.0 or abbe_number == 0.0:
        return Glass("cauchy", (index_d, 0.0, 0.0))
    dispersion = (index_d - 1.0) / abbe_number
    partial_g_f = 0.6438 - 0.001682 * abbe_number
    inverse_square = {
        line: (1e3 / line) ** 2 for line in (LINE_G_NM, LINE_F_NM, LINE_D_NM, LINE_C_NM)
    }

    def row(first_nm: float, second_nm: float) -> list[float]:
        first, second = inverse_square[first_nm], inverse_square[second_nm]
        return [first - second, first**2 - second**2]

    b, c = np.linalg.solve(
        [row(LINE_F_NM, LINE_C_NM), row(LINE_G_NM, LINE_F_NM)],
        [dispersion, partial_g_f * dispersion],
    )
    at_d = inverse_square[LINE_D_NM]
    return Glass(
        "cauchy", (float(index_d - b * at_d - c * at_d**2), float(b), float(c))
    )


def glass_from_sellmeier(coefficients: tuple[float, ...]) -> Glass:
    """A glass from B1, C1, B2, C2, B3, C3 (C in square micrometres)."""
    return Glass("sellmeier", tuple(float(value) for value in coefficients))
