"""OpenCV's camera: a matrix in pixels and up to fourteen distortion coefficients.

With x, y the direction X/Z, Y/Z of a point (x right, y down):

    x'' = x (1 + k1 r^2 + k2 r^4 + k3 r^6) / (1 + k4 r^2 + k5 r^4 + k6 r^6)
          + 2 p1 x y + p2 (r^2 + 2 x^2) + s1 r^2 + s2 r^4

and y'' with p1 (r^2 + 2 y^2) + 2 p2 x y + s3 r^2 + s4 r^4, then for a tilted sensor the
homography of tau_x, tau_y; the pixel is K (x'', y'', 1). The order of a file is
k1 k2 p1 p2 k3 k4 k5 k6 s1 s2 s3 s4 tau_x tau_y. Integers are pixel centres there:
lensfit's position is half a pixel more, and so is the principal point.

Files are read as `cv2.FileStorage` writes them, in YAML and in XML. The names are those
of OpenCV's calibration sample, with what others write accepted: camera_matrix,
distortion_coefficients, image_width, image_height. Only what the file format itself
writes is understood of YAML: keys at the left margin, matrices as mappings with rows,
cols and data (as ROS writes them too).

Source: OpenCV's documentation of the camera calibration module.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import final

import numpy as np
from jaxtyping import Float

from lensfit.errors import ExchangeError
from lensfit.exchange.foreign import (
    ForeignLens,
    Points,
    StatedValues,
    inverse_points,
    lens_of_camera,
)
from lensfit.exchange.text_file import (
    Element,
    finite_number,
    picture_size,
    positive_number,
    read_text,
    read_xml,
)

COUNTS = (4, 5, 8, 12, 14)
"""How many coefficients a file may hold."""


def opencv_distorted(
    directions: Points, coefficients: Float[np.ndarray, "14"]
) -> Points:
    """x'', y'' of directions X/Z, Y/Z."""
    k1, k2, p1, p2, k3, k4, k5, k6, s1, s2, s3, s4, tau_x, tau_y = coefficients
    x, y = directions[:, 0], directions[:, 1]
    r2 = x * x + y * y
    r4 = r2 * r2
    ratio = (1 + r2 * (k1 + r2 * (k2 + r2 * k3))) / (
        1 + r2 * (k4 + r2 * (k5 + r2 * k6))
    )
    bent = np.stack(
        [
            x * ratio + 2 * p1 * x * y + p2 * (r2 + 2 * x * x) + s1 * r2 + s2 * r4,
            y * ratio + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y + s3 * r2 + s4 * r4,
        ],
        -1,
    )
    return bent if not (tau_x or tau_y) else _tilted_points(bent, tau_x, tau_y)


def _tilted_points(points: Points, tau_x: float, tau_y: float) -> Points:
    cx, sx, cy, sy = np.cos(tau_x), np.sin(tau_x), np.cos(tau_y), np.sin(tau_y)
    about_x = np.array([[1, 0, 0], [0, cx, sx], [0, -sx, cx]])
    about_y = np.array([[cy, 0, -sy], [0, 1, 0], [sy, 0, cy]])
    turned = about_y @ about_x
    onto = np.array(
        [[turned[2, 2], 0, -turned[0, 2]], [0, turned[2, 2], -turned[1, 2]], [0, 0, 1]]
    )
    landed = np.column_stack([points, np.ones(len(points))]) @ (onto @ turned).T
    return landed[:, :2] / landed[:, 2:]


@final
@dataclass(frozen=True, eq=False)
class OpenCvMap:
    """The camera over a sensor of known size.

    Attributes
    ----------
    matrix : K, pixels.
    coefficients : All fourteen.
    size_px : Width and height of the picture.
    pitch_mm : Of its square pixels.
    """

    matrix: Float[np.ndarray, "3 3"]
    coefficients: Float[np.ndarray, "14"]
    size_px: tuple[int, int]
    pitch_mm: float

    @property
    def principal_distance_mm(self) -> float:
        """Geometric mean of both axes."""
        return float(np.sqrt(self.matrix[0, 0] * self.matrix[1, 1])) * self.pitch_mm

    @property
    def principal_point_mm(self) -> tuple[float, float]:
        """From the sensor centre."""
        point = self._mm(self.matrix[None, :2, 2])[0]
        return float(point[0]), float(point[1])

    def distorted(self, undistorted_mm: Points) -> Points:
        """The closed form."""
        about = np.asarray(undistorted_mm, float) - np.array(self.principal_point_mm)
        bent = opencv_distorted(about / self.principal_distance_mm, self.coefficients)
        return self._mm(bent @ self.matrix[:2, :2].T + self.matrix[:2, 2])

    def undistorted(self, distorted_mm: Points) -> Points:
        """The inverse; NaN where there is none."""
        unit = self.pitch_mm * float(np.hypot(*self.size_px)) / 2
        return inverse_points(self.distorted, distorted_mm, unit)

    def _mm(self, pixels: Points) -> Points:
        half = np.array(self.size_px, float) / 2
        return (pixels + 0.5 - half) * self.pitch_mm


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
    """What a calibration file holds; `size_px` is None if not stated."""

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
        return [finite_number(word, name, self.path) for word in words]


def read_opencv(path: str | Path) -> OpenCvFile:
    """The camera in a calibration file, YAML or XML.

    Raises
    ------
    ExchangeError : It holds no camera matrix or coefficients, or what cannot be.
    """
    path = Path(path)
    text = read_text(path, _KIND)
    is_xml = text.lstrip()[:1] == "<"
    fields = _Fields(
        _xml_words(read_xml(path, _KIND)) if is_xml else _yaml_words(text), path
    )
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


def lens_of_opencv(
    found: OpenCvFile, stated: StatedValues, where: str | Path
) -> ForeignLens:
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


def _yaml_words(text: str) -> dict[str, list[str]]:
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


def _xml_words(root: Element) -> dict[str, list[str]]:
    def words(element: Element) -> list[str]:
        data = element.text_of("data")
        return (element.text if data is None else data).replace('"', " ").split()

    return {child.tag: words(child) for child in root.children}


def _camera_matrix(matrix: np.ndarray, path: Path) -> np.ndarray:
    below = np.array([matrix[1, 0], *matrix[2]])
    if not np.array_equal(below, [0, 0, 0, 1]):
        raise ExchangeError("camera_matrix is not that of a camera", where=path)
    for axis in (0, 1):
        positive_number(float(matrix[axis, axis]), "camera_matrix: focal length", path)
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
