"""An f-number that looks like another quantity.

The standard attribute ``aperture`` is the f-number, and renderers write the width of
the film back under that name. A photographic lens closes to f/22 or f/32 at most, and
none in air is faster than f/0.5, the limit that the sine condition sets.
"""

from lensfit.plate.camera.plate_camera import PlateCamera

LARGEST = 22.7
"""f/22 is f/22.63; cinema lenses end there."""
FASTEST = 0.5


def f_number_doubt(camera: PlateCamera) -> str | None:
    """What is to be said of the f-number; None if nothing is, or the user stated it."""
    known = camera.known.get("f_number")
    if known is None or known.source.startswith("--"):
        return None
    value = float(known.value)
    if FASTEST <= value <= LARGEST:
        return None
    looks = "a film back in mm" if value > LARGEST else "another quantity"
    return (
        f"{camera.plate.name}: the f-number is {value:g} ({known.source}), which looks "
        f"like {looks} (--f-number states another)"
    )
