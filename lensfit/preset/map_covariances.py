"""Covariances of the maps of a preset entry, in the parameters of the optics.

The covariance of an entry is in the fit's parameters (`lensfit.fitting.parameters`):
the principal distance by its logarithm, the principal point in reference radii, all
else as in the file. Of the free field, numbers along x come first, then as many along
y. A number that is not named was fixed and has no variance. Other parameters (errors of
the chart, shifts of wide apertures) change no chief ray.
"""

import numpy as np
from jaxtyping import Float

from lensfit.optics.distortion import Distortion
from lensfit.optics.field import ANAMORPHIC_TERMS, DECENTERING_TERMS, PRISM_TERMS
from lensfit.optics.map_deviations import MapCovariances
from lensfit.preset import blocks
from lensfit.preset.covariance import (
    Covariance,
    fall_off_names,
    lateral_names,
    numbered,
)
from lensfit.preset.entry import Entry

_FREE = "free_field"
_PERSPECTIVE = ("entrance_pupil_offset_mm", "pupil_shift_mm")
_ELSEWHERE = (
    *_PERSPECTIVE,
    "pupil_gap",
    "pupil_shift",
    "board_stretch",
    "aperture_shift",
)


def map_covariances(entry: Entry, distortion: Distortion) -> MapCovariances:
    """Of an entry at one f-number.

    Parameters
    ----------
    entry : Its `fall_off` has at most one member.
    distortion : Of the entry.
    """
    lateral, light = entry.lateral_colour, entry.fall_off[:1]
    red = blue = fall_off = None
    if lateral is not None and lateral.covariance is not None:
        radius_mm = entry.distortion.reference_radius_mm
        red = _of_channel(lateral.r, lateral.covariance.r, radius_mm)
        blue = _of_channel(lateral.b, lateral.covariance.b, radius_mm)
    if light and light[0].covariance is not None:
        fall_off = _of_fall_off(light[0], light[0].covariance)
    return MapCovariances(
        distortion=_of_distortion(entry.covariance, distortion),
        perspective=_of_perspective(entry.covariance, distortion),
        red=red,
        blue=blue,
        fall_off=fall_off,
    )


def _of_channel(
    channel: blocks.ChannelShift, covariance: Covariance, reference_radius_mm: float
) -> Float[np.ndarray, "terms terms"]:
    names = lateral_names(len(channel.radial))
    unit = np.ones(len(names))
    unit[:2] = 1 / reference_radius_mm
    return covariance.in_order(names) * np.outer(unit, unit)


def _of_fall_off(
    light: blocks.FallOff, covariance: blocks.FallOffCovariance
) -> Float[np.ndarray, "3 terms terms"]:
    return np.array(
        [
            getattr(covariance, channel).in_order(fall_off_names(channel, len(light.g)))
            for channel in ("r", "g", "b")
        ]
    )


def _of_distortion(
    covariance: Covariance | None, distortion: Distortion
) -> Float[np.ndarray, "numbers numbers"] | None:
    """Of the numbers of `lensfit.optics.map_deviations.changed_distortion`.

    None if the file does not state what one of them multiplies.
    """
    return _of_numbers(covariance, distortion, {})


def _of_perspective(
    covariance: Covariance | None, distortion: Distortion
) -> Float[np.ndarray, "numbers numbers"] | None:
    """Of those, then of entrance-pupil offset and shift; None where the file does not
    say how well the pupil is known."""
    offset, _ = numbered(dict.fromkeys(_PERSPECTIVE, 1))
    if covariance is None or offset not in covariance.parameters:
        return None
    return _of_numbers(covariance, distortion, dict.fromkeys(_PERSPECTIVE, 1))


def _of_numbers(
    covariance: Covariance | None, distortion: Distortion, more: dict[str, int]
) -> Float[np.ndarray, "numbers numbers"] | None:
    if covariance is None:
        return None
    sizes = {
        "focal_length": 1,
        "principal_point": 2,
        "radial": distortion.radial.size,
        "squeeze": 2,
        "decentering": DECENTERING_TERMS,
        "thin_prism": PRISM_TERMS,
        "anamorphic": ANAMORPHIC_TERMS,
        _FREE: distortion.free.size,
        **more,
    }
    names = numbered(sizes)
    parameters = _with_free_field_counted(covariance.parameters, sizes[_FREE])
    if any(name not in names and _block(name) not in _ELSEWHERE for name in parameters):
        return None
    return Covariance(
        parameters, covariance.standard_deviation, covariance.correlation
    ).in_order(names)


def _with_free_field_counted(
    parameters: tuple[str, ...], count: int
) -> tuple[str, ...]:
    """Older presets count the field's numbers with gaps, but in the same order."""
    known = [name for name in parameters if _block(name) == _FREE]
    if len(known) != count:
        return parameters
    counted = iter(numbered({_FREE: count}))
    return tuple(next(counted) if name in known else name for name in parameters)


def _block(name: str) -> str:
    return name.partition("[")[0]
