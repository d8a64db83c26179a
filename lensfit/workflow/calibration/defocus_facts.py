"""How far each photograph was out of focus, for the report.

The wavefront's defocus of all takes may be moved by the same amount: curvature and
spherical aberration make up for it, and no barrel is exact. So what is told is defocus
besides that: less what all takes have in common against the distances that were stated.
Positive is on the side of a lens that is focused nearer than the chart.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np
from jaxtyping import Float

from lensfit.fitting.wavefront.fit import WavefrontFit
from lensfit.fitting.wavefront.start import stated_defocus_mm
from lensfit.report.plain_numbers import plain, plain_distance


def defocus_facts(wavefront: WavefrontFit) -> list[dict[str, Any]]:
    """Of every group of photographs, as it was fitted (`defocus_mm`) and besides what
    all have in common (`from_stated`; None where no distance was stated)."""
    gathered, stage = wavefront.gathered, wavefront.stage
    where = stage.layout.blocks["defocus"]
    count = len(gathered.groups)
    found = stage.parameters[where][:count]
    covariance = wavefront.stated_covariance[where, where][:count, :count]
    besides = _besides_common(found, covariance, stated_defocus_mm(gathered))
    return [
        {
            "focus_distance_mm": plain_distance(group.focus_distance_mm),
            "target_distance_mm": group.target_distance_mm,
            "image": group.take or None,
            "defocus_mm": float(found[k]),
            "standard_deviation_mm": float(np.sqrt(covariance[k, k])),
            "from_stated": besides and {key: plain(v[k]) for key, v in besides.items()},
        }
        for k, group in enumerate(gathered.groups)
    ]


def _besides_common(
    found: Float[np.ndarray, " groups"],
    covariance: Float[np.ndarray, "groups groups"],
    stated: Float[np.ndarray, " groups"],
) -> Mapping[str, Float[np.ndarray, " groups"]] | None:
    told = np.isfinite(stated)
    if not told.any():
        return None
    without = np.eye(len(found)) - told / told.sum()
    value = without @ found + np.mean(stated[told])
    variance = np.einsum("ij,jk,ik->i", without, covariance, without)
    return {
        "defocus_mm": value,
        "standard_deviation_mm": np.sqrt(np.maximum(variance, 0.0)),
    }
