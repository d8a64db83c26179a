"""Cryptomatte 1.2.0: which objects share a pixel, and how much of it each covers.

A layer ``NAME00, NAME01, ...`` holds pairs of channels: the id of the object of a rank,
whose 32 bits are a hash of its name, and its coverage. Ids are bits that happen to be
stored as floats: they are never mixed, nor compared as numbers. The manifest, in the
header or in a file beside it, gives the names; without it a name still gives its id.
Source: Cryptomatte specification 1.2.0 (Psyop); MurmurHash3_x86_32 (A. Appleby, public
domain algorithm).
"""

import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Float32, UInt32

from lensfit.bounded import read_bounded, utf8_text
from lensfit.coords import Window
from lensfit.errors import ImageError
from lensfit.io.exr import ExrImage, ExrPart

_ENTRY = re.compile(r"(?:.*/)?cryptomatte/([^/]+)/(\w+)")
_MOST_MANIFEST_BYTES = 1 << 28


@dataclass(frozen=True)
class Cryptomatte:
    """One set of mattes of a file.

    Attributes
    ----------
    name : Of its layers, without their numbers.
    layers : The part and the prefix of the channels of every two ranks.
    manifest : Object to id; empty when the file gives none.
    """

    name: str
    layers: tuple[tuple[ExrPart, str], ...]
    manifest: Mapping[str, int]

    @property
    def data_window(self) -> Window:
        return self.layers[0][0].data_window


class Ranks(NamedTuple):
    """Objects of each pixel in the order of their coverage."""

    ids: UInt32[np.ndarray, "ranks height width"]
    coverage: Float32[np.ndarray, "ranks height width"]


def murmur3_32(data: bytes, seed: int = 0) -> int:
    """MurmurHash3_x86_32."""
    mask, state = 0xFFFFFFFF, seed
    whole = len(data) // 4 * 4
    for at in range(0, whole, 4):
        state ^= _scrambled_block(int.from_bytes(data[at : at + 4], "little"))
        state = (state << 13 | state >> 19) & mask
        state = (state * 5 + 0xE6546B64) & mask
    if whole < len(data):
        state ^= _scrambled_block(int.from_bytes(data[whole:], "little"))
    state ^= len(data)
    state = ((state ^ state >> 16) * 0x85EBCA6B) & mask
    state = ((state ^ state >> 13) * 0xC2B2AE35) & mask
    return state ^ state >> 16


def _scrambled_block(block: int) -> int:
    mask = 0xFFFFFFFF
    block = (block * 0xCC9E2D51) & mask
    block = (block << 15 | block >> 17) & mask
    return (block * 0x1B873593) & mask


def object_id(name: str) -> int:
    """Id of an object: the hash of its name, kept from being infinite, NaN or denormal
    as a float."""
    bits = murmur3_32(name.encode())
    return bits ^ (1 << 23) if bits >> 23 & 255 in (0, 255) else bits


def find_cryptomattes(image: ExrImage, path: str | Path) -> list[Cryptomatte]:
    """Every Cryptomatte that the headers of a file declare and whose channels it has.

    Parameters
    ----------
    path : The file, beside which a manifest may lie.

    Raises
    ------
    ImageError : A manifest cannot be read, or a hash other than MurmurHash3_32 is used.
    """
    sets: dict[str, dict[str, str]] = {}
    for part in image.parts:
        for key, value in part.attributes.items():
            if match := _ENTRY.fullmatch(key):
                sets.setdefault(match[1], {})[match[2]] = str(value)
    found = []
    for entries in sets.values():
        name = entries.get("name", "")
        layers = _layers(image, name) if name else ()
        if not layers:
            continue
        if entries.get("hash", "MurmurHash3_32") != "MurmurHash3_32":
            raise ImageError(
                f"hashes the names of its Cryptomatte by {entries['hash']!r}",
                where=path,
                remedy="write it by the specification 1.2",
            )
        found.append(Cryptomatte(name, layers, _manifest(entries, Path(path))))
    return found


def read_ranks(crypto: Cryptomatte, most: int | None = None) -> Ranks:
    """Ids and coverages over the data window of the Cryptomatte.

    Parameters
    ----------
    most : The first so many ranks; all if None.
    """
    ids, coverage = [], []
    layers = crypto.layers if most is None else crypto.layers[: (most + 1) // 2]
    for part, layer in layers:
        for pair in (("r", "g"), ("b", "a")):
            planes = [_channel(part, layer, leaf) for leaf in pair]
            if planes[0] is None or planes[1] is None:
                continue
            ids.append(np.ascontiguousarray(planes[0], np.float32).view(np.uint32))
            coverage.append(planes[1].astype(np.float32))
    return Ranks(np.stack(ids[:most]), np.stack(coverage[:most]))


def coverage_of(
    ranks: Ranks, ids: Sequence[int]
) -> Float32[np.ndarray, "height width"]:
    """Share of each pixel that some objects cover together."""
    own = np.isin(ranks.ids, np.array(ids, np.uint32))
    return np.where(own, ranks.coverage, np.float32(0)).sum(0, dtype=np.float32)


def id_of(crypto: Cryptomatte, name: str) -> int:
    """Id of an object by its name in the manifest, or else by its hash."""
    return crypto.manifest.get(name, object_id(name))


def _layers(image: ExrImage, name: str) -> tuple[tuple[ExrPart, str], ...]:
    """Layers with ranks, in their order. A layer may be a part of its own, whose
    channels lack its name."""
    pattern = re.compile(rf"(?:.*\.)?{re.escape(name)}(\d+)")
    found = []
    for part in image.parts:
        for layer in dict.fromkeys(n.rpartition(".")[0] for n in part.channels):
            match = pattern.fullmatch(layer or part.name)
            if match and _channel(part, layer, "r") is not None:
                found.append((int(match[1]), part, layer))
    found.sort(key=lambda item: item[0])
    return tuple((part, layer) for _, part, layer in found)


def _channel(part: ExrPart, layer: str, leaf: str) -> np.ndarray | None:
    prefix = f"{layer}." if layer else ""
    long = {"r": "red", "g": "green", "b": "blue", "a": "alpha"}[leaf]
    for name in (leaf, leaf.upper(), long):
        if prefix + name in part.channels:
            return part.channels[prefix + name]
    return None


def _manifest(entries: Mapping[str, str], path: Path) -> dict[str, int]:
    text = entries.get("manifest")
    where = path
    if text is None and "manif_file" in entries:
        where = path.parent / entries["manif_file"]
        if where.resolve().parent != path.parent.resolve():
            raise ImageError(
                f"names a manifest outside its folder: {entries['manif_file']!r}",
                where=path,
                remedy="put it beside the picture",
            )
        data = read_bounded(where, _MOST_MANIFEST_BYTES, error=ImageError)
        text = utf8_text(data, where, error=ImageError)
    if text is None:
        return {}
    try:
        return {str(k): int(str(v), 16) for k, v in json.loads(text).items()}
    except (ValueError, AttributeError) as error:
        raise ImageError(
            f"holds no Cryptomatte manifest ({error})",
            where=where,
            remedy="render it again",
        ) from error
