"""Sony's XML beside a clip (NonRealTimeMeta, called ...M01.XML): what stays over it.

VENICE states the models of camera and lens there. Focal length, stop and focus are not
in it: they change, and stand in the clip's table of frames (`lensfit.io.camera.sony`).

Source: a clip of VENICE in camdkit (SMPTE RIS), with the table that belongs to it.
"""

from pathlib import Path
from xml.etree import ElementTree

from lensfit.errors import CameraError
from lensfit.io.camera.table import CameraTable, Row, RowReadings
from lensfit.io.camera.text import read_text

KIND = "Sony clip XML"
ROOT = "NonRealTimeMeta"
_MOST_BYTES = 4 << 20
_MODELS = (("Camera", "camera_model"), ("Lens", "lens_model"))
_ENTITIES = ("<!DOCTYPE", "<!ENTITY")


def read_sony_xml(path: str | Path) -> CameraTable:
    """The camera and lens of a Sony clip.

    Raises
    ------
    CameraError : It is no such XML, or states neither.
    """
    path = Path(path)
    text = read_text(path, _MOST_BYTES)
    if any(word in text for word in _ENTITIES):
        raise CameraError("is XML with entities, which no camera writes", where=path)
    # The text is decoded: the encoding that its first line declares no longer counts.
    parser = ElementTree.XMLParser(encoding="utf-8")
    try:
        root = ElementTree.fromstring(text.encode(), parser)
    except ElementTree.ParseError as error:
        raise CameraError(f"is not valid XML ({error})", where=path) from error
    if _name(root) != ROOT:
        raise CameraError(f"is no {KIND}: it holds no {ROOT}", where=path)
    found = RowReadings(path, 1)
    for element in root.iter():
        for name, quantity in _MODELS:
            model = (element.get("modelName") or "").strip()
            if _name(element) == name and model:
                found.put(quantity, model, f"{name} modelName")
    if not found:
        raise CameraError(f"is a {KIND} without a camera or a lens", where=path)
    note = (
        f"{path.name} is a {KIND}: it tells the camera and the lens; focal length, "
        "stop and focus come from the clip's table of frames (--metadata)"
    )
    return CameraTable(path, KIND, [Row(1, found)], (note,))


def _name(element: ElementTree.Element) -> str:
    """Without its namespace, which holds a version."""
    return element.tag.rpartition("}")[2]
