"""Compare the sensor width that a plate spans with the one that was photographed.

Beyond the photographed width the map is extrapolated by its terms. A small
extrapolation is noted; a large one means a wrong unit or another camera, and is
refused.
"""

import math

from lensfit.errors import ImageError, LensfitError

LARGEST_PART = 1.25
"""Of the width that was photographed; farther out the map is none."""
LEAST_PART = 0.12
"""Of the same: a smaller one may be in centimetres."""
_LEAST_MM = 0.01
"""Less is no sensor but another unit, or a slip."""
_SAME = 1.001
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
    if width_mm > _SAME * measured_mm:
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
