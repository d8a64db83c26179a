"""A limit on the decoded size of a photograph.

A compressed file of a few hundred kilobytes can claim gigabytes of one value. Sensors
have noise, so a photograph never compresses that far. Beyond a size that uncompressed
photographs of every camera stay below, the file must be large enough for the claimed
size.
"""

from lensfit.errors import ImageError

ALWAYS_SAMPLES = 1 << 28
"""A picture of 89 million pixels in three colours."""
LARGEST_RATIO = 64
"""Of samples to bytes of a larger one."""


def refuse_oversize(samples: int, file_bytes: int) -> None:
    """Refuse a photograph that would fill memory, before it is decoded.

    Parameters
    ----------
    samples : Pixels times channels, of all parts.
    file_bytes : Of the file.

    Raises
    ------
    ImageError : More samples than a photograph of that many bytes has.
    """
    if samples > max(ALWAYS_SAMPLES, LARGEST_RATIO * file_bytes):
        raise ImageError(
            f"claims {samples / 1e6:.0f} million samples in {file_bytes} bytes, more "
            "than any photograph",
            remedy="crop it, or leave out the channels that are no colours",
        )
