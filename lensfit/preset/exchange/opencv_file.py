"""OpenCV calibrations as `cv2.FileStorage` writes them, in YAML and in XML.

The names are those of OpenCV's calibration sample, with what others write accepted:
camera_matrix, distortion_coefficients, image_width, image_height. Only what the file
format itself writes is understood of YAML: keys at the left margin, matrices as
mappings with rows, cols and data (as ROS writes them too).
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float

from lensfit.errors import ExchangeError
from lensfit.preset.exchange.foreign import ForeignLens, Stated, lens_of_camera
from lensfit.preset.exchange.opencv import COUNTS, OpenCvMap
from lensfit.preset.exchange.text_file import (
    finite,
    picture_size,
    positive,
    read_text,
)
from lensfit.preset.exchange.xml_tree import Element, read_xml

_KIND = "OpenCV calibration"
_MATRIX = ("camera_matrix", "cameramatrix", "k", "m", "m1", "intrinsic_matrix", "mtx")
_COEFFICIENTS = (
    "distortion_coefficients", "dist_coeffs", "distcoeffs", "dist_coeff", "d", "d1",
    "dist", "distortion",
)  # fmt: skip
_WIDTH, _HEIGHT = ("image_width", "width"), ("image_height", "height")
_SIZE = ("image_size", "imagesize", "size")
_MOST_NUMBERS = 256
_FISHEYE = re.compile(r"fisheye|equidistant|kannala|omni|\bmei\b", re.IGNORECASE)


@dataclass(frozen=True, eq=False)
class OpenCvFile:
    """What a calibration file holds; `size_px` is None when it does not say."""

    matrix: Float[np.ndarray, "3 3"]
    coefficients: Float[np.ndarray, "14"]
    size_px: tuple[int, int] | None


class _Fields:
    """Numbers of a file by the name of their key, in lower case."""

    def __init__(self, fields: Mapping[str, list[str]], path: Path):
        self.fields = {name.lower(): words for name, words in fields.items()}
        self.path = path

    def numbers(self, names: tuple[str, ...]) -> list[float] | None:
        name = next((n for n in names if n in self.fields), None)
        if name is None:
            return None
        words = self.fields[name]
        if len(words) > _MOST_NUMBERS:
            raise ExchangeError(f"{name} has {len(words)} numbers", where=self.path)
        return [finite(word, name, self.path) for word in words]


def read_opencv(path: str | Path) -> OpenCvFile:
    """The camera in a calibration file, YAML or XML.

    Raises
    ------
    ExchangeError : It holds no camera matrix or coefficients, or what cannot be.
    """
    path = Path(path)
    text = read_text(path, _KIND)
    is_xml = text.lstrip()[:1] == "<"
    fields = _Fields(_of_xml(read_xml(path, _KIND)) if is_xml else _of_yaml(text), path)
    model = " ".join(fields.fields.get("distortion_model", []))
    if _FISHEYE.search(model) or (
        "fisheye_model" in fields.fields
        and (fields.numbers(("fisheye_model",)) != [0.0])
    ):
        raise ExchangeError(
            "is of OpenCV's fisheye model, which is not read",
            where=path,
            remedy="hand over its UV map, or calibrate with calibrateCamera",
        )
    matrix = fields.numbers(_MATRIX)
    if matrix is None or len(matrix) != 9:
        raise ExchangeError("holds no 3 x 3 camera_matrix", where=path)
    return OpenCvFile(
        _camera_matrix(np.array(matrix).reshape(3, 3), path),
        _coefficients(fields.numbers(_COEFFICIENTS), path),
        _size(fields, path),
    )


def lens_of_opencv(found: OpenCvFile, stated: Stated, where: str | Path) -> ForeignLens:
    """The lens of a calibration, once the size of its sensor is known.

    Raises
    ------
    ExchangeError : Nobody says the size of picture or sensor, or another size in pixels
        is stated than the file has.
    """
    size = stated.size_px or found.size_px
    if size is None:
        raise ExchangeError(
            "does not say how large the picture is", where=where, remedy="give --size"
        )
    stated.require_size(found.size_px or size, where)
    pitch = stated.pitch_mm(size, where)
    camera = OpenCvMap(found.matrix, found.coefficients, size, pitch)
    return lens_of_camera(_KIND, camera, stated, where)


def opencv_text(camera: OpenCvMap, comments: tuple[str, ...]) -> str:
    """The calibration as YAML that `cv2.FileStorage` reads.

    Coefficients end where the model has no more: 5, 8, 12 or 14 are written.
    """
    used = np.flatnonzero(camera.coefficients)
    last = int(used[-1]) + 1 if len(used) else 0
    count = next(n for n in COUNTS if n >= max(last, 5))
    lines = ["%YAML:1.0", "---", *(f"# {comment}" for comment in comments)]
    lines += [
        f"image_width: {camera.size_px[0]}",
        f"image_height: {camera.size_px[1]}",
        *_yaml_matrix("camera_matrix", camera.matrix),
        *_yaml_matrix("distortion_coefficients", camera.coefficients[None, :count]),
    ]
    return "\n".join(lines) + "\n"


def _yaml_matrix(name: str, matrix: np.ndarray) -> list[str]:
    numbers = ", ".join(repr(float(v)) for v in matrix.ravel())
    rows, cols = matrix.shape
    head = [f"{name}: !!opencv-matrix", f"   rows: {rows}", f"   cols: {cols}"]
    return [*head, "   dt: d", f"   data: [ {numbers} ]"]


_KEY = re.compile(r"^([A-Za-z_]\w*)[ \t]*:[ \t]*(.*)$")
_DATA = re.compile(r"\bdata[ \t]*:\s*\[")


def _of_yaml(text: str) -> dict[str, list[str]]:
    """Words of every key at the left margin; of a mapping, those of its `data`."""
    blocks: dict[str, list[str]] = {}
    current: list[str] = []
    for line in text.splitlines():
        match = _KEY.match(line)
        if match is not None:
            current = blocks.setdefault(match[1], [])
            current.clear()
            current.append(match[2])
        elif line[:1] in (" ", "\t", "-", "]"):
            current.append(line)
    return {name: _words("\n".join(lines)) for name, lines in blocks.items()}


def _words(block: str) -> list[str]:
    data = _DATA.search(block)
    if data is not None:
        inside = block[data.end() :].partition("]")[0]
    else:
        inside = re.sub(r"!!\S+|#.*", "", block)
    words = re.split(r"[\s,\[\]]+", inside)
    return [w for w in (word.strip("\"'") for word in words) if w not in ("", "-")]


def _of_xml(root: Element) -> dict[str, list[str]]:
    def words(element: Element) -> list[str]:
        data = element.text_of("data")
        return (element.text if data is None else data).replace('"', " ").split()

    return {child.tag: words(child) for child in root.children}


def _camera_matrix(matrix: np.ndarray, path: Path) -> np.ndarray:
    below = np.array([matrix[1, 0], *matrix[2]])
    if not np.array_equal(below, [0, 0, 0, 1]):
        raise ExchangeError("camera_matrix is not that of a camera", where=path)
    for axis in (0, 1):
        positive(float(matrix[axis, axis]), "camera_matrix: focal length", path)
    return matrix


def _coefficients(numbers: list[float] | None, path: Path) -> np.ndarray:
    if numbers is None:
        raise ExchangeError("holds no distortion_coefficients", where=path)
    if len(numbers) not in COUNTS:
        raise ExchangeError(
            f"holds {len(numbers)} distortion_coefficients",
            where=path,
            remedy=f"OpenCV has {', '.join(map(str, COUNTS))}",
        )
    return np.array([*numbers, *[0.0] * (14 - len(numbers))])


def _size(fields: _Fields, path: Path) -> tuple[int, int] | None:
    both = fields.numbers(_SIZE)
    width, height = fields.numbers(_WIDTH), fields.numbers(_HEIGHT)
    if both is None and width is not None and height is not None:
        both = [*width, *height]
    if both is None:
        return None
    return picture_size(both, "the image size", path)
