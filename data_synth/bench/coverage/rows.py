"""How often stated deviations cover what they should, as rows with bars.

Two shares for each quantity, over all draws and all places where it was predicted:

- of the scatter: |value - mean over the draws| is within the deviation. What the model
  itself gets wrong is the same in every draw and so not in it: a deviation that counts
  what the model misses covers more of the scatter than 68 %;
- of the truth: |value - truth| is within the deviation, whatever made the error. It is
  what a user relies on, and it alone has the bar.
"""

import numpy as np
from jaxtyping import Bool, Float

from data_synth.bench.coverage.predictions import Prediction
from data_synth.bench.rows import HONEST, SLACK, Row

Draw = dict[str, Prediction]
_WHOLE = "psf_error_percent"


def coverage_rows(name: str, draws: list[Draw]) -> list[Row]:
    """Two rows for each quantity, three for whole point-spread functions."""
    if not draws:
        return [Row(name, "draws that could be calibrated", float("nan"), bar=0.0)]
    rows = []
    # Not every draw has every quantity, and the first that could be calibrated may not.
    for quantity in dict.fromkeys(name for draw in draws for name in draw):
        some = [draw[quantity] for draw in draws if quantity in draw]
        values, deviations, truths = map(np.stack, zip(*some, strict=True))
        if quantity == _WHOLE:
            rows += _whole_rows(name, deviations, truths)
            continue
        mean = values.mean(0)
        # The mean is of the same draws, and so too close to each by this factor.
        apart = np.sqrt(len(some) / max(len(some) - 1, 1)) * (values - mean)
        rows.append(_row(name, f"{quantity}, scatter covered, %", apart, deviations))
        known = np.isfinite(truths)
        if known.any():
            what, off = f"{quantity}, truth covered, %", (values - truths)[known]
            rows.append(_row(name, what, off, deviations[known], SLACK))
    return rows


def covered(
    errors: Float[np.ndarray, "*values"], deviations: Float[np.ndarray, "*values"]
) -> Bool[np.ndarray, "*values"]:
    """Which errors are within one standard deviation."""
    return np.abs(errors) <= deviations


def _row(
    name: str,
    what: str,
    errors: np.ndarray,
    deviations: np.ndarray,
    bar: float | None = None,
) -> Row:
    share = 100.0 * float(np.mean(covered(errors, deviations)))
    peers = {"stated": _rms(deviations), "found": _rms(errors)}
    return Row(name, what, share, bar=bar, expected=HONEST, peers=peers)


def _whole_rows(name: str, stated: np.ndarray, off: np.ndarray) -> list[Row]:
    """Of whole functions: the expected error and the true one."""
    return [
        Row(name, f"{_WHOLE}, stated, median", float(np.median(stated))),
        Row(name, f"{_WHOLE}, true, median", float(np.median(off))),
    ]


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))
