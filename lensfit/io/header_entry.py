"""One entry of a header: whether a name matches it, and the number that it holds.

Numbers may be strings. Names with a slash may have any prefix (Nuke shows
``exr/lens/focal``), others only ``exr/``, so that a renderer's own ``aperture`` is not
taken for the standard one. EXIF (whose names begin with a capital) writes 0 for what it
does not know, which counts as missing.
"""

import math

from lensfit.errors import ImageError
from lensfit.io.camera.aliases import Alias

_EXIF_INFINITY = 2**32 - 1
_MAY_BE_ZERO = ("overscan_percent",)
_MAY_BE_INFINITE = ("focus_distance_mm",)


def is_entry_of_alias(key: str, alias: str) -> bool:
    """Whether a header's `key` is the entry called `alias`."""
    if key == alias:
        return True
    prefix = key.removesuffix(f"/{alias}")
    if prefix == key:
        return False
    return "/" in alias or prefix.split("/")[-1] == "exr"


def is_exif(key: str) -> bool:
    """Whether the entry is one of EXIF's."""
    return key[0].isupper()


def entry_text(value: object) -> str | None:
    """What an entry says in words; None where it says nothing."""
    return str(value).split("\0")[0].strip() or None


def entry_quantity(name: str, key: str, value: object, alias: Alias) -> float | None:
    """An entry as the quantity called `name`, in its unit; None where it is missing.

    Raises
    ------
    ImageError : It holds no number, or one that the quantity cannot have.
    """
    number = number_in(key, value)
    if is_exif(alias.key):
        if number == _EXIF_INFINITY:
            number = math.inf
        elif math.isnan(number) or number == 0:
            return None
    too_small = number < 0 or (number == 0 and name not in _MAY_BE_ZERO)
    if math.isnan(number) or too_small:
        raise impossible_value_error(key, value, "a number above zero")
    if math.isinf(number) and name not in _MAY_BE_INFINITE:
        raise impossible_value_error(key, value, "a finite number")
    # Single-precision headers: 1.4 is stored as 1.39999998.
    return float(f"{number * alias.factor:.7g}")


def number_in(key: str, value: object) -> float:
    """An entry as a plain number; NaN for a fraction of nothing.

    Raises
    ------
    ImageError : It is none.
    """
    try:
        return float(value)  # pyright: ignore[reportArgumentType]
    except ZeroDivisionError:
        return math.nan
    except (TypeError, ValueError, OverflowError):
        raise impossible_value_error(key, value, "a number") from None


def impossible_value_error(key: str, value: object, expected: str) -> ImageError:
    """An entry that holds what it cannot be."""
    shown = " ".join(str(value).split())[:40]
    return ImageError(
        f"header entry {key!r} is {shown!r} and should be {expected}",
        remedy="mend it, or state the value yourself",
    )
