"""How well the wavefront's parameters are known.

The covariance is the sandwich estimate over dots: normal equations on the outside, the
scatter of every dot's own gradient inside. So it holds whatever the noise of a cell was
taken for, and counts what the model misses of a dot as one error, not as many.

Reference: P. J. Huber, Proc. Fifth Berkeley Symposium 1 (1967) 221; the small-sample
factor n/(n - k) as in J. G. MacKinnon and H. White, J. Econometrics 29 (1985) 305.
"""

import numpy as np
from jaxtyping import Float

from lensfit.fit.wavefront.families import Family, indices_of
from lensfit.fit.wavefront.stages import Stage

UNSEEN = 0.7
"""A parameter whose deviation is this share of its prior's is not seen."""


def covariance_of(
    stage: Stage, families: tuple[Family, ...]
) -> Float[np.ndarray, "parameters parameters"]:
    """Of all parameters; zero rows for those that were fixed."""
    free = indices_of(families)
    precision = np.where(stage.deviation > 0, stage.deviation, 1.0)[free] ** -2.0
    matrix = stage.equations.matrix.sum(0)[np.ix_(free, free)]
    assert stage.solution is not None
    each = np.asarray(stage.solution.per_dot.gradient)[: len(stage.gathered.take)]
    each = each.reshape(-1, each.shape[-1])[:, free]
    each = each[np.any(each != 0, -1)]
    scatter = each.T @ each * (len(each) / max(len(each) - len(free), 1))
    # What the prior holds has the prior's own scatter.
    inverse = np.linalg.inv(matrix + np.diag(precision))
    covariance = np.zeros((stage.layout.size,) * 2)
    inside = inverse @ (scatter + np.diag(precision)) @ inverse
    covariance[np.ix_(free, free)] = (inside + inside.T) / 2
    return covariance


def unseen(
    stage: Stage, families: tuple[Family, ...], covariance: np.ndarray
) -> tuple[str, ...]:
    """Families of which the photographs say hardly more than the prior did."""
    deviation = np.sqrt(np.clip(np.diag(covariance), 0, None))
    names = []
    for family in families:
        share = deviation[list(family.indices)] / np.asarray(family.deviation)
        if np.median(share) > UNSEEN:
            names.append(family.name)
    return tuple(names)
