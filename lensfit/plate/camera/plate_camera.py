"""One plate's camera from all sources, before the preset is applied.

A quantity has a name in sentences and one as an option, and each value its source.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import NamedTuple

from lensfit.errors import ImageError
from lensfit.io.metadata import CameraState
from lensfit.plate.camera.settings import Settings

SPELT = {
    "focal_length_mm": "focal length",
    "f_number": "f-number",
    "focus_distance_mm": "focus distance",
    "sensor_width_mm": "sensor width",
}
"""Those that a frame depends on."""


def option_of(name: str) -> str:
    """The option that states a quantity or a knob."""
    return "--" + name.replace("_", "-")


class SourcedValue(NamedTuple):
    """A value and its source.

    Attributes
    ----------
    value : In the unit of its quantity.
    source : The option, file or header entry, for people.
    from_pupil : A focus distance from the pinhole of the CG camera, which is the
        entrance pupil, rather than from the sensor.
    rank : Place among the sources; less counts more.
    of_pinhole : A focal length of the pinhole with the picture's angle of view, rather
        than as on the barrel or the zoom ring.
    """

    value: float | str
    source: str
    from_pupil: bool = False
    rank: int = 0
    of_pinhole: bool = False


_DECIDING = (
    "focal_length_mm",
    "f_number",
    "t_number",
    "focus_distance_mm",
    "sensor_width_mm",
)
"""Quantities that a frame depends on."""


class BadEntry(NamedTuple):
    """A header entry that holds what it cannot.

    Attributes
    ----------
    error : Which it is, and which option gives the value in its place.
    entry : Its name.
    counts : Nothing better tells the quantity.
    """

    error: ImageError
    entry: str
    counts: bool


@dataclass(frozen=True)
class PlateCamera:
    """All that is known of a plate's camera.

    Attributes
    ----------
    known : By quantity, what counts.
    overruled : By quantity, what does not, in the order in which it would.
    bad : By quantity, the impossible entries of the header; a quantity of which one of
        them counts is not known.
    plate : The plate.
    notes : One sentence for each thing that was assumed.
    searched : The files beside the header, for saying where something was not found.
    settings : The settings that hold for the plate.
    """

    known: Mapping[str, SourcedValue]
    overruled: Mapping[str, tuple[SourcedValue, ...]] = field(default_factory=dict)
    bad: Mapping[str, tuple[BadEntry, ...]] = field(default_factory=dict)
    plate: Path = Path()
    notes: tuple[str, ...] = ()
    searched: tuple[str, ...] = ()
    settings: Settings = field(default_factory=Settings)

    def number(self, name: str) -> float | None:
        """The value of a quantity that is a number."""
        found = self.known.get(name)
        return None if found is None else float(found.value)

    def checked(self) -> "PlateCamera":
        """The same.

        Raises
        ------
        ImageError : An impossible entry stands where something would count on which a
            frame depends.
        """
        needed = [*_DECIDING]
        if "vertical_fov_deg" in self.known:
            needed.append("sensor_height_mm")
        for name in needed:
            for entry in self.bad.get(name, ()):
                if entry.counts:
                    raise entry.error
        return self

    def focused(self, distance: SourcedValue) -> "PlateCamera":
        """The same, focused at a distance that the user picked."""
        return self.with_known("focus_distance_mm", distance)

    def with_known(
        self, name: str, value: SourcedValue, note: str | None = None
    ) -> "PlateCamera":
        """The same with another value of a quantity, and a note on it."""
        notes = self.notes if note is None else (*self.notes, note)
        return replace(self, known={**self.known, name: value}, notes=notes)

    @property
    def state(self) -> CameraState:
        """As a header would say it; a focus distance from the pinhole is not in it."""
        names = CameraState.__dataclass_fields__.keys() - {"sources"}
        kept = {n: k for n, k in self.known.items() if n in names and not k.from_pupil}
        values = {name: known.value for name, known in kept.items()}
        sources = {name: known.source for name, known in kept.items()}
        return CameraState(**values, sources=sources)  # pyright: ignore[reportArgumentType]
