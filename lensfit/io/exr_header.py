"""Headers of OpenEXR files: read and checked before any pixel is read, and written.

The OpenEXR library trusts a header's sizes and allocates what they claim, and it
reports damaged pixels on standard error while returning what it has. So the few header
fields that decide about size are read here first, and the table of chunk offsets is
compared with the length of the file: a file that passes is whole and does not claim
more memory than it holds.

Read attributes come back in the binding's own types and are passed on untouched.
Attributes made in Python or NumPy are brought to the nearest EXR type here, and what
has none is refused by name: the binding itself drops a list of integers silently.

The standard's attributes of a lens have the standard's units: millimetres for lengths
of the lens, metres for the focus distance. ``nominalFocalLength`` is the barrel's
number, ``pinholeFocalLength`` that of the pinhole with the same angle of view near the
axis, ``entrancePupilOffset`` counts from the image plane towards the scene. Those of
the sensor describe the whole of it and its photosites, which a lens does not know.

References
----------
OpenEXR 3.2, "File Layout", https://openexr.com/en/latest/OpenEXRFileLayout.html,
"Standard Attributes", and ImfStandardAttributes.h."""

import struct
from collections.abc import Mapping
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import BinaryIO

import numpy as np
import OpenEXR

from lensfit.bounded import refuse_pipe
from lensfit.coords import Window
from lensfit.errors import ImageError, OutputError
from lensfit.units import m_from_mm

MAGIC = b"\x76\x2f\x31\x01"
_TILED, _DEEP, _MULTIPART = 0x200, 0x800, 0x1000
_LINES_PER_CHUNK = {0: 1, 1: 1, 2: 1, 3: 16, 4: 32, 5: 16, 6: 32, 7: 32, 8: 32, 11: 32}
_MOST_LINES_PER_CHUNK = 256
_SAMPLE_BYTES = {0: 4, 1: 2, 2: 4}
_LARGEST_SIDE_PX = 1 << 17
# How many times smaller a picture can get. Stored, run lengths, zlib (and of 3 of 4
# bytes), B44: by their formats; PIZ 408 at most; DWA 33,000, HTJ2K 87,000 and more on
# black frames (measured at 8192 pixels; they grow with the frame).
_LARGEST_RATIO = {0: 1, 1: 64, 2: 1100, 3: 1100, 4: 1000, 5: 1500, 6: 3, 7: 12}
_LARGEST_RATIO |= {8: 150_000, 9: 150_000}
_LARGEST_RATIO_OF_OTHERS = 400_000
# A small part of a large frame may be stored, within reason: the frame is allocated.
_LARGEST_FRAME_PX = 8192 * 4320
_SMALLEST_PART_OF_FRAME = 64
_MOST_CHANNELS = 4096
_MOST_ATTRIBUTES = 100_000
_ALWAYS_ALLOWED_BYTES = 1 << 24


@dataclass(frozen=True)
class PartHeader:
    """What one part of a file claims to hold.

    Attributes
    ----------
    data_window : The pixels that are stored.
    display_window : The frame.
    channels : Name to (pixel type code, x sampling, y sampling).
    chunk_count : Entries of the chunk table; a lower bound for mip-mapped tiles.
    tiled : Chunks are tiles, not bundles of lines.
    deep : Several samples in a pixel.
    compression : Its code.
    """

    data_window: Window
    display_window: Window
    channels: dict[str, tuple[int, int, int]]
    chunk_count: int
    tiled: bool
    deep: bool
    compression: int

    @property
    def bytes_uncompressed(self) -> int:
        """Of the samples; of a deep part, of the table that counts them."""
        pixels = self.data_window.area
        if self.deep:
            return 4 * pixels
        return pixels * sum(_SAMPLE_BYTES.get(c[0], 4) for c in self.channels.values())

    @property
    def largest_ratio(self) -> int:
        """How many times smaller than its samples a chunk can be."""
        return _LARGEST_RATIO.get(self.compression, _LARGEST_RATIO_OF_OTHERS)


def check_exr(path: str | Path, *, deep: bool = False) -> list[PartHeader]:
    """Read the headers of an OpenEXR file and refuse what cannot be read safely.

    Parameters
    ----------
    deep : Accept deep pixels, whose number is not in the header.

    Returns
    -------
    One record for each part.

    Raises
    ------
    ImageError : Missing, empty, not OpenEXR, malformed, truncated, deep, chroma
        subsampled, or claiming more pixels than a file of its length can hold.
    """
    path = Path(path)
    try:
        refuse_pipe(path, error=ImageError, remedy="give an OpenEXR file")
        with path.open("rb") as file:
            size = file.seek(0, 2)
            file.seek(0)
            return _checked_headers(file, size, path, deep)
    except OSError as error:
        reason = error.strerror or str(error)
        raise ImageError(f"cannot be read ({reason})", where=path) from error
    except (struct.error, LookupError, ValueError, ArithmeticError) as error:
        raise _damage_error(path, "its header is cut short or malformed") from error


def _checked_headers(
    file: BinaryIO, size: int, path: Path, deep: bool
) -> list[PartHeader]:
    start = file.read(8)
    if not start:
        raise ImageError("is empty", where=path, remedy="render or copy it again")
    if start[:4] != MAGIC:
        raise ImageError(
            "is not an OpenEXR file",
            where=path,
            remedy="render or convert it to OpenEXR, or copy it again if it was one",
        )
    flags = struct.unpack("<I", start[4:])[0]
    parts = _read_headers(file, size, flags)
    for part in parts:
        if part.deep and not deep:
            raise ImageError(
                "holds deep pixels, which only `lensfit apply` reads",
                where=path,
                remedy="flatten it to one sample per pixel with a Z channel",
            )
        _refuse_unreadable(part, size, path)
        _refuse_frame(part, path)
    _check_chunks(file, size, parts, bool(flags & _MULTIPART), path)
    return parts


def _read_headers(file: BinaryIO, size: int, flags: int) -> list[PartHeader]:
    parts = []
    while attributes := _read_attributes(file, size, len(parts)):
        parts.append(_part(attributes, flags))
        if not flags & _MULTIPART:
            break
    if not parts:
        raise ValueError("no part")
    return parts


_WANTED = {"dataWindow", "displayWindow", "channels", "compression", "tiles"}
_WANTED |= {"type", "chunkCount"}


def _read_attributes(file: BinaryIO, size: int, parts_before: int) -> dict[str, bytes]:
    found, count = {}, 0
    while name := _read_name(file):
        count += 1
        if count * (parts_before + 1) > _MOST_ATTRIBUTES:
            raise ValueError("more attributes than any file has")
        _read_name(file)  # the type is fixed for the attributes wanted here
        (length,) = struct.unpack("<i", file.read(4))
        if length < 0 or file.tell() + length > size:
            raise ValueError("attribute longer than the file")
        if name in _WANTED:
            found[name] = file.read(length)
        else:
            file.seek(length, 1)
    return found


def _read_name(file: BinaryIO) -> str:
    text = bytearray()
    while (byte := file.read(1)) != b"\0":
        if not byte or len(text) > 255:
            raise ValueError("unterminated name")
        text += byte
    return text.decode()


def _part(attributes: dict[str, bytes], flags: int) -> PartHeader:
    window, display = (
        Window(*struct.unpack("<4i", attributes[name]))
        for name in ("dataWindow", "displayWindow")
    )
    kind = attributes.get("type", b"").decode()
    deep = kind.startswith("deep") or (not kind and bool(flags & _DEEP))
    # In a file of one part the flag decides; `type` may be missing there.
    tiled = bool(flags & _TILED) or kind in ("tiledimage", "deeptile")
    compression = attributes["compression"][0]
    if tiled:
        width, height = struct.unpack("<2I", attributes["tiles"][:8])
        chunks = -(-window.width // width) * -(-window.height // height)
    else:
        lines = _LINES_PER_CHUNK.get(compression)
        chunks = -(-window.height // (lines or _MOST_LINES_PER_CHUNK))
    if "chunkCount" in attributes:
        (chunks,) = struct.unpack("<i", attributes["chunkCount"])
    channels = _channels(attributes["channels"])
    return PartHeader(window, display, channels, chunks, tiled, deep, compression)


def _channels(data: bytes) -> dict[str, tuple[int, int, int]]:
    channels, at = {}, 0
    while data[at]:
        end = data.index(0, at)
        pixel_type, _, x_sampling, y_sampling = struct.unpack_from(
            "<iIii", data, end + 1
        )
        name = data[at:end].decode()
        if name in channels or len(channels) >= _MOST_CHANNELS:
            raise ValueError("a channel twice, or more than any file has")
        channels[name] = (pixel_type, x_sampling, y_sampling)
        at = end + 17
    return channels


def _refuse_unreadable(part: PartHeader, size: int, path: Path) -> None:
    window = part.data_window
    if min(window.width, window.height) < 1:
        raise _damage_error(path, f"its data window {tuple(window)} is empty")
    claimed = part.bytes_uncompressed
    if (
        claimed > _ALWAYS_ALLOWED_BYTES + part.largest_ratio * size
        or not 0 < part.chunk_count <= size // 8
    ):
        raise _damage_error(
            path,
            f"its header claims {window.width} x {window.height} pixels, which a file "
            f"of {size} bytes cannot hold",
        )
    if max(window.width, window.height) > _LARGEST_SIDE_PX:
        raise _too_large(path, "data", window, f"{_LARGEST_SIDE_PX} on a side")
    for name, (_, x_sampling, y_sampling) in part.channels.items():
        if (x_sampling, y_sampling) != (1, 1):
            raise ImageError(
                f"channel {name!r} is stored at reduced resolution "
                f"({x_sampling} x {y_sampling})",
                where=path,
                remedy="save it again as full-resolution RGB",
            )


def _refuse_frame(part: PartHeader, path: Path) -> None:
    """Refuse a display window that is empty, or far larger than what it holds."""
    window, frame = part.data_window, part.display_window
    if min(frame.width, frame.height) < 1:
        raise _damage_error(path, f"its display window {tuple(frame)} is empty")
    largest = max(_LARGEST_FRAME_PX, _SMALLEST_PART_OF_FRAME * window.area)
    if max(frame.width, frame.height) > _LARGEST_SIDE_PX:
        raise _too_large(path, "display", frame, f"{_LARGEST_SIDE_PX} on a side")
    if frame.area > largest:
        there = f"{_SMALLEST_PART_OF_FRAME} times the {window.area} that are there"
        raise _too_large(path, "display", frame, there)


def _check_chunks(
    file: BinaryIO, size: int, parts: list[PartHeader], multipart: bool, path: Path
) -> None:
    """Every chunk has its place in the file, and the last one ends inside it."""
    count = sum(part.chunk_count for part in parts)
    table = np.frombuffer(file.read(8 * count), "<u8")
    if len(table) < count or table.min() < file.tell() or table.max() > size - 8:
        raise _damage_error(path, "it is truncated or was never finished")
    owners = np.repeat(np.arange(len(parts)), [part.chunk_count for part in parts])
    last = int(table.argmax())
    for index in range(count):
        part = parts[owners[index]]
        if not part.deep and index != last:
            continue
        # A chunk says: part number if there are several parts; y, or tile x, y and
        # level x, y; its length; its data.
        start = int(table[index]) + 4 * multipart + (16 if part.tiled else 4)
        file.seek(start)
        end = _end_of_deep(file, part, path) if part.deep else _end_of_flat(file)
        if not start < end <= size:
            raise _damage_error(path, "it is truncated")


def _end_of_flat(file: BinaryIO) -> int:
    (length,) = struct.unpack("<i", file.read(4))
    return file.tell() + length if length >= 0 else 0


def _end_of_deep(file: BinaryIO, part: PartHeader, path: Path) -> int:
    """Behind the table of sample counts and the samples. Their lengths are packed; the
    samples' unpacked length, which is believed, must be one that they can have."""
    table, samples, unpacked = struct.unpack("<3q", file.read(24))
    if min(table, samples, unpacked) < 0:
        raise _damage_error(path, "a chunk claims less than nothing")
    if unpacked > part.largest_ratio * samples:
        raise _damage_error(path, f"a chunk claims {unpacked} bytes of samples")
    return file.tell() + table + samples


def _too_large(path: Path, which: str, window: Window, most: str) -> ImageError:
    """A file that may well be whole."""
    return ImageError(
        f"has a {which} window of {window.width} x {window.height} pixels, more than "
        f"is read: {most}",
        where=path,
        remedy="crop it, or state its windows as they are meant",
    )


def _damage_error(path: Path, reason: str) -> ImageError:
    return ImageError(
        f"is damaged: {reason}", where=path, remedy="render or copy it again"
    )


_INT32 = range(-(2**31), 2**31)


def attributes_for_writing(
    attributes: Mapping[str, object], where: str | Path
) -> dict[str, object]:
    """Attributes as the binding takes them.

    Parameters
    ----------
    attributes : Name to value. Python and NumPy numbers, strings, `Fraction`, `Window`,
        arrays of 2 or 3 numbers or 3 x 3 or 4 x 4, lists of strings or of floats,
        and the binding's own types.
    where : The file they are for, named in errors.

    Raises
    ------
    OutputError : A value has no OpenEXR type.
    """
    return {name: _writable(name, value, where) for name, value in attributes.items()}


def _writable(name: str, value: object, where: str | Path) -> object:
    # A function takes one level of value apart; what it does not know comes back as is.
    if isinstance(value, Window):
        corners = np.asarray(value, np.int32)
        return corners[:2], corners[2:]
    if isinstance(value, (bool, int, np.bool_, np.integer)) and int(value) in _INT32:
        return int(value)
    if isinstance(value, (float, np.floating)):
        return float(value)
    if isinstance(value, Fraction):
        if value.numerator in _INT32 and value.denominator in _INT32:
            return value
    elif isinstance(value, list):
        return _writable_list(name, value, where)
    elif isinstance(value, (str, np.ndarray, tuple, *_binding_types())):
        return value
    raise _no_type(name, value, where)


def _writable_list(name: str, value: list, where: str | Path) -> object:
    if not value:
        # The binding cannot tell of what an empty list is a list.
        return OpenEXR.OpaqueAttribute(b"", "stringvector")
    if all(isinstance(item, str) for item in value):
        return value
    if all(isinstance(item, (int, float, np.number)) for item in value):
        return [float(item) for item in value]
    raise _no_type(name, value, where)


def _binding_types() -> tuple[type, ...]:
    names = (
        "Bytes",
        "OpaqueAttribute",
        "KeyCode",
        "TimeCode",
        "PreviewImage",
        "TileDescription",
        "Envmap",
        "LineOrder",
        "Compression",
        "IDManifest",
    )
    return tuple(getattr(OpenEXR, name) for name in names if hasattr(OpenEXR, name))


def _no_type(name: str, value: object, where: str | Path) -> OutputError:
    return OutputError(
        f"attribute {name!r} is a {type(value).__name__}, which OpenEXR cannot store",
        where=where,
        remedy="give it as a number, a string, or a list of either",
    )


def lens_attributes(
    *,
    nominal_focal_length_mm: float | None = None,
    pinhole_focal_length_mm: float | None = None,
    f_number: float | None = None,
    focus_distance_mm: float | None = None,
    entrance_pupil_offset_mm: float | None = None,
    lens_model: str | None = None,
    lens_serial: str | None = None,
) -> dict[str, object]:
    """Attributes of what is known; what is None, or an empty text, has none.

    Parameters
    ----------
    focus_distance_mm : From the sensor; may be infinite.
    """
    focus_m = None if focus_distance_mm is None else m_from_mm(focus_distance_mm)
    found: dict[str, object | None] = {
        "nominalFocalLength": nominal_focal_length_mm,
        "pinholeFocalLength": pinhole_focal_length_mm,
        "aperture": f_number,
        "focus": focus_m,
        "entrancePupilOffset": entrance_pupil_offset_mm,
        "lensModel": lens_model or None,
        "lensSerialNumber": lens_serial or None,
    }
    return {name: value for name, value in found.items() if value is not None}
