"""How well the blur block of a preset is known, from the covariance of the fit.

The fit's parameters and the block's numbers are not the same: a focus offset is a mean
of defocus values less what the barrel says, the exit pupil stands in two places. So
every independent move of the parameters is made, a little, and the block written again;
what changed is the move of its numbers.
"""

from dataclasses import replace

import msgspec
import numpy as np

from lensfit.fitting.lens_state import LensState
from lensfit.fitting.wavefront.fit import WavefrontFit
from lensfit.fitting.wavefront.uncertainty import parameter_moves
from lensfit.preset.blur_blocks import Blur, BlurUncertainty
from lensfit.preset.blur_numbers import numbers_of
from lensfit.workflow.calibration.blur_entries import blur_of

_STEP = 0.05
_DIGITS = 5


def known_blur_of(state: LensState, wavefront: WavefrontFit) -> Blur:
    """`blur_of`, with its uncertainty."""
    blur = blur_of(state, wavefront)
    moves = parameter_moves(wavefront.stage, wavefront.stated_covariance)
    changes = [_change(move, state, wavefront) for move in moves]
    names = [n for n in numbers_of(blur) if any(c.get(n) for c in changes)]
    known = BlurUncertainty(
        tuple(names),
        tuple(tuple(_short(change[n]) for n in names) for change in changes),
    )
    return msgspec.structs.replace(blur, uncertainty=known)


def _change(
    move: np.ndarray, state: LensState, wavefront: WavefrontFit
) -> dict[str, float]:
    """What a move of the parameters changes in the block, to first order."""

    def numbers(share: float) -> dict[str, float]:
        stage = wavefront.stage
        moved = replace(stage, parameters=stage.parameters + share * move)
        return numbers_of(blur_of(state, replace(wavefront, stage=moved)))

    forth, back = numbers(_STEP), numbers(-_STEP)
    return {name: (forth[name] - back[name]) / (2 * _STEP) for name in forth}


def _short(value: float) -> float:
    return float(f"{value:.{_DIGITS}g}")
