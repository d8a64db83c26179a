"""Blackmagic's text of a clip, and Sony's XML beside one.

Blackmagic's (ExtractMetadata of the RAW SDK) has a block per frame. A block begins with
``Clip Metadata`` or ``Frame 0 Metadata`` and holds lines such as ``distance: 991mm``.
It has no timecode: its frames are counted.

Sony's (NonRealTimeMeta, called ...M01.XML) has what stays over the clip: the models of
camera and lens. Focal length, stop and focus are not in it, since they change. Source:
a clip of VENICE in camdkit (SMPTE RIS).
"""

import re
from pathlib import Path
from xml.etree import ElementTree

from lensfit.errors import CameraError
from lensfit.io.camera.quantity import (
    is_missing,
    number,
    stop,
    unit_mm,
)
from lensfit.io.camera.table import (
    CameraTable,
    Row,
    RowReadings,
    shared,
)
from lensfit.io.camera.text import MOST_ROWS, read_lines, read_text

BLACKMAGIC_KIND = "Blackmagic text"
FRAME_HEADING = re.compile(r"Frame (\d{1,9}) Metadata\s*")
"""Of Blackmagic's blocks."""
_LENGTH = re.compile(r"([-+]?[\d.]+|inf|infinity|Infinity)\s*([a-zA-Z]*)")


def read_blackmagic(path: str | Path) -> CameraTable:
    """The camera of each frame of a Blackmagic clip.

    Raises
    ------
    CameraError : The file is no such text, or a line holds what it may not.
    """
    path = Path(path)
    rows: list[Row] = []
    clip: dict[str, str] = {}
    block: RowReadings | None = None
    for line, text in read_lines(path):
        if FRAME_HEADING.fullmatch(text):
            block = RowReadings(path, line)
            block.put("lens_model", clip.get("lens_type"), "lens_type")
            block.put("camera_model", clip.get("camera_type"), "camera_type")
            rows.append(Row(line, block))
            if len(rows) > MOST_ROWS:
                raise CameraError(f"has more than {MOST_ROWS} frames", where=path)
            continue
        key, colon, value = text.partition(":")
        value = value.strip()
        if not colon or is_missing(value):
            continue
        if block is None:
            if key in ("lens_type", "camera_type"):
                clip[key] = value
            continue
        block.line = line
        with block.naming_line():
            _take(block, key, value)
    return CameraTable(path, BLACKMAGIC_KIND, shared(rows))


def _take(block: RowReadings, key: str, value: str) -> None:
    if key == "aperture":
        kind, stopped = stop(value, key)
        block.put("t_number" if kind == "T" else "f_number", stopped, key)
    elif key == "focal_length":
        block.put("focal_length_mm", _length_mm(value, key), key)
    elif key == "distance":
        block.put("focus_distance_mm", _length_mm(value, key), key)


def _length_mm(text: str, key: str) -> float:
    """A length with its unit; millimetres if it has none."""
    match = _LENGTH.fullmatch(text) if len(text) < 64 else None
    if match is None:
        raise CameraError(f"{key} is {text[:40]!r} and should be a length, as 991mm")
    return number(match[1], key) * (unit_mm(match[2], key) if match[2] else 1.0)


SONY_XML_KIND = "Sony clip XML"
SONY_XML_ROOT = "NonRealTimeMeta"
_MOST_XML_BYTES = 4 << 20
_MODELS = (("Camera", "camera_model"), ("Lens", "lens_model"))
_ENTITIES = ("<!DOCTYPE", "<!ENTITY")


def read_sony_xml(path: str | Path) -> CameraTable:
    """The camera and lens of a Sony clip.

    Raises
    ------
    CameraError : It is no such XML, or states neither.
    """
    path = Path(path)
    text = read_text(path, _MOST_XML_BYTES)
    if any(word in text for word in _ENTITIES):
        raise CameraError("is XML with entities, which no camera writes", where=path)
    # The text is decoded: the encoding that its first line declares no longer counts.
    parser = ElementTree.XMLParser(encoding="utf-8")
    try:
        root = ElementTree.fromstring(text.encode(), parser)
    except ElementTree.ParseError as error:
        raise CameraError(f"is not valid XML ({error})", where=path) from error
    if _plain_name(root) != SONY_XML_ROOT:
        raise CameraError(
            f"is no {SONY_XML_KIND}: it holds no {SONY_XML_ROOT}", where=path
        )
    found = RowReadings(path, 1)
    for element in root.iter():
        for name, quantity in _MODELS:
            model = (element.get("modelName") or "").strip()
            if _plain_name(element) == name and model:
                found.put(quantity, model, f"{name} modelName")
    if not found:
        raise CameraError(
            f"is a {SONY_XML_KIND} without a camera or a lens", where=path
        )
    note = (
        f"{path.name} is a {SONY_XML_KIND}: it tells the camera and the lens; focal "
        "length, stop and focus come from the clip's table of frames (--metadata)"
    )
    return CameraTable(path, SONY_XML_KIND, [Row(1, found)], (note,))


def _plain_name(element: ElementTree.Element) -> str:
    """Without its namespace, which holds a version."""
    return element.tag.rpartition("}")[2]
