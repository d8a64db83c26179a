"""The focal length on the barrel or zoom ring, from that of a pinhole.

A preset is told its focal length as the lens shows it (nominal). The pinhole with the
picture's angle of view has another: it differs by the tolerance of the barrel's number
and grows with focusing. Each measured entry knows both, so that the ring follows from
the pinhole at a focus distance.
"""

from lensfit.preset.schema import Preset
from lensfit.preset.select_entry import FOCAL_LENGTH_SLACK

_ROUNDS = 20
_SAME = 1e-9


def ring_focal_length_mm(
    preset: Preset,
    pinhole_mm: float,
    focus_mm: float | None,
    *,
    from_pupil: bool = False,
) -> float:
    """The nominal focal length at which the lens images like a pinhole of this one.

    Beyond the measured focal lengths the ratio of both is that of the nearest. A
    prime's is its own within the slack that metadata of primes have.

    Parameters
    ----------
    pinhole_mm : Principal distance of the pinhole.
    focus_mm : Focus distance; None for a preset with one at each focal length.
    from_pupil : It counts from the entrance pupil rather than from the sensor.

    Raises
    ------
    PresetError : The preset does not reach the focus distance.
    """
    measured = sorted({entry.focal_length_mm for entry in preset.entries})
    ring, focus = pinhole_mm, focus_mm
    for _ in range(_ROUNDS):
        at = min(max(ring, measured[0]), measured[-1])
        projection = preset.select(at, None, focus).entry.projection
        before, ring = ring, pinhole_mm * at / projection.principal_distance_mm
        if focus_mm is not None and from_pupil:
            focus = focus_mm + projection.entrance_pupil_offset_mm
        if abs(ring - before) <= _SAME * ring:
            break
    if len(measured) == 1:
        near = (abs(one / measured[0] - 1) for one in (ring, pinhole_mm))
        return measured[0] if min(near) <= FOCAL_LENGTH_SLACK else ring
    # Headers hold single precision.
    nearest = min(measured, key=lambda one: abs(one - ring))
    return nearest if abs(ring / nearest - 1) < 1e-6 else float(f"{ring:.7g}")
