"""An OpenEXR file taken apart into attributes, offsets and chunks, and put together.

Layout: OpenEXR, "File Layout". Attributes may change their length: offsets follow.
"""

import struct
from dataclasses import dataclass

MULTIPART = 0x1000


@dataclass
class Attribute:
    """A header entry as it stands in the file; `claimed` is its length if that lies."""

    name: bytes
    kind: bytes
    value: bytes
    claimed: int | None = None

    def written(self) -> bytes:
        length = len(self.value) if self.claimed is None else self.claimed
        return (
            self.name
            + b"\0"
            + self.kind
            + b"\0"
            + struct.pack("<i", length)
            + self.value
        )


@dataclass
class ExrBytes:
    """Flags, the attributes of each part, the chunk table and what follows it."""

    flags: int
    parts: list[list[Attribute]]
    offsets: list[int]
    body: bytearray
    body_start: int

    @classmethod
    def taken_apart(cls, data: bytes) -> "ExrBytes":
        """A whole file of the writer's."""
        (flags,) = struct.unpack_from("<I", data, 4)
        at, parts = 8, []
        while True:
            attributes: list[Attribute] = []
            while data[at]:
                name_end = data.index(0, at)
                kind_end = data.index(0, name_end + 1)
                (length,) = struct.unpack_from("<i", data, kind_end + 1)
                start = kind_end + 5
                attributes.append(
                    Attribute(
                        data[at:name_end],
                        data[name_end + 1 : kind_end],
                        data[start : start + length],
                    )
                )
                at = start + length
            at += 1
            if attributes:
                parts.append(attributes)
            if not flags & MULTIPART or not attributes:
                break
        # The first chunk begins where the table ends, whatever the order of the others.
        offsets: list[int] = []
        while not offsets or at + 8 * len(offsets) < min(offsets):
            offsets += struct.unpack_from("<Q", data, at + 8 * len(offsets))
        start = at + 8 * len(offsets)
        return cls(flags, parts, offsets, bytearray(data[start:]), start)

    def chunk_at(self, index: int) -> int:
        """Where a chunk begins in `body`."""
        return self.offsets[index] - self.body_start

    def put_together(self, *, follow: bool = True) -> bytes:
        """The file; offsets follow the length of the header unless told not to."""
        header = b"\x76\x2f\x31\x01" + struct.pack("<I", self.flags & 0xFFFFFFFF)
        for attributes in self.parts:
            header += b"".join(a.written() for a in attributes) + b"\0"
        if self.flags & MULTIPART:
            header += b"\0"
        start = len(header) + 8 * len(self.offsets)
        moved = start - self.body_start if follow else 0
        table = [(offset + moved) % (1 << 64) for offset in self.offsets]
        return header + struct.pack(f"<{len(table)}Q", *table) + bytes(self.body)
