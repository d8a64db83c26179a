"""Any photograph as scene-linear light: the one door through which pictures come in.

EXR, raw and floating-point TIFF are taken as linear; 8 and 16 bit files as sRGB, unless
the shoot file says otherwise. Alpha is dropped. The EXIF orientation is honoured: row 0
is on top of the scene as the camera noted it, so pictures taken upright have their
sensor's sides swapped. EXR photographs are the display window, cropped from or padded
with black to it.

Camera raw files (DNG, ARW, CR3, NEF, ...) are decoded by LibRaw through the optional
extra ``lensfit[raw]``: black subtracted, no curve, no white balance and no colour
matrix, so that 1 is the saturation of each channel's own photosites. Missing colours
are interpolated linearly, which moves no edge; sharper methods guess, and their guesses
show in dot positions. What was measured stays as it was, and the mosaic that says where
is handed on.

Where a floating point photograph is clipped, although nothing says so.

A sensor's noise gives the brightest pixels of a picture values of their own; where it
clips, many have the very same one, and few lie just below it. A picture with a large
bright ground that was drawn rather than photographed has such values too: a plateau
that covers much of the picture is not taken for clipping.
"""

import hashlib
from collections.abc import Mapping
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from jaxtyping import Float, Float32

from lensfit.bounded import refuse_pipe
from lensfit.chroma import codes_with_fringes
from lensfit.coords import pixels_over_window
from lensfit.errors import ImageError
from lensfit.io.decoding import PHOTOGRAPH_BYTES_PER_PX
from lensfit.io.exr import find_colour, read_exr, stack_channels
from lensfit.io.exr_header import MAGIC as EXR_MAGIC
from lensfit.io.metadata import CameraState, camera_state_from
from lensfit.io.raster import Raster, read_raster, tiff_header, upright_pixels
from lensfit.io.transfer import decode, encode, transfer_of
from lensfit.mosaic import Mosaic, filled_in, letters_of, mosaic_of
from lensfit.photograph import Photograph

_NAMES = "dng arw cr2 cr3 crw nef nrw raf rw2 orf pef srw iiq 3fr raw rwl"
RAW_SUFFIXES = frozenset(f".{name}" for name in _NAMES.split())
"""File names that mark a camera raw; most of them are TIFF inside."""
_ORIENTATION_OF_FLIP = {0: 1, 3: 3, 5: 8, 6: 6}
"""EXIF orientation by LibRaw's number."""
_FEWEST_PIXELS = 16
_LARGEST_SHARE = 0.25
_JUST_BELOW = 0.97


def ceiling_of(pixels: Float[np.ndarray, "height width channels"]) -> float:
    """Value at which the photograph clips; infinite if no channel shows that it does.

    The lowest of the channels' ceilings, since one number stands for all.
    """
    found = [_channel_ceiling(pixels[..., k]) for k in range(pixels.shape[2])]
    return min(found, default=float("inf"))


def _channel_ceiling(channel: Float[np.ndarray, "height width"]) -> float:
    top = float(np.nanmax(channel, initial=0.0))
    if not 0 < top < np.inf:
        return float("inf")
    near = channel[channel >= _JUST_BELOW * top]
    at_top = int(np.count_nonzero(near == top))
    enough = _FEWEST_PIXELS <= at_top <= _LARGEST_SHARE * channel.size
    return top if enough and 2 * at_top > near.size else float("inf")


MID_GREY = 0.18
_LYING = (5, 6, 7, 8)
"""EXIF orientations of pictures that are stored with their sides swapped."""


def read_photograph(
    path: str | Path, encoding: str | None = None, mosaic: Mosaic | None = None
) -> Photograph:
    """Read a photograph and decode it to scene-linear light.

    Parameters
    ----------
    path : EXR, PNG, TIFF, JPEG or camera raw.
    encoding : One of `lensfit.io.transfer.ENCODINGS`; by default "linear" for EXR, raw
        and floating-point TIFF, "srgb" for the rest.
    mosaic : Which channel each pixel of the file measured, from the top left as it is
        stored; where the file has one channel, that is the mosaic itself and colours
        are interpolated. Without meaning for a raw file, which knows its own, and
        where red and blue are stored at lower resolution, so that nothing is as it was
        measured.

    Returns
    -------
    The photograph. Its `metadata` holds "format", "bit_depth", "orientation", the
    fields of `CameraState` that are known, "sources" of these, and "header", the
    entries as they are in the file. If an entry about the camera is malformed,
    "camera_problem" says so instead of those fields.

    Raises
    ------
    ImageError : The file is missing, empty, damaged or of an unknown kind, or the
        encoding is unknown.
    """
    path = Path(path)
    if encoding is not None:
        transfer_of(encoding)
    data = _read_bytes(path)
    try:
        return _from_mosaic(_read(path, data, encoding), mosaic)
    except ImageError as error:
        if error.where is not None:
            raise
        raise ImageError(error.what, where=path, remedy=error.remedy) from error


def is_linear_file(path: str | Path, encoding: str | None = None) -> bool:
    """Whether `read_photograph` takes a file for linear, by its name alone; of a
    floating-point TIFF only its content says so.

    Parameters
    ----------
    encoding : As stated.
    """
    if encoding is not None:
        return encoding == "linear"
    return Path(path).suffix.lower() in {".exr", *RAW_SUFFIXES}


def is_of_unknown_encoding(photograph: Photograph) -> bool:
    """Whether its file may hold linear samples or sRGB ones, and does not say which.

    JPEG and 8-bit PNG are sRGB in practice; integer TIFF and 16-bit PNG may be either.
    """
    form, bits = photograph.metadata["format"], photograph.metadata["bit_depth"]
    if photograph.encoding != "srgb":
        return False
    return form == "tiff" or (form == "png" and bits == 16)


def camera_state_of(photograph: Photograph) -> CameraState:
    """The camera state that a photograph's header describes, with sources.

    Raises
    ------
    ImageError : An entry about the camera is malformed; the error names it.
    """
    header = photograph.metadata["header"]
    assert isinstance(header, Mapping)
    try:
        return camera_state_from(header, photograph.size_px)
    except ImageError as error:
        where = photograph.path
        raise ImageError(error.what, where=where, remedy=error.remedy) from error


def _read_bytes(path: Path) -> bytes:
    try:
        refuse_pipe(path, error=ImageError, remedy="give a picture")
        data = path.read_bytes()
    except OSError as error:
        reason = error.strerror or str(error)
        raise ImageError(
            f"cannot be read ({reason})",
            where=path,
            remedy="give the path of a picture that is there and may be read",
        ) from error
    if not data:
        raise ImageError("is empty", where=path, remedy="copy it again")
    return data


def _read(path: Path, data: bytes, encoding: str | None) -> Photograph:
    if data.startswith(EXR_MAGIC):
        return _from_exr(path, data, encoding or "linear")
    if path.suffix.lower() in RAW_SUFFIXES:
        return _from_raw(path, data, encoding or "linear")
    return _from_raster(path, data, read_raster(data), encoding)


def _from_mosaic(photograph: Photograph, mosaic: Mosaic | None) -> Photograph:
    """With the mosaic as it lies on the picture, turned upright as that was."""
    if mosaic is None or photograph.mosaic or photograph.chroma_subsampled:
        return photograph
    orientation = photograph.metadata["orientation"]
    turned = orientation if isinstance(orientation, int) else 1
    width, height = photograph.size_px
    stored = (height, width) if turned in _LYING else (width, height)
    mosaic = mosaic_of(upright_pixels(letters_of(mosaic, stored), turned))
    pixels = photograph.pixels
    if pixels.shape[2] == 1:
        pixels = filled_in(np.repeat(pixels, 3, axis=2), mosaic)
    return replace(photograph, pixels=pixels, mosaic=mosaic)


def _from_exr(path: Path, data: bytes, encoding: str) -> Photograph:
    image = read_exr(path, working_bytes_per_px=PHOTOGRAPH_BYTES_PER_PX)
    index, names = find_colour(image)
    part = image.parts[index]
    stored = stack_channels(part, names)
    pixels = np.ascontiguousarray(
        pixels_over_window(stored, part.data_window, part.display_window)
    )
    if encoding != "linear":
        pixels = decode(pixels, encoding).astype(np.float32)
    depth = {"float16": 16}.get(str(part.channels[names[0]].dtype), 32)
    metadata = {"format": "exr", "bit_depth": depth, "orientation": 1}
    metadata |= {"data_window": part.data_window, "display_window": part.display_window}
    return Photograph(
        pixels=pixels,
        path=path,
        sha256=hashlib.sha256(data).hexdigest(),
        encoding=encoding,
        saturation=ceiling_of(pixels),
        metadata=metadata | _camera(part.attributes, pixels),
    )


def _from_raw(path: Path, data: bytes, encoding: str) -> Photograph:
    if encoding != "linear":
        raise ImageError("is a camera raw file, which is linear", where=path)
    pixels, mosaic = read_raw(path)
    metadata = {"format": "raw", "bit_depth": 16, "orientation": 1}
    return Photograph(
        pixels=pixels,
        path=path,
        sha256=hashlib.sha256(data).hexdigest(),
        saturation=1.0,
        quantisation_step=1 / 65535,
        mosaic=mosaic,
        metadata=metadata | _camera(tiff_header(data), pixels),
    )


def _from_raster(
    path: Path, data: bytes, raster: Raster, encoding: str | None
) -> Photograph:
    codes = raster.codes
    if codes.dtype.kind == "f":
        encoding = encoding or "linear"
        pixels = codes if encoding == "linear" else decode(codes, encoding)
        pixels, step = pixels.astype(np.float32), 0.0
        saturation = ceiling_of(pixels)
    else:
        encoding = encoding or "srgb"
        table = _decoding_table(encoding, codes.dtype.itemsize)
        saturation, step = float(table[-1]), _step_at_grey(table, encoding)
        if raster.chroma is not None:
            finer = codes_with_fringes(codes, raster.chroma)
            pixels = _decoding_table(encoding, finer.dtype.itemsize)[finer]
        elif codes.dtype == np.uint8:
            pixels = cv2.LUT(codes, table).reshape(codes.shape)
        else:
            pixels = table[codes]
    metadata = {
        "format": raster.format,
        "bit_depth": 8 * codes.dtype.itemsize,
        "orientation": raster.header.get("Orientation", 1),
    }
    return Photograph(
        pixels=pixels,
        path=path,
        sha256=hashlib.sha256(data).hexdigest(),
        encoding=encoding,
        saturation=saturation,
        quantisation_step=step,
        chroma_subsampled=raster.chroma is not None,
        metadata=metadata | _camera(raster.header, pixels),
    )


@cache
def _decoding_table(encoding: str, code_bytes: int) -> Float32[np.ndarray, " codes"]:
    """Light of every code: a table is the fastest curve there is."""
    codes = np.linspace(0.0, 1.0, 256**code_bytes)
    return decode(codes, encoding).astype(np.float32)


def _step_at_grey(table: Float32[np.ndarray, " codes"], encoding: str) -> float:
    grey = round(float(encode(np.array(MID_GREY), encoding)) * (len(table) - 1))
    return float(np.diff(table[grey - 1 : grey + 2]).max())


def _camera(header: Mapping[str, object], pixels: np.ndarray) -> dict[str, object]:
    entries: dict[str, object] = {"header": dict(header)}
    try:
        state = camera_state_from(header, (pixels.shape[1], pixels.shape[0]))
    except ImageError as error:
        return entries | {"camera_problem": str(error), "sources": {}}
    return entries | state.known() | {"sources": dict(state.sources)}


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
