"""A look on a camera that it was not measured on: the picture of a scaled scene."""

import json
from pathlib import Path

import numpy as np
import pytest
from plate_makers import DISPLAY, make_preset, scene
from typer.testing import CliRunner

from lensfit.cli.main import app
from lensfit.io.exr import ExrImage, ExrPart, read_exr, write_exr
from lensfit.preset.store import save_preset


def plate(path: Path, focal: float, width: float, scale: float, **more) -> Path:
    """The same picture, of a scene and a focus so many times as far away."""
    x = np.linspace(1.5, 4.0, DISPLAY.width, dtype=np.float32) * scale
    channels = dict(zip("RGB", np.moveaxis(scene(DISPLAY), -1, 0), strict=True))
    channels["Z"] = np.broadcast_to(x, (DISPLAY.height, DISPLAY.width)).copy()
    header = {"lens/focal": focal, "lens/fstop": 2.8, "lens/focus": 2.0 * scale}
    header |= {"lens/aperture": width, "depth/kind": "perpendicular", **more}
    write_exr(path, ExrImage((ExrPart(channels, DISPLAY, DISPLAY, header),)))
    return path


@pytest.fixture
def applied(tmp_path):
    save_preset(make_preset(), tmp_path / "preset.json")

    def run(image: Path, *words: object):
        out = tmp_path / "out"
        words = ("apply", tmp_path / "preset.json", image, "--out", out, *words)
        done = CliRunner().invoke(app, [str(word) for word in words])
        return done, out / image.name

    return run


def pixels(path: Path) -> np.ndarray:
    part = read_exr(path).parts[0]
    return np.stack([part.channels[n] for n in "RGB"])


@pytest.mark.parametrize(
    ("focal", "width", "scale", "said"),
    [
        (70.0, 72.0, 2.0, "by field angle"),  # everything twice as large
        (35.0, 72.0, 0.5, "in units of the frame"),
        (17.5, 36.0, 0.25, "in units of the frame"),
    ],
)
def test_a_scaled_camera_sees_the_same_picture(
    tmp_path, applied, focal, width, scale, said
):
    """The circle of confusion of a thin lens: focal length squared over the distance
    and the width of the frame."""
    assert scale == pytest.approx((focal / 35) ** 2 * 36 / width)
    done, expected = applied(plate(tmp_path / "a.exr", 35.0, 36.0, 1.0))
    assert done.exit_code == 0, done.stderr
    image = plate(tmp_path / "b.exr", focal, width, scale)
    done, _ = applied(image)
    assert done.exit_code == 1
    assert "--scale-to-sensor" in done.stderr
    done, found = applied(image, "--scale-to-sensor")
    assert done.exit_code == 0, done.stderr
    assert said in done.stderr
    assert f"put on {focal:g} mm on {width:g} mm" in done.stderr
    np.testing.assert_allclose(pixels(found), pixels(expected), atol=2e-5)
    header = read_exr(found).parts[0].attributes
    assert header["nominalFocalLength"] == pytest.approx(focal)
    assert header["focus"] == pytest.approx(2 * scale)


def test_what_was_measured_is_rendered_as_it_stands(tmp_path, applied):
    image = plate(tmp_path / "a.exr", 35.0, 36.0, 1.0)
    done, found = applied(image)
    assert done.exit_code == 0, done.stderr
    done, _ = applied(image, "--scale-to-sensor", "--json")
    assert json.loads(done.stdout)["skipped"] == [str(found)]


def test_no_width_is_no_sensor_to_scale_to(tmp_path, applied):
    image = plate(tmp_path / "a.exr", 35.0, 36.0, 1.0)
    words = ("--scale-to-sensor", "--sensor-width-mm", "inf")
    done, _ = applied(image, *words)
    assert done.exit_code == 1
    assert "the sensor is stated to be inf mm wide" in done.stderr
