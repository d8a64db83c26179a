"""Camera raw files (DNG, ARW, CR3, NEF, ...) as scene-linear camera RGB.

Decoded by LibRaw through the optional extra ``lensfit[raw]``: black subtracted, no
curve, no white balance and no colour matrix, so that 1 is the saturation of each
channel's own photosites. Missing colours are interpolated linearly, which moves no
edge; sharper methods guess, and their guesses show in dot positions. What was measured
stays as it was, and the mosaic that says where is handed on.
"""

from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float32

from lensfit.errors import ImageError
from lensfit.io.raster import upright_pixels
from lensfit.mosaic import Mosaic, mosaic_of

_NAMES = "dng arw cr2 cr3 crw nef nrw raf rw2 orf pef srw iiq 3fr raw rwl"
RAW_SUFFIXES = frozenset(f".{name}" for name in _NAMES.split())
"""File names that mark a camera raw; most of them are TIFF inside."""
_ORIENTATION_OF_FLIP = {0: 1, 3: 3, 5: 8, 6: 6}
"""EXIF orientation by LibRaw's number."""


def read_raw(
    path: Path,
) -> tuple[Float32[np.ndarray, "height width 3"], Mosaic | None]:
    """Camera RGB, 0 black and 1 saturated, turned upright as the camera noted; and its
    mosaic, turned as well. That is None where photosites lie in no 2 x 2 pattern.

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
            mosaic = _mosaic_of(raw, codes.shape[:2])
    except rawpy.LibRawError as error:
        raise ImageError(f"cannot be decoded ({error})", where=path) from error
    return codes.astype(np.float32) / np.float32(65535), mosaic


def _mosaic_of(raw: Any, shape: tuple[int, int]) -> Mosaic | None:
    """The mosaic of a picture of that height and width that LibRaw made."""
    colours, orientation = (
        raw.raw_colors_visible,
        _ORIENTATION_OF_FLIP.get(raw.sizes.flip),
    )
    if orientation is None or sorted(colours.shape) != sorted(shape):
        return None
    period = [colours[:-2] == colours[2:], colours[:, :-2] == colours[:, 2:]]
    if not all(same.all() for same in period):
        return None
    height, width = colours.shape
    few = colours[: 2 + height % 2, : 2 + width % 2]
    letters = np.array(list(raw.color_desc.decode().lower()))[few]
    try:
        return mosaic_of(upright_pixels(letters, orientation))
    except ValueError:
        return None
