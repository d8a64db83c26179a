"""What a hostile OpenEXR file claims: sizes, counts, offsets, types and names."""

import random
import struct
import zlib
from collections.abc import Callable
from contextlib import suppress
from itertools import pairwise

from exr_bytes import MULTIPART, Attribute, ExrBytes
from mutations import BYTES, NUMBERS, WORDS, Mutation

_INTS = (
    *(0, 1, -1, 2, 7, 15, 255, 256, 65_535, 65_536, 99_999, 131_071, 131_072, 2**20),
    *(2**24, 2**28, 2**30, 2**31 - 1, -(2**31), -(2**30), -255),
)
_FLOATS = (
    0.0,
    -0.0,
    -1.0,
    1e38,
    -1e38,
    1e-45,
    float("nan"),
    float("inf"),
    -float("inf"),
)
_OFFSETS = (0, 1, 4, 8, 2**31, 2**32, 2**48, 2**63, 2**64 - 1)
_TYPES = (
    *(b"scanlineimage", b"tiledimage", b"deepscanline", b"deeptile", b"", b"x"),
    *(b"deep", b"\xff\xfe", b"scanlineimage\0"),
)
_KINDS = {
    b"int": lambda r: struct.pack("<i", r.choice(_INTS)),
    b"float": lambda r: struct.pack("<f", r.choice(_FLOATS)),
    b"double": lambda r: struct.pack("<d", r.choice(_FLOATS)),
    b"string": lambda r: r.choice(WORDS + NUMBERS).encode("utf-8", "surrogatepass"),
    b"rational": lambda r: struct.pack(
        "<iI", r.choice(_INTS), r.choice((0, 1, 2**32 - 1))
    ),
    b"v2f": lambda r: struct.pack("<2f", *r.choices(_FLOATS, k=2)),
    b"v2i": lambda r: struct.pack("<2i", *r.choices(_INTS, k=2)),
    b"v3f": lambda r: struct.pack("<3f", *r.choices(_FLOATS, k=3)),
    b"box2i": lambda r: struct.pack("<4i", *r.choices(_INTS, k=4)),
    b"box2f": lambda r: struct.pack("<4f", *r.choices(_FLOATS, k=4)),
    b"m33f": lambda r: struct.pack("<9f", *r.choices(_FLOATS, k=9)),
    b"m44f": lambda r: struct.pack("<16f", *r.choices(_FLOATS, k=16)),
    b"timecode": lambda r: struct.pack("<2i", *r.choices(_INTS, k=2)),
    b"keycode": lambda r: struct.pack("<7i", *r.choices(_INTS, k=7)),
    b"chromaticities": lambda r: struct.pack("<8f", *r.choices(_FLOATS, k=8)),
    b"envmap": lambda r: bytes([r.randrange(256)]),
    b"lineOrder": lambda r: bytes([r.randrange(256)]),
    b"compression": lambda r: bytes([r.randrange(256)]),
    b"preview": lambda r: struct.pack("<2i", *r.choices(_INTS, k=2)) + r.randbytes(16),
    b"stringvector": lambda r: b"".join(
        struct.pack("<i", r.choice((0, 1, 3, -1, 2**31 - 1))) + b"abc" for _ in range(3)
    ),
    b"floatvector": lambda r: r.randbytes(r.choice((0, 3, 4, 40))),
    b"idmanifest": lambda r: struct.pack("<i", r.choice(_INTS)) + r.randbytes(40),
    b"bytes": lambda r: (
        struct.pack("<I", r.choice((0, 3, 2**32 - 1))) + r.randbytes(20)
    ),
    b"opaque": lambda r: r.randbytes(r.choice((0, 1, 500))),
}
_NAMES = (
    *(b"aperture", b"focus", b"lens/focal", b"lens/focus", b"lens/aperture", b"tStop"),
    *(
        b"lens/fstop",
        b"lens/overscan",
        b"FocalLength",
        b"FNumber",
        b"nuke/camera/focal",
    ),
    *(b"Orientation", b"FocalPlaneResolutionUnit", b"FocalPlaneXResolution"),
    *(b"FocalPlaneYResolution", b"ExifImageWidth", b"FocalLengthIn35mmFilm"),
    *(
        b"sensorPhotositePitch",
        b"sensorAcquisitionRectangle",
        b"sensorOverallDimensions",
    ),
    *(b"cryptomatte/1/name", b"cryptomatte/1/manifest", b"cryptomatte/1/manif_file"),
    *(b"cryptomatte/1/hash", b"depth/unit", b"depth/kind", b"depth/near", b"timeCode"),
    *(
        b"metersPerUnit",
        b"lensfit/undefinedUV",
        b"lensfit/map",
        b"multiView",
        b"preview",
    ),
    *(b"idManifest", b"pixelAspectRatio", b"screenWindowWidth", b"chromaticities"),
    *(
        b"deepImageState",
        b"maxSamplesPerPixel",
        b"view",
        b"\xff",
        b"n" * 40,
        b"n" * 300,
    ),
)


def _part(exr: ExrBytes, rng: random.Random) -> list[Attribute]:
    return rng.choice(exr.parts)


def _named(attributes: list[Attribute], name: bytes) -> Attribute | None:
    return next((a for a in attributes if a.name == name), None)


def window(exr: ExrBytes, rng: random.Random) -> None:
    """Data or display window of another size, up to 2^32 on a side."""
    names = (b"dataWindow", b"dataWindow", b"displayWindow")
    found = _named(_part(exr, rng), rng.choice(names))
    if found is None:
        return
    corners = list(struct.unpack("<4i", found.value[:16].ljust(16, b"\0")))
    for _ in range(rng.choice((1, 1, 2, 4))):
        at = rng.randrange(4)
        moved = corners[at] + rng.choice((-3, -1, 1, 3, 40))
        corners[at] = rng.choice((*_INTS, moved, moved, moved))
    if rng.random() < 0.2:
        side = rng.choice((0, 5000, 20_000, 99_999, 131_071, 2**31 - 1))
        corners = [0, 0, side, side]
    limited = [min(max(c, -(2**31)), 2**31 - 1) for c in corners]
    found.value = struct.pack("<4i", *limited)


def channels(exr: ExrBytes, rng: random.Random) -> None:
    """A channel of no type, of no sampling, twice, or a hundred thousand of them."""
    found = _named(_part(exr, rng), b"channels")
    if found is None:
        return
    value, kind = bytearray(found.value), rng.randrange(6)
    if kind == 0 and len(value) > 20:
        at = value.index(0) + 1
        struct.pack_into("<i", value, at, rng.choice((-1, 0, 1, 2, 3, 2**31 - 1)))
    elif kind == 1 and len(value) > 20:
        at = value.index(0) + 9
        struct.pack_into("<2i", value, at, *rng.choices((0, -1, 1, 2, 2**31 - 1), k=2))
    elif kind == 2:
        value[:-1] = bytes(value[:-1]) * rng.choice((2, 3, 50))
    elif kind == 3:
        many = rng.choice((300, 5_000, 50_000))
        end = struct.pack("<iIii", rng.choice((0, 1, 2)), 0, 1, 1)
        value[:-1] = b"".join(b"c%d\0" % n + end for n in range(many))
    elif kind == 4:
        value[:] = rng.choice((b"", b"\0", value[:-1], bytes(value) + b"\0" * 9))
    else:
        name = rng.choice(WORDS).encode("utf-8", "replace")[:200].replace(b"\0", b"")
        value[: value.index(0)] = name
    found.value = bytes(value)


def storage(exr: ExrBytes, rng: random.Random) -> None:
    """Another compression, type of part, line order, tile size or version flag."""
    part, kind = _part(exr, rng), rng.randrange(6)
    if kind == 0 and (found := _named(part, b"compression")):
        found.value = bytes([rng.choice((*range(14), 127, 255))])
    elif kind == 1 and (found := _named(part, b"type")):
        found.value = rng.choice(_TYPES)
    elif kind == 2 and (found := _named(part, b"lineOrder")):
        found.value = bytes([rng.choice((0, 1, 2, 3, 255))])
    elif kind == 3:
        found = _named(part, b"tiles")
        if found is None:
            found = Attribute(b"tiles", b"tiledesc", b"")
            part.append(found)
        sizes = rng.choices((0, 1, 2, 16, 64, 2**16, 2**31 - 1, 2**31, 2**32 - 1), k=2)
        found.value = struct.pack("<2IB", *sizes, rng.choice((0, 1, 2, 16, 17, 3, 255)))
    elif kind == 4 and (found := _named(part, b"chunkCount")):
        found.value = struct.pack("<i", rng.choice(_INTS))
    else:
        exr.flags ^= rng.choice(
            (1, 2, 4, 0x200, 0x400, 0x800, MULTIPART, 0x2000, 2**31)
        )


def lengths(exr: ExrBytes, rng: random.Random) -> None:
    """An attribute claims another length than it has."""
    found = rng.choice(_part(exr, rng))
    near = len(found.value) + rng.choice((-4, -1, 1, 4))
    found.claimed = rng.choice((*(n for n in _INTS), near, near, near))


def attributes(exr: ExrBytes, rng: random.Random) -> None:
    """An attribute is gone, stands twice, or is of a kind that nobody expects there."""
    part, kind = _part(exr, rng), rng.randrange(8)
    if kind == 0 and part:
        part.remove(rng.choice(part))
    elif kind == 1 and part:
        part.append(rng.choice(part))
    elif kind == 2 and part:
        found = rng.choice(part)
        found.kind = rng.choice(list(_KINDS))
    elif kind == 3 and part:
        found = rng.choice(part)
        found.value = _KINDS.get(found.kind, _KINDS[b"opaque"])(rng)
    else:
        for _ in range(rng.choice((1, 1, 2, 5))):
            type_name = rng.choice(list(_KINDS))
            added = Attribute(rng.choice(_NAMES), type_name, _KINDS[type_name](rng))
            part.insert(rng.randrange(len(part) + 1), added)


def offsets(exr: ExrBytes, rng: random.Random) -> None:
    """Chunks lie in the header, in one another, or beyond the end."""
    kind = rng.randrange(3)
    if kind == 0:
        exr.offsets[:] = [rng.choice(exr.offsets)] * len(exr.offsets)
    elif kind == 1:
        rng.shuffle(exr.offsets)
    for _ in range(rng.choice((1, 2))):
        at = rng.randrange(len(exr.offsets))
        moved = exr.offsets[at] + rng.choice((-8, -1, 1, 4, 20))
        exr.offsets[at] = rng.choice((*_OFFSETS, moved, moved)) % 2**64


def chunk_heads(exr: ExrBytes, rng: random.Random) -> None:
    """A chunk claims another place, part or size, packed or unpacked."""
    for _ in range(rng.choice((1, 1, 3))):
        at = exr.chunk_at(rng.randrange(len(exr.offsets))) + 4 * rng.randrange(10)
        if not 0 <= at <= len(exr.body) - 8:
            continue
        if rng.random() < 0.6:
            struct.pack_into("<i", exr.body, at, rng.choice(_INTS))
        else:
            large = rng.choice((-1, 0, 1, 1000, 2**31, 2**40, 2**62, -(2**62)))
            struct.pack_into("<q", exr.body, at, large)


def deep_counts(exr: ExrBytes, rng: random.Random) -> None:
    """A chunk of deep pixels, consistent in itself, has as many samples as can be."""
    part = exr.parts[0]
    window, packing = _named(part, b"dataWindow"), _named(part, b"compression")
    if exr.flags != 0x802 or window is None or packing is None:
        return
    x_min, _, x_max, _ = struct.unpack("<4i", window.value)
    width, at = x_max - x_min + 1, exr.chunk_at(rng.randrange(len(exr.offsets)))
    (y,) = struct.unpack_from("<i", exr.body, at)
    each = rng.choice((1000, 10**6, 2**24, (2**31 - 1) // max(width, 1)))
    table = struct.pack(f"<{width}i", *(each * (n + 1) for n in range(width)))
    if packing.value != b"\0":
        table = _zipped(table)
    samples = _zipped(bytes(rng.choice((100, 10_000, 1_000_000))))
    claimed = each * width * 12
    head = struct.pack("<i3q", y, len(table), len(samples), claimed)
    where = exr.body_start + len(exr.body)
    exr.body += head + table + samples
    exr.offsets[y - struct.unpack("<4i", window.value)[1]] = where


def _zipped(raw: bytes) -> bytes:
    """As OpenEXR packs by zlib: even bytes, then odd ones, as differences."""
    split = raw[0::2] + raw[1::2]
    moved = bytes((b - a + 128) % 256 for a, b in pairwise(split))
    return zlib.compress(split[:1] + moved)


_HEADER: tuple[Callable[[ExrBytes, random.Random], None], ...] = (
    *(window, window, channels, storage, lengths, attributes, attributes, attributes),
    *(offsets, chunk_heads, chunk_heads, deep_counts),
)


def header_spoiled(data: bytes, rng: random.Random) -> bytes:
    """One to three fields of the file say what they may not."""
    exr = ExrBytes.taken_apart(data)
    for _ in range(rng.choice((1, 1, 1, 2, 3))):
        # What one has left of a field may be too little for another.
        with suppress(struct.error, LookupError, ValueError):
            rng.choice(_HEADER)(exr, rng)
    return exr.put_together(follow=rng.random() < 0.9)


EXR: tuple[Mutation, ...] = (*BYTES, *(header_spoiled,) * 12)
