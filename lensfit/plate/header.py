"""The header of a plate of any kind: flat or deep."""

from pathlib import Path

from lensfit.io.exr import ExrImage, read_exr
from lensfit.io.exr_deep import is_deep, read_deep


def plate_header(path: Path) -> ExrImage:
    """A plate without its pixels; a deep one as if it were flat."""
    if is_deep(path):
        return ExrImage((read_deep(path).flat,))
    return read_exr(path, header_only=True)


def header_entries(image: ExrImage) -> dict[str, object]:
    """The attributes of all parts; where two differ the first part's count."""
    return {k: v for p in reversed(image.parts) for k, v in p.attributes.items()}
