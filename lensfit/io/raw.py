"""Camera raw files (DNG, ARW, CR3, NEF, ...) as scene-linear camera RGB.

Decoded by LibRaw through the optional extra ``lensfit[raw]``: black subtracted, no
curve, no white balance and no colour matrix, so that 1 is the saturation of each
channel's own photosites. Missing colours are interpolated linearly, which moves no
edge; sharper methods guess, and their guesses show in dot positions.
"""

from pathlib import Path

import numpy as np
from jaxtyping import Float32

from lensfit.errors import ImageError

_MAKERS = "dng arw cr2 cr3 crw nef nrw raf rw2 orf pef srw iiq 3fr raw rwl"
RAW_SUFFIXES = frozenset(f".{name}" for name in _MAKERS.split(" "))
"""File names that mark a camera raw; most of them are TIFF inside."""


def read_raw(path: Path) -> Float32[np.ndarray, "height width 3"]:
    """Camera RGB, 0 black and 1 saturated, turned upright as the camera noted.

    Raises
    ------
    ImageError : rawpy is not installed, or LibRaw cannot read the file.
    """
    try:
        import rawpy  # pyright: ignore[reportMissingImports]
    except ImportError:
        raise ImageError(
            "is a camera raw file, which needs rawpy",
            where=path,
            remedy="install it with: pip install 'lensfit[raw]'",
        ) from None
    try:
        with rawpy.imread(str(path)) as raw:
            codes = raw.postprocess(
                demosaic_algorithm=rawpy.DemosaicAlgorithm.LINEAR,
                gamma=(1, 1),
                output_bps=16,
                no_auto_bright=True,
                user_wb=[1.0, 1.0, 1.0, 1.0],
                output_color=rawpy.ColorSpace.raw,
            )
    except rawpy.LibRawError as error:
        raise ImageError(f"cannot be decoded ({error})", where=path) from error
    return codes.astype(np.float32) / np.float32(65535)
