"""Standard deviations and correlations of fitted numbers in a preset file."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float
from msgspec import Struct


class Covariance(Struct, frozen=True, forbid_unknown_fields=True):
    """How well the fitted parameters are known, and how they correlate.

    Attributes
    ----------
    parameters : Names, in the order of the rows.
    standard_deviation : One for each parameter, in its own unit.
    correlation : Lower triangle by rows; row i ends with its diagonal 1.
    """

    parameters: tuple[str, ...]
    standard_deviation: tuple[float, ...]
    correlation: tuple[tuple[float, ...], ...]

    @classmethod
    def from_matrix(
        cls,
        parameters: tuple[str, ...],
        matrix: Float[np.ndarray, "parameters parameters"],
    ) -> "Covariance":
        """From a covariance matrix; what has no variance correlates with nothing."""
        deviation = np.sqrt(np.clip(np.diag(matrix), 0.0, None))
        scale = np.where(deviation > 0, deviation, 1.0)
        correlation = matrix / np.outer(scale, scale)
        np.fill_diagonal(correlation, 1.0)
        return cls(
            tuple(parameters),
            tuple(deviation.tolist()),
            tuple(tuple(row[: i + 1].tolist()) for i, row in enumerate(correlation)),
        )

    def in_order(self, names: Sequence[str]) -> Float[np.ndarray, "names names"]:
        """The covariance matrix of these; zero for those that are not among them."""
        rows = [k for k, name in enumerate(self.parameters) if name in names]
        places = [names.index(self.parameters[k]) for k in rows]
        found = np.zeros((len(names),) * 2)
        found[np.ix_(places, places)] = self.matrix()[np.ix_(rows, rows)]
        return found

    def matrix(self) -> Float[np.ndarray, "parameters parameters"]:
        """The symmetric covariance matrix."""
        deviation = np.asarray(self.standard_deviation)
        return self.correlations() * np.outer(deviation, deviation)

    def correlations(self) -> Float[np.ndarray, "parameters parameters"]:
        """The whole symmetric matrix of correlations."""
        found = np.zeros((len(self.parameters),) * 2)
        for i, row in enumerate(self.correlation):
            found[i, : i + 1] = found[: i + 1, i] = row
        return found


def lateral_names(radial_terms: int) -> list[str]:
    """Names of the numbers of a channel's displacement, in the order of
    `lensfit.optics.lateral.displacement_basis`."""
    sizes = {"shift_mm": 2, "strain": 2, "decentering": 2, "radial": radial_terms}
    return numbered(sizes)


def fall_off_names(channel: str, terms: int) -> list[str]:
    """Names of the control values of a channel."""
    return numbered({channel: terms})


def numbered(sizes: dict[str, int]) -> list[str]:
    """Names of the members of lists: "radial[0]", "radial[1]", ..."""
    return [f"{name}[{k}]" for name, size in sizes.items() for k in range(size)]
