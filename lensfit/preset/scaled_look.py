"""Scale a measured lens to a focal length or sensor that it was not measured at.

A lens made k times as large images a scene k times as large onto a sensor k times as
wide in the same picture: its distortion and aberrations keep their field angles, and
their share of the frame. So the plate's camera is divided by its focal length over the
measured one, with its distances. Where its frame sees wider angles than were
photographed, its whole width is mapped to the whole photographed one: the look then
keeps its places in the frame. The transition between both is continuous. Distances are
divided so that the circle of confusion keeps its share of the frame, as the CG camera's
own focal length, f-number and sensor give it.

Diffraction scales with the rest, as if the wavelength did.
"""

from typing import NamedTuple

from lensfit.preset.schema import Preset
from lensfit.preset.spanned_width import SCALING_OPTION, check_width

_SAME = 1e-6


class ScaledLook(NamedTuple):
    """How the camera of a plate stands for the one that the lens was measured on.

    Attributes
    ----------
    focal_length_mm, sensor_width_mm : Of the plate's camera.
    measured_focal_length_mm, measured_width_mm : What stands for them.
    """

    focal_length_mm: float
    sensor_width_mm: float
    measured_focal_length_mm: float
    measured_width_mm: float

    @classmethod
    def of(
        cls,
        focal_length_mm: float,
        sensor_width_mm: float,
        measured_focal_lengths_mm: list[float],
        photographed_width_mm: float,
    ) -> "ScaledLook":
        """The scaling that a plate needs; `UNSCALED` where the lens was measured so.

        Parameters
        ----------
        focal_length_mm, sensor_width_mm : Of the plate's camera.
        measured_focal_lengths_mm : Of the preset.
        photographed_width_mm : Of the sensor that the lens was photographed on.

        Raises
        ------
        ImageError : The plate's sensor has no width.
        """
        check_width(sensor_width_mm)
        shortest, longest = (
            min(measured_focal_lengths_mm),
            max(measured_focal_lengths_mm),
        )
        measured = min(max(focal_length_mm, shortest), longest)
        by_angle_mm = sensor_width_mm * measured / focal_length_mm
        width_mm = min(by_angle_mm, photographed_width_mm)
        found = cls(focal_length_mm, sensor_width_mm, measured, width_mm)
        is_needed = max(abs(found.angles - 1), abs(found.lengths - 1)) > _SAME
        return found if is_needed else UNSCALED

    @property
    def angles(self) -> float:
        """Focal length of the plate's camera over the measured one."""
        return self.focal_length_mm / self.measured_focal_length_mm

    @property
    def lengths(self) -> float:
        """Millimetres of the plate's sensor for each of the measured one."""
        return self.sensor_width_mm / self.measured_width_mm

    @property
    def distances(self) -> float:
        """Millimetres of the plate's scene for each before the measured lens."""
        return self.angles**2 / self.lengths

    def measured_state(
        self, focal_length_mm: float | None, focus_distance_mm: float | None
    ) -> tuple[float | None, float | None]:
        """Focal length and focus of the measured lens that stand for the plate's."""
        if self == UNSCALED:
            return focal_length_mm, focus_distance_mm
        focus = focus_distance_mm
        focus = None if focus is None else focus / self.distances
        return self.measured_focal_length_mm, focus

    def plate_state(
        self, focal_length_mm: float | None, focus_distance_mm: float | None
    ) -> tuple[float | None, float | None]:
        """Focal length and focus of the plate's camera; inverse of `measured_state`."""
        focal, focus = focal_length_mm, focus_distance_mm
        return (
            None if focal is None else focal * self.angles,
            None if focus is None else focus * self.distances,
        )

    @property
    def note(self) -> str | None:
        """A note on it; None if nothing is scaled."""
        if self == UNSCALED:
            return None
        look = (
            f"the look of {self.measured_focal_length_mm:g} mm on "
            f"{self.measured_width_mm:.4g} mm of the photographed sensor is put on "
            f"{self.focal_length_mm:g} mm on {self.sensor_width_mm:g} mm "
            f"({SCALING_OPTION}), "
        )
        if abs(self.lengths - self.angles) <= _SAME * self.lengths:
            return f"{look}by field angle"
        return (
            f"{look}in units of the frame, which sees wider angles than were "
            "photographed"
        )


UNSCALED = ScaledLook(1.0, 1.0, 1.0, 1.0)
"""A camera as it stands."""


def scaled_look(
    preset: Preset, focal_length_mm: float | None, sensor_width_mm: float | None
) -> ScaledLook:
    """The scaling of a preset to a camera.

    A prime's own focal length and the photographed sensor stand for unstated ones.
    Which focal length of a zoom is meant must be known: nothing is scaled otherwise.

    Raises
    ------
    ImageError : The sensor has no width.
    """
    measured = [entry.focal_length_mm for entry in preset.entries]
    if focal_length_mm is None and len(set(measured)) > 1:
        return UNSCALED
    own_mm = preset.camera.sensor_width_mm
    return ScaledLook.of(
        measured[0] if focal_length_mm is None else focal_length_mm,
        own_mm if sensor_width_mm is None else sensor_width_mm,
        measured,
        own_mm,
    )
