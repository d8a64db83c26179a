"""What a tolerance on the picture allows each approximation of the blur."""

from typing import NamedTuple

import numpy as np


class BlurBudget(NamedTuple):
    """What a tolerance on the picture allows each approximation of the blur.

    Attributes
    ----------
    step_px : Difference of radius between levels in focus.
    growth : The same over the radius, where that is large.
    kernel_error : Relative error (L2) of a kernel.
    lost : Share of a kernel's light that may be cut off.
    unseen : Share of light that may leave its pixel and the blur still not be run.
    light_step_px : Resolution of the radius of highlights.
    """

    step_px: float
    growth: float
    kernel_error: float
    lost: float
    unseen: float
    light_step_px: float

    @classmethod
    def of(cls, tolerance: float) -> "BlurBudget":
        """Shares of an accepted rms error of the picture, display-referred."""
        # Measured on a path-traced scene: levels `step_px` apart show as 5.6e-3 of it
        # (rms of the picture); a kernel wrong by e, on a 1/f picture, as about e / 50.
        return cls(
            step_px=float(np.clip(180 * tolerance, 0.08, 2.5)),
            growth=float(np.clip(33 * tolerance, 0.02, 0.4)),
            kernel_error=float(np.clip(50 * tolerance, 0.01, 0.3)),
            lost=float(np.clip(tolerance, 1e-5, 1e-2)),
            unseen=10 * tolerance,
            light_step_px=float(np.clip(50 * tolerance, 0.02, 0.1)),
        )
