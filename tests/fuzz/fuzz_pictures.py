"""Small pictures of every kind that is read, to be spoiled."""

import io
import json
import random
import struct
import sys
import zlib
from pathlib import Path

# Makers of files live with the tests of their rooms.
sys.path.append(str(Path(__file__).parents[1]))

import cv2
import numpy as np
import OpenEXR
import tifffile
from deep_files import write_deep
from mutations import BYTES, Mutation
from PIL import Image

from lensfit.coords import Window, uv_from_px
from lensfit.io.cryptomatte import object_id
from lensfit.io.exr import ExrImage, ExrPart, write_exr
from lensfit.io.stmap import write_channel_stmaps, write_stmap

_DATA, _DISPLAY = Window(-3, -2, 30, 21), Window(0, 0, 26, 19)
_CAMERA = {
    "lens/focal": 50.0,
    "lens/fstop": "2.8",
    "lens/focus": 2.0,
    "lens/aperture": 24.0,
    "aperture": 2.8,
    "sensorPhotositePitch": 5.5,
    "sensorAcquisitionRectangle": Window(0, 0, 4447, 3095),
    "timeCode": OpenEXR.TimeCode(10, 0, 0, 1, *[False] * 6, *[0] * 8),
    "depth/unit": "cm",
    "metersPerUnit": 0.01,
}
_COMPRESSIONS = (
    *("no", "rle", "zips", "zip", "piz", "pxr24", "b44", "b44a"),
    *("dwaa", "dwab", "htj2k256"),
)


def _scene(window: Window) -> dict[str, np.ndarray]:
    x, y = np.moveaxis(window.pixel_centres(), -1, 0)
    planes = {"R": np.sin(x / 7), "G": np.cos(y / 6), "B": np.sin((x + y) / 9)}
    return {n: (1 + 0.5 * p).astype(np.float16) for n, p in planes.items()}


def _plate(window: Window = _DATA, **changes) -> ExrPart:
    size = (window.height, window.width)
    ids = np.full(size, object_id("wire"), np.uint32)
    depth = np.linspace(100, 900, size[0] * size[1], dtype=np.float32).reshape(size)
    channels = {
        **_scene(window),
        "A": np.ones(size, np.float16),
        "depth.Z": depth,
        "CryptoObject00.r": ids.view(np.float32),
        "CryptoObject00.g": np.full(size, 0.75, np.float32),
        "CryptoObject00.b": np.zeros(size, np.float32),
        "CryptoObject00.a": np.full(size, 0.25, np.float32),
        "id": ids,
    }
    names = json.dumps({"wire": f"{object_id('wire'):08x}"})
    header = {
        **_CAMERA,
        "cryptomatte/1/name": "CryptoObject",
        "cryptomatte/1/hash": "MurmurHash3_32",
        "cryptomatte/1/manifest": names,
    }
    return ExrPart(channels, window, _DISPLAY, header, **changes)


def plates(folder: Path) -> list[Path]:
    """One of each compression, tiled, of several parts, of one pixel."""
    made = []
    for name in _COMPRESSIONS:
        made.append(folder / f"plate_{name}.exr")
        write_exr(made[-1], ExrImage((_plate(),)), compression=name)
    tiles = OpenEXR.TileDescription()
    tiles.xSize, tiles.ySize = 16, 8
    header = {"type": OpenEXR.tiledimage, "tiles": tiles, **_tileable()}
    made.append(folder / "plate_tiles.exr")
    OpenEXR.File(header, _scene(Window.of_size(40, 24))).write(str(made[-1]))
    parts = (_plate(name="left"), _plate(Window(0, 0, 5, 3), name="right"))
    made.append(folder / "plate_parts.exr")
    write_exr(made[-1], ExrImage(parts))
    point = Window.of_size(1, 1)
    small = ExrPart({"Y": np.ones((1, 1), np.float32)}, point, point)
    made.append(folder / "plate_one_pixel.exr")
    write_exr(made[-1], ExrImage((small,)))
    return made


def _tileable() -> dict[str, object]:
    return {k: v for k, v in _CAMERA.items() if not isinstance(v, Window)}


def deep_plates(folder: Path) -> list[Path]:
    """Deep scan lines, packed in each of the ways that deep pixels can be."""
    rng = np.random.default_rng(3)
    counts = rng.integers(0, 4, (12, 16))
    total = int(counts.sum())
    samples = {
        name: rng.random(total).astype(dtype)
        for name, dtype in zip("RGBAZ", (np.float16,) * 4 + (np.float32,), strict=True)
    }
    made = []
    for name in ("NO", "RLE", "ZIPS"):
        packing = {"compression": getattr(OpenEXR, f"{name}_COMPRESSION")}
        path = folder / f"deep_{name.lower()}.exr"
        made.append(write_deep(path, counts, samples, _tileable(), **packing))
    return made


def maps(folder: Path) -> list[Path]:
    """UV maps, for all colours and for each."""
    uv = uv_from_px(_DATA.pixel_centres(), _DISPLAY).astype(np.float32)
    three = dict.fromkeys("rgb", uv.copy())
    write_channel_stmaps(folder / "three.exr", three, _DISPLAY, _DATA)
    uv[0, 0] = np.nan
    write_stmap(folder / "one.exr", uv, _DISPLAY, _DATA)
    return [folder / "one.exr", folder / "three.exr"]


def _codes(dtype: type = np.uint8, channels: int = 3) -> np.ndarray:
    rng = np.random.default_rng(5)
    codes = rng.random((20, 24, channels)) * (1 if dtype is np.float32 else 200)
    return codes.astype(dtype)


def _exif() -> Image.Exif:
    exif = Image.Exif()
    exif[0x0112] = 6  # orientation
    exif[0x0110] = "Camera 1"
    inside = exif.get_ifd(0x8769)
    inside[0x829D], inside[0x920A], inside[0x9206] = 2.8, 50.0, 2.0
    inside[0xA20E], inside[0xA20F], inside[0xA210] = 160.0, 160.0, 3
    inside[0xA405], inside[0xA434] = 75, "Lens 50"
    return exif


def pngs(folder: Path) -> list[Path]:
    """PNG of 8 and 16 bits, grey, with alpha, with a palette, with EXIF."""
    made = []
    for dtype in (np.uint8, np.uint16):
        for channels in (1, 3, 4):
            made.append(folder / f"{np.dtype(dtype).name}_{channels}.png")
            cv2.imwrite(str(made[-1]), _codes(dtype, channels))
    picture = Image.fromarray(_codes())
    picture.save(folder / "exif.png", exif=_exif())
    picture.quantize(16).save(folder / "palette.png")
    return [*made, folder / "exif.png", folder / "palette.png"]


def jpegs(folder: Path) -> list[Path]:
    """JPEG in colour and grey, progressive, with EXIF."""
    picture = Image.fromarray(_codes())
    picture.save(folder / "exif.jpg", exif=_exif())
    picture.convert("L").save(folder / "grey.jpg")
    picture.save(folder / "progressive.jpg", progressive=True, subsampling=0)
    return [folder / name for name in ("exif.jpg", "grey.jpg", "progressive.jpg")]


def tiffs(folder: Path) -> list[Path]:
    """TIFF of every sample type, packing and layout that is read."""
    made = []

    def write(name: str, codes: np.ndarray, **options) -> None:
        made.append(folder / f"{name}.tif")
        tifffile.imwrite(made[-1], codes, **options)

    write("plain", _codes(), photometric="rgb")
    write("sixteen", _codes(np.uint16), photometric="rgb", byteorder=">")
    write("float", _codes(np.float32), photometric="rgb", compression="zlib")
    write("grey", _codes(channels=1)[..., 0], photometric="miniswhite")
    write("tiled", _codes(), photometric="rgb", tile=(16, 16), compression="zlib")
    write("planar", np.moveaxis(_codes(), -1, 0), photometric="rgb", bigtiff=True)
    packed = io.BytesIO()
    Image.fromarray(_codes()).save(packed, "TIFF", compression="tiff_lzw", exif=_exif())
    made.append(folder / "lzw.tif")
    made[-1].write_bytes(packed.getvalue())
    return made


def png_spoiled(data: bytes, rng: random.Random) -> bytes:
    """A chunk says something else, and its checksum is right."""
    at, chunks = 8, []
    while at < len(data):
        length = int.from_bytes(data[at : at + 4], "big")
        chunks.append(data[at + 4 : at + 8 + length])
        at += 12 + length
    which = rng.randrange(len(chunks))
    kind, body = chunks[which][:4], bytearray(chunks[which][4:])
    if kind == b"IHDR" and rng.random() < 0.8:
        side = rng.choice((0, 1, 25, 5000, 2**16, 2**20, 2**31 - 1, 2**31, 2**32 - 1))
        body[: rng.choice((4, 8))] = struct.pack(">2I", side, side)[
            : rng.choice((4, 8))
        ]
    elif rng.random() < 0.2:
        chunks.insert(rng.randrange(len(chunks)), chunks[which])
    else:
        body = bytearray(rng.choice(BYTES)(bytes(body), rng))
    chunks[which] = kind + bytes(body)
    framed = (
        struct.pack(">I", len(c) - 4) + c + struct.pack(">I", zlib.crc32(c))
        for c in chunks
    )
    return data[:8] + b"".join(framed)


PNG: tuple[Mutation, ...] = (*BYTES, *(png_spoiled,) * 6)
