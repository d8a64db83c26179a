"""Values that are taken from the preset because no source states them; each is noted.

A preset with one focal length, one focus distance or one fall-off leaves no choice: the
frame can only be rendered with it. Depth of field does leave a choice: a lens that was
measured at one focus distance and f-number can be refocused and stopped down, so both
must be stated (`lensfit.plate.frame.plate_lens`).
"""

from collections.abc import Iterator
from typing import NamedTuple

from lensfit.plate.camera.plate_camera import SPELT, PlateCamera, option_of
from lensfit.plate.notes import FrameNote
from lensfit.preset.schema import Preset
from lensfit.preset.select_entry import Selection


class AssumedValue(NamedTuple):
    """A value that the preset alone decides.

    Attributes
    ----------
    name : Of the quantity.
    value : In its unit.
    whose : In words, such as "the preset's only one".
    """

    name: str
    value: float
    whose: str

    def note(self, camera: PlateCamera) -> FrameNote:
        """A sentence for whoever should have stated it."""
        shown = f"{self.value:g} mm" if self.name.endswith("_mm") else f"{self.value:g}"
        option = option_of(self.name)
        places = ", ".join(("the header", *camera.searched))
        return FrameNote(
            f"{camera.plate.name}: no {SPELT[self.name]} in {places}; {self.whose}, "
            f"{shown}, is used ({option} states another)",
            f"assumed {self.name}",
        )


def assumed_values(
    preset: Preset, camera: PlateCamera, chosen: Selection, *, falloff: bool
) -> Iterator[AssumedValue]:
    """What no source states and the preset has one of.

    Parameters
    ----------
    chosen : The state of the lens.
    falloff : Whether the fall-off, and so its f-number, matters.
    """
    only = "the preset's only one"
    if "focal_length_mm" not in camera.known:
        yield AssumedValue("focal_length_mm", preset.entries[0].focal_length_mm, only)
    fall_off = chosen.entry.fall_off
    if "f_number" not in camera.known and falloff and fall_off:
        stop = fall_off[0].f_number
        if stop is not None:
            yield AssumedValue("f_number", stop, "that of the preset's only fall-off")
    focus_mm = chosen.measured_focus_mm
    if "focus_distance_mm" not in camera.known and focus_mm is not None:
        yield AssumedValue("focus_distance_mm", focus_mm, only)
    if "sensor_width_mm" not in camera.known:
        width_mm = preset.camera.sensor_width_mm
        yield AssumedValue("sensor_width_mm", width_mm, "the preset's")
