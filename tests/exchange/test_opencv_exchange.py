"""OpenCV's camera: its own library agrees, in pixels and in files."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from lensfit.errors import ExchangeError
from lensfit.exchange.foreign import StatedValues
from lensfit.exchange.opencv import (
    OpenCvMap,
    lens_of_opencv,
    opencv_distorted,
    opencv_text,
    read_opencv,
)

MATRIX = np.array([[2000.0, 0.0, 1030.0], [0.0, 2010.0, 760.0], [0.0, 0.0, 1.0]])
COEFFICIENTS = np.array(
    [
        *(-0.2, 0.1, 1e-3, -2e-3, -0.03),
        *(0.01, 0.02, -0.01),
        *(1e-3, -2e-3, 5e-4, 1e-3),
        *(0.02, -0.03),
    ]
)


def directions() -> np.ndarray:
    x, y = np.meshgrid(np.linspace(-0.55, 0.55, 9), np.linspace(-0.4, 0.4, 7))
    return np.stack([x.ravel(), y.ravel()], -1)


@pytest.mark.parametrize("count", [4, 5, 8, 12, 14])
def test_directions_land_where_opencv_puts_them(count: int):
    used = np.where(np.arange(14) < count, COEFFICIENTS, 0.0)
    points = np.column_stack([directions(), np.ones(len(directions()))])
    known, _ = cv2.projectPoints(points, np.zeros(3), np.zeros(3), MATRIX, used[:count])
    found = opencv_distorted(directions(), used) @ MATRIX[:2, :2].T + MATRIX[:2, 2]
    assert np.abs(found - known[:, 0]).max() < 1e-9


def test_the_principal_point_is_half_a_pixel_more_than_opencvs():
    centred = np.array([[100.0, 0, 31.5], [0, 100.0, 23.5], [0, 0, 1]])
    camera = OpenCvMap(centred, np.zeros(14), (64, 48), 0.01)
    assert camera.principal_point_mm == pytest.approx((0.0, 0.0), abs=1e-15)
    # the centre of OpenCV's pixel 0, 0 is half a pixel inside the corner
    corner = camera.distorted(np.array([[-0.315, -0.235]]))
    assert corner == pytest.approx(np.array([[-0.315, -0.235]]))


def test_undistorting_undoes_distorting():
    camera = OpenCvMap(MATRIX, COEFFICIENTS, (2048, 1536), 24 / 2048)
    points = directions() * camera.principal_distance_mm
    back = camera.undistorted(camera.distorted(points))
    assert np.abs(back - points).max() < 1e-9


def test_opencv_reads_what_is_written(tmp_path: Path):
    path = tmp_path / "camera.yaml"
    used = np.where(np.arange(14) < 8, COEFFICIENTS, 0.0)
    path.write_text(
        opencv_text(OpenCvMap(MATRIX, used, (2048, 1536), 0.01), ("two: words",))
    )
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_READ)
    assert storage.getNode("image_width").real() == 2048
    assert storage.getNode("image_height").real() == 1536
    assert np.array_equal(storage.getNode("camera_matrix").mat(), MATRIX)
    assert np.array_equal(
        storage.getNode("distortion_coefficients").mat().ravel(), used[:8]
    )


@pytest.mark.parametrize("suffix", [".yml", ".xml"])
@pytest.mark.parametrize("count", [5, 14])
def test_what_opencv_writes_is_read_bit_for_bit(
    tmp_path: Path, suffix: str, count: int
):
    path = tmp_path / f"camera{suffix}"
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    storage.write("calibration_time", "Mon 01 Jan: noon")
    storage.write("image_width", 2048)
    storage.write("image_height", 1536)
    storage.write("camera_matrix", MATRIX)
    storage.write("distortion_coefficients", COEFFICIENTS[:count, None])
    storage.release()
    found = read_opencv(path)
    assert found.size_px == (2048, 1536)
    assert np.array_equal(found.matrix, MATRIX)
    assert np.array_equal(found.coefficients[:count], COEFFICIENTS[:count])
    assert not found.coefficients[count:].any()


def test_a_ros_file_is_read(tmp_path: Path):
    path = tmp_path / "camera.yaml"
    path.write_text(
        "image_width: 640\nimage_height: 480\ncamera_name: narrow\n"
        "camera_matrix:\n  rows: 3\n  cols: 3\n  data: [600, 0, 320, 0, 601, 240, "
        "0, 0, 1]\ndistortion_model: plumb_bob\n"
        "distortion_coefficients:\n  rows: 1\n  cols: 5\n  data: [-.1, .01, 0, 0, 0]\n"
    )
    found = read_opencv(path)
    assert found.matrix[1, 1] == 601
    assert found.coefficients[0] == -0.1
    path.write_text(path.read_text().replace("plumb_bob", "equidistant"))
    with pytest.raises(ExchangeError, match="fisheye model"):
        read_opencv(path)


def test_the_sensor_and_the_size_must_be_known(tmp_path: Path):
    path = tmp_path / "camera.yaml"
    text = opencv_text(OpenCvMap(MATRIX, COEFFICIENTS, (2048, 1536), 0.01), ())
    path.write_text(text)
    with pytest.raises(ExchangeError, match="give --sensor-width-mm"):
        lens_of_opencv(read_opencv(path), StatedValues(), path)
    with pytest.raises(ExchangeError, match="is for 2048 x 1536"):
        lens_of_opencv(
            read_opencv(path),
            StatedValues(sensor_width_mm=24.0, size_px=(10, 10)),
            path,
        )
    path.write_text(text.replace("image_width", "foo"))
    with pytest.raises(ExchangeError, match="give --size"):
        lens_of_opencv(read_opencv(path), StatedValues(sensor_width_mm=24.0), path)
    (tmp_path / "one.yaml").write_text("%YAML:1.0\n---\n")
    with pytest.raises(ExchangeError, match="no 3 x 3 camera_matrix"):
        read_opencv(tmp_path / "one.yaml")
