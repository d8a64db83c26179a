"""A limit on the decoded size of a picture.

A compressed file of a few megabytes can hold, or claim, tens of gigabytes of one value.
So before a picture is decoded, what it and the work on it take is computed from its
header, and compared with the memory that is there.
"""

from pathlib import Path

from lensfit.errors import ImageError
from lensfit.memory import available_bytes

PHOTOGRAPH_BYTES_PER_PX = 24
"""Of the work on a photograph: its colours as float, twice."""
RASTER_BYTES_PER_SAMPLE = 12
"""Of PNG and TIFF, decoded: the code, and the light as float, twice."""


def refuse_beyond_memory(needed_bytes: int, path: Path | None = None) -> None:
    """Refuse a picture that would fill the memory, before it is decoded.

    Parameters
    ----------
    needed_bytes : Of all samples of the file, decoded, and of the work on them.
    path : The file; None where whoever asked names it.

    Raises
    ------
    ImageError : More than is available.
    """
    available = available_bytes()
    if available is not None and needed_bytes > available:
        raise ImageError(
            f"takes {_gib(needed_bytes)} GiB of memory when decoded, and "
            f"{_gib(available)} GiB are available",
            where=path,
            remedy="crop it, leave out channels, or use a machine with more memory",
        )


def _gib(count: int) -> str:
    return f"{count / 2**30:.3g}"
