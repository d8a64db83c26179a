"""PNG, JPEG and TIFF files as code values: what is stored, not yet light.

The format is recognised by the file's first bytes, never by its name. Damaged files
are refused: a JPEG with half of its lines grey would give a lens with half of its dots.
Rows are turned upright as the EXIF orientation asks.
"""

import io
import logging
import struct
import zlib
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import cv2
import numpy as np
import tifffile
from PIL import ExifTags, Image

from lensfit.chroma import ChromaBlocks
from lensfit.errors import ImageError
from lensfit.io.decoding import (
    RASTER_BYTES_PER_SAMPLE,
    refuse_beyond_memory,
    silenced_libraries,
)

# It logs every odd tag; who reads its log may still listen.
logging.getLogger("tifffile").addHandler(logging.NullHandler())

_PNG = b"\x89PNG\r\n\x1a\n"
_JPEG = b"\xff\xd8\xff"
_TIFF = (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+")
# A black PNG compresses about a thousand times (zlib's limit).
_LARGEST_PNG_RATIO = 1100
_PNG_CHANNELS = {0: 1, 2: 3, 3: 3, 4: 2, 6: 4}
"""By colour type."""
_MINISWHITE, _MINISBLACK, _RGB, _YCBCR, _CFA = 0, 1, 2, 6, 32803
_PHOTOMETRIC = {3: "palette", 4: "mask", 5: "CMYK", _YCBCR: "YCbCr", 8: "CIE L*a*b*"}
_PHOTOMETRIC |= {9: "ICC L*a*b*", 10: "ITU L*a*b*", 32844: "LogL", 32845: "LogLuv"}
"""TIFF 6.0 and its supplements: what samples mean."""
_JPEG_COMPRESSIONS = (6, 7)
"""Their decoder returns RGB."""


@dataclass(frozen=True, eq=False)
class Raster:
    """Decoded code values of a picture file.

    Attributes
    ----------
    codes : uint8, uint16 or float32, upright; height x width x channels, of which there
        is one, or r, g, b.
    format : "png", "jpeg" or "tiff".
    chroma : Pixels that share one value of colour, upright; None where none do.
    header : EXIF or TIFF tags by name.
    """

    codes: np.ndarray
    format: str
    chroma: ChromaBlocks | None = None
    header: Mapping[str, object] = field(default_factory=dict)


def read_raster(data: bytes) -> Raster:
    """Decode a PNG, JPEG or TIFF file.

    Raises
    ------
    ImageError : Another format, damaged, or colours that are no grey or RGB.
    """
    if not data:
        raise ImageError("is empty")
    if data.startswith(_PNG):
        raster = _read_png(data)
    elif data.startswith(_JPEG):
        raster = _read_jpeg(data)
    elif data.startswith(_TIFF):
        raster = _read_tiff(data)
    else:
        raise ImageError(
            "is no photograph that lensfit reads",
            remedy="give EXR, TIFF, PNG, JPEG or a camera raw file",
        )
    orientation = raster.header.get("Orientation", 1)
    turned = orientation if isinstance(orientation, int) else 1
    chroma = raster.chroma and _upright_blocks(raster.chroma, raster.codes, turned)
    codes = upright_pixels(raster.codes, turned)
    return replace(raster, codes=codes, chroma=chroma)


def upright_pixels(codes: np.ndarray, orientation: int) -> np.ndarray:
    """Pixels turned and mirrored as the EXIF orientation, 1 to 8, asks."""
    mirrored = {2: codes[:, ::-1], 4: codes[::-1], 5: codes, 7: codes[::-1, ::-1]}
    turned = mirrored.get(orientation, codes)
    if orientation == 3:
        turned = codes[::-1, ::-1]
    elif orientation == 6:
        turned = np.rot90(codes, -1)
    elif orientation == 8:
        turned = np.rot90(codes)
    elif orientation in (5, 7):
        turned = turned.swapaxes(0, 1)
    return np.ascontiguousarray(turned)


def _upright_blocks(
    blocks: ChromaBlocks, codes: np.ndarray, orientation: int
) -> ChromaBlocks:
    """Those of the picture turned by `upright_pixels`."""
    # As few pixels as have the picture's borders and whole blocks each way.
    size = np.array(blocks.size_px[::-1])
    rows, columns = np.array(codes.shape[:2]) % size + 3 * size
    number = np.indices((int(rows), int(columns))) // size[:, None, None]
    upright = upright_pixels(np.moveaxis(number, 0, -1), orientation)
    along = upright[0], upright[:, 0]
    begins = [np.flatnonzero(np.diff(line, axis=0).any(-1)) + 1 for line in along]
    right, down = (int(np.diff(b)[0]) for b in begins)
    first = (int(begins[0][0]) % right, int(begins[1][0]) % down)
    return ChromaBlocks((right, down), first)


def tiff_header(data: bytes) -> dict[str, object]:
    """Tags of the first page of a TIFF-like file, with its EXIF block if it has one.

    Raw files of many makers are TIFF inside. Empty when the file is none.
    """
    try:
        with tifffile.TiffFile(io.BytesIO(data)) as file:
            return _tags(file.pages[0])  # pyright: ignore[reportArgumentType]
    except Exception:  # tifffile raises whatever broke in it
        return {}


def _read_jpeg(data: bytes) -> Raster:
    try:
        with Image.open(io.BytesIO(data)) as image:
            if image.mode not in ("L", "RGB"):
                raise _unknown_colours(image.mode)
            codes = np.asarray(image)
            header = _exif(image)
            layers = getattr(image, "layer", [])
    except (OSError, SyntaxError, ValueError, Image.DecompressionBombError) as error:
        raise _damage_error("JPEG", error) from error
    return Raster(_with_channel_axis(codes), "jpeg", _chroma_blocks(layers), header)


def _chroma_blocks(layers: list[tuple[int, int, int, int]]) -> ChromaBlocks | None:
    """Of the layers of a JPEG file, as Pillow has them: samples across and down."""
    if len(layers) != 3:
        return None
    (_, across, down, _), *colour = layers
    size = (across // min(c[1] for c in colour), down // min(c[2] for c in colour))
    return ChromaBlocks(size) if max(size) > 1 else None


def _read_png(data: bytes) -> Raster:
    _check_png(data)
    try:
        with silenced_libraries():
            codes = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    except cv2.error as error:
        raise _damage_error("PNG", error) from error
    if codes is None:
        raise _damage_error("PNG", "its pixels cannot be decoded")
    codes = _with_channel_axis(codes)
    if codes.shape[2] >= 3:
        codes = np.ascontiguousarray(codes[..., 2::-1])
    try:
        with Image.open(io.BytesIO(data)) as image:
            header = _exif(image)
    except (OSError, SyntaxError, ValueError):
        header = {}
    channels = 3 if codes.shape[2] >= 3 else 1
    return Raster(codes[..., :channels], "png", header=header)


def _check_png(data: bytes) -> None:
    """Every chunk is there and unharmed, and the size is one the file can hold."""
    at, kind = len(_PNG), b""
    while kind != b"IEND":
        if at + 12 > len(data):
            raise _damage_error("PNG", "it is truncated")
        (length,) = struct.unpack_from(">I", data, at)
        kind, end = data[at + 4 : at + 8], at + 8 + length
        if end + 4 > len(data):
            raise _damage_error("PNG", "it is truncated")
        (checksum,) = struct.unpack_from(">I", data, end)
        if zlib.crc32(memoryview(data)[at + 4 : end]) != checksum:
            raise _damage_error("PNG", "a checksum is wrong")
        if kind == b"IHDR":
            width, height, depth = struct.unpack_from(">IIB", data, at + 8)
            if width * height * depth // 8 > _LARGEST_PNG_RATIO * len(data) + 4096:
                raise _damage_error("PNG", f"it cannot hold {width} x {height} pixels")
            channels = _PNG_CHANNELS.get(data[at + 17], 1)
            samples = width * height * channels
            refuse_beyond_memory(RASTER_BYTES_PER_SAMPLE * samples)
        at = end + 4


def _read_tiff(data: bytes) -> Raster:
    try:
        with tifffile.TiffFile(io.BytesIO(data)) as file:
            page = file.pages[0]
            header = _tags(page)  # pyright: ignore[reportArgumentType]
            codes = _tiff_codes(page, data)
    except ImageError:
        raise
    except Exception as error:  # tifffile's decoders raise whatever broke in them
        raise _damage_error("TIFF", error) from error
    if codes.dtype in (np.float16, np.float64):
        codes = codes.astype(np.float32)
    if codes.dtype not in (np.uint8, np.uint16, np.float32):
        raise ImageError(
            f"holds {codes.dtype} samples",
            remedy="save it with 8 or 16 bits per sample, or as float",
        )
    return Raster(codes, "tiff", header=header)


def _tiff_codes(page, data: bytes) -> np.ndarray:
    photometric = int(page.photometric)
    if photometric == _CFA:
        raise ImageError(
            "is a raw sensor mosaic", remedy="name it .dng, or develop it first"
        )
    of_jpeg = photometric == _YCBCR and int(page.compression) in _JPEG_COMPRESSIONS
    if photometric not in (_MINISWHITE, _MINISBLACK, _RGB) and not of_jpeg:
        raise _unknown_colours(
            _PHOTOMETRIC.get(photometric, f"unknown ({photometric})")
        )
    refuse_beyond_memory(RASTER_BYTES_PER_SAMPLE * int(page.size))
    if page.size * page.dtype.itemsize > 1100 * len(data) + 4096:
        raise _damage_error(
            "TIFF", f"it cannot hold {page.imagewidth} x {page.imagelength}"
        )
    try:
        codes = page.asarray()
    except (ValueError, KeyError) as error:
        if "imagecodecs" not in str(error):
            raise
        codes = _tiff_by_opencv(data)
    if page.axes == "SYX":
        codes = np.moveaxis(codes, 0, -1)
    codes = _with_channel_axis(codes)
    codes = codes[..., :3] if codes.shape[2] >= 3 else codes[..., :1]
    if photometric == _MINISWHITE and codes.dtype.kind == "u":
        codes = np.iinfo(codes.dtype).max - codes
    return np.ascontiguousarray(codes)


def _tiff_by_opencv(data: bytes) -> np.ndarray:
    """Decode LZW, JPEG and the like, which tifffile leaves to another package."""
    with silenced_libraries():
        codes = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    if codes is None:
        raise _damage_error("TIFF", "its pixels cannot be decoded")
    return codes if codes.ndim == 2 else codes[..., 2::-1]


def _tags(page: tifffile.TiffPage) -> dict[str, object]:
    tags = {tag.name: tag.value for tag in page.tags.values()}
    exif = tags.pop("ExifTag", None)
    header = {**tags, **exif} if isinstance(exif, dict) else tags
    return {name: _plain(value) for name, value in header.items() if _is_short(value)}


def _plain(value: object) -> object:
    """TIFF stores a fraction as two integers."""
    if (
        isinstance(value, tuple)
        and len(value) == 2
        and all(isinstance(v, int) for v in value)
    ):
        return value[0] / value[1] if value[1] else float("nan")
    return int(value) if isinstance(value, int) else value


def _is_short(value: object) -> bool:
    return not isinstance(value, (bytes, dict)) and len(str(value)) < 300


def _exif(image: Image.Image) -> dict[str, object]:
    tags = image.getexif()
    merged = {**tags, **tags.get_ifd(ExifTags.IFD.Exif)}
    named = {ExifTags.TAGS.get(key, str(key)): v for key, v in merged.items()}
    return {name: value for name, value in named.items() if _is_short(value)}


def _with_channel_axis(codes: np.ndarray) -> np.ndarray:
    return codes[..., None] if codes.ndim == 2 else codes


def _unknown_colours(kind: str) -> ImageError:
    return ImageError(f"has {kind} colours", remedy="save it as grey or RGB")


def _damage_error(kind: str, reason: object) -> ImageError:
    text = " ".join(str(reason).split())[:120]
    return ImageError(
        f"is a damaged {kind} file ({text})", remedy="copy it again from the camera"
    )
