"""One pass of the geometric fit over its marks, beside the operations it cannot avoid.

A mark adds two rows of residuals to the normal equations: over k shared parameters and
l of its photograph's, 2 k^2 + 2 l (k + l) operations for each row. Their derivatives,
the board and the lens are not counted, so the ratio says what all of that costs.
"""

from data_synth.bench.floor import Floor, Rates, best_seconds
from lensfit.fitting.adjust import Adjustment, equations_at


def pass_flops(marks: int, shared: int, local: int) -> float:
    """Operations of J^T J of so many marks, two rows each."""
    return 2.0 * marks * (2 * shared**2 + 2 * local * (shared + local))


def pass_floor(adjustment: Adjustment, rates: Rates) -> Floor:
    """Measured now, on all marks, programs compiled."""
    layout = adjustment.layout
    marks = int(adjustment.stack.present.sum())
    seconds = best_seconds(lambda: equations_at(adjustment).matrix.block_until_ready())
    flops = pass_flops(marks, layout.shared, layout.local)
    return Floor("one pass over the marks", flops, "flops", rates.flops, seconds)
