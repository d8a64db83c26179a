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

The sensor width that a plate spans is compared with the one that was photographed.
Beyond the photographed width the map is extrapolated by its terms. A small
extrapolation is noted; a large one means a wrong unit or another camera, and is
refused.
"""

import math
from typing import TYPE_CHECKING, NamedTuple

from lensfit.errors import ImageError, LensfitError

if TYPE_CHECKING:
    from lensfit.preset.schema import Preset

LARGEST_PART = 1.25
"""Of the width that was photographed; farther out the map is none."""
LEAST_PART = 0.12
"""Of the same: a smaller one may be in centimetres."""
_LEAST_MM = 0.01
"""Less is no sensor but another unit, or a slip."""
_SAME_WIDTH = 1.001
_OPTION = "--sensor-width-mm"
SCALING_OPTION = "--scale-to-sensor"
SCALING_REMEDY = (
    f"with {SCALING_OPTION} (of apply, submit, plan, stmap, overscan and view)"
)
"""Where a look is wanted that was not measured: what puts it there."""
_MAPS_REMEDY = f"by the UV maps of `lensfit stmap {SCALING_OPTION}`"


def check_width(width_mm: float) -> None:
    """Refuse what is no width of a sensor.

    Raises
    ------
    ImageError : It is none.
    """
    if not _LEAST_MM <= width_mm < math.inf:
        raise ImageError(
            f"the sensor is stated to be {width_mm:g} mm wide",
            remedy=f"give its width with {_OPTION}",
        )


def unscaled_error(error: LensfitError) -> LensfitError:
    """The same error, of a command that scales no look itself: its maps do."""
    if error.remedy is None or SCALING_REMEDY not in error.remedy:
        return error
    remedy = error.remedy.replace(SCALING_REMEDY, _MAPS_REMEDY)
    return type(error)(error.what, where=error.where, remedy=remedy)


def spanned_width_note(width_mm: float, measured_mm: float) -> str | None:
    """A note on the width that a frame spans; None if none is needed.

    Parameters
    ----------
    measured_mm : Width that the lens was photographed over.

    Raises
    ------
    ImageError : It is no width, or the lens is not known that far out.
    """
    check_width(width_mm)
    if width_mm > LARGEST_PART * measured_mm:
        raise ImageError(
            f"the plate spans {width_mm:g} mm and the lens was photographed over "
            f"{measured_mm:g} mm, which serves up to {LARGEST_PART * measured_mm:g} mm",
            remedy=f"make sure that this is in mm ({_OPTION}); for a larger sensor "
            f"photograph the lens on it, or put its look there {SCALING_REMEDY}",
        )
    if width_mm > _SAME_WIDTH * measured_mm:
        return (
            f"the plate spans {width_mm:g} mm and the lens was photographed over "
            f"{measured_mm:g} mm: the rest is extrapolated"
        )
    if width_mm < LEAST_PART * measured_mm:
        return (
            f"the plate spans {width_mm:g} mm of the {measured_mm:g} mm that the lens "
            f"was photographed over: make sure that this is in mm ({_OPTION})"
        )
    return None


def check_corners(
    spanned_mm: tuple[float, float], measured_mm: tuple[float, float]
) -> None:
    """Refuse a frame whose corners lie far outside of what was photographed, as those
    of a tall one may: `spanned_width_note` looks at its width alone.

    Raises
    ------
    ImageError : The lens is not known that far out.
    """
    if math.hypot(*spanned_mm) <= LARGEST_PART * math.hypot(*measured_mm):
        return
    width_mm, height_mm = spanned_mm
    raise ImageError(
        f"the plate spans {width_mm:g} x {height_mm:g} mm and the lens was "
        f"photographed over {measured_mm[0]:g} x {measured_mm[1]:g} mm",
        remedy=f"state the width of this frame in mm ({_OPTION})",
    )


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
    preset: "Preset", focal_length_mm: float | None, sensor_width_mm: float | None
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
