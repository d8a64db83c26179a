"""A plate's camera with its focal length as on the zoom ring, which presets go by.

Some sources state the focal length of a pinhole instead: CG cameras, and the standard
attribute ``pinholeFocalLength``. The preset turns it into that of the ring, with a note
where the two differ.
"""

from lensfit.plate.camera.plate_camera import PlateCamera
from lensfit.plate.camera.sourced_value import SourcedValue
from lensfit.plate.notes import FrameNote
from lensfit.preset.ring_focal_length import ring_focal_length_mm
from lensfit.preset.schema import Preset

_NOTED = 1e-4
"""Relative; the fourth digit of a ring is nobody's."""


def ring_camera(preset: Preset, camera: PlateCamera) -> PlateCamera:
    """The camera, with the focal length of the ring in place of the pinhole's.

    A focal length of which nothing is known but the pinhole's stays where the focus
    distance is missing that its ring depends on.

    Raises
    ------
    PresetError : The preset does not reach the focus distance.
    """
    known = camera.known.get("focal_length_mm")
    if known is None or not known.of_pinhole:
        return camera
    focus = camera.known.get("focus_distance_mm")
    if focus is None and _has_many_focuses(preset):
        return camera
    pinhole_mm = float(known.value)
    ring_mm = ring_focal_length_mm(
        preset,
        pinhole_mm,
        None if focus is None else float(focus.value),
        from_pupil=focus is not None and focus.from_pupil,
    )
    source = f"{known.source}, {pinhole_mm:g} mm of the pinhole"
    ring = SourcedValue(ring_mm, source, rank=known.rank)
    note = None
    if _is_zoom(preset) and abs(ring_mm - pinhole_mm) > _NOTED * pinhole_mm:
        note = FrameNote(
            f"{camera.plate.name}: {known.source} states the focal length of a pinhole "
            f"({pinhole_mm:g} mm), which this lens has at {ring_mm:g} mm on its ring "
            "(--focal-length-mm states another)",
            "focal length of a pinhole",
        )
    return camera.with_known("focal_length_mm", ring, note)


def _is_zoom(preset: Preset) -> bool:
    return len({entry.focal_length_mm for entry in preset.entries}) > 1


def _has_many_focuses(preset: Preset) -> bool:
    """Whether any focal length was measured at several focus distances."""
    focal_lengths = [entry.focal_length_mm for entry in preset.entries]
    return len(set(focal_lengths)) < len(focal_lengths)
