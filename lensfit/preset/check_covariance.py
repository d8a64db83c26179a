"""What types cannot say about a covariance: lengths, and that numbers could vary so."""

from collections.abc import Iterator, Sequence

import numpy as np

from lensfit.preset.covariance import Covariance

_ROUNDING = 1e-6
"""How far correlations may be off those of any draws."""


def covariance_faults(
    covariance: Covariance, known: Sequence[str] | None = None
) -> Iterator[tuple[str, str]]:
    """Key and sentence of what cannot be right; the later ones only where the earlier
    are not.

    Parameters
    ----------
    known : The parameters that there are; None for any.
    """
    count = len(covariance.parameters)
    rows = [len(row) for row in covariance.correlation]
    if len(covariance.standard_deviation) != count:
        yield "standard_deviation", f"needs {count} numbers, one for each parameter"
    elif rows != list(range(1, count + 1)):
        yield "correlation", f"needs {count} rows of 1 to {count} numbers"
    elif len(set(covariance.parameters)) < count:
        yield "parameters", "one stands twice"
    elif known is not None and not set(covariance.parameters) <= set(known):
        (first, *_) = (n for n in covariance.parameters if n not in known)
        yield "parameters", f"{first!r} is none of {', '.join(known)}"
    elif any(deviation < 0 for deviation in covariance.standard_deviation):
        yield "standard_deviation", "is negative somewhere"
    else:
        yield from _correlation_faults(covariance)


def _correlation_faults(covariance: Covariance) -> Iterator[tuple[str, str]]:
    every = [value for row in covariance.correlation for value in row]
    if any(abs(value) > 1 + _ROUNDING for value in every):
        yield "correlation", "is beyond -1 to 1 somewhere"
    elif any(abs(row[-1] - 1) > _ROUNDING for row in covariance.correlation):
        yield "correlation", "a row does not end with 1"
    elif every and np.linalg.eigvalsh(covariance.correlations())[0] < -_ROUNDING:
        yield "correlation", "is of no numbers that could vary together"
