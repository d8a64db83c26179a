"""A look on a camera that it was not measured on: the picture of a scaled scene."""

import json
from pathlib import Path

import numpy as np
import pytest
from plate_makers import DISPLAY, make_preset, scene
from typer.testing import CliRunner

from lensfit.cli.main import app
from lensfit.coords import Window
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


def ran(command: str, tmp_path: Path, *words: object):
    save_preset(make_preset(), tmp_path / "preset.json")
    return CliRunner().invoke(
        app, [str(word) for word in (command, tmp_path / "preset.json", *words)]
    )


MEASURED = ("--focal-length-mm", 35, "--sensor-width-mm", 36)
TWICE = ("--focal-length-mm", 70, "--sensor-width-mm", 72)
SCALED = (*TWICE, "--scale-to-sensor")
NOTE = "put on 70 mm on 72 mm (--scale-to-sensor), by field angle"


def test_maps_of_a_scaled_camera_are_those_of_the_measured_one(tmp_path):
    size = ("--size", "96x64", "--json", "--out")
    done = ran("stmap", tmp_path, *MEASURED, *size, tmp_path / "measured")
    assert done.exit_code == 0, done.stderr
    measured = json.loads(done.stdout)
    done = ran("stmap", tmp_path, *TWICE, *size, tmp_path / "twice")
    assert done.exit_code == 1
    assert done.stderr.count("\n") == 1
    assert "--scale-to-sensor" in done.stderr
    words = (*SCALED, "--focus-distance-mm", 4000, *size)
    done = ran("stmap", tmp_path, *words, tmp_path / "twice")
    assert done.exit_code == 0, done.stderr
    assert NOTE in done.stderr
    twice = json.loads(done.stdout)
    assert twice["overscan_needed"] == measured["overscan_needed"]
    for one, other in zip(measured["files"], twice["files"], strict=True):
        assert "_70mm_4000mm_" in other
        same(Path(one), Path(other))
        header = read_exr(Path(other)).parts[0].attributes
        assert header["lens/focal"] == header["nominalFocalLength"] == 70
        assert header["lens/aperture"] == 72
        assert header["lens/focus"] == pytest.approx(4)


def same(one: Path, other: Path) -> None:
    """The same map of two cameras."""
    found = (read_exr(path).parts[0].channels for path in (one, other))
    for a, b in zip(*(channels.values() for channels in found), strict=True):
        np.testing.assert_allclose(a, b, atol=1e-7)


def test_moving_maps_of_a_scaled_camera(tmp_path):
    plate(tmp_path / "a.1001.exr", 35.0, 36.0, 1.0)
    image = plate(tmp_path / "b.1001.exr", 70.0, 72.0, 2.0)
    words = ("--plates", image, "--json", "--out", tmp_path / "b")
    done = ran("stmap", tmp_path, *words)
    assert done.exit_code == 1
    assert "--scale-to-sensor" in done.stderr
    done = ran("stmap", tmp_path, *words, "--scale-to-sensor")
    assert done.exit_code == 0, done.stderr
    assert NOTE in done.stderr
    twice = json.loads(done.stdout)["files"]
    words = ("--plates", tmp_path / "a.1001.exr", "--json", "--out", tmp_path / "a")
    measured = json.loads(ran("stmap", tmp_path, *words).stdout)["files"]
    for one, other in zip(measured, twice, strict=True):
        header = read_exr(Path(other)).parts[0].attributes
        assert (header["lens/focal"], header["lens/focus"]) == (70, 4)
        same(Path(one), Path(other))


@pytest.mark.parametrize("command", ["undistort", "export"])
def test_what_scales_no_look_names_what_does(tmp_path, command):
    """It has no such option itself, and the one that it names makes maps for it."""
    image = plate(tmp_path / "a.exr", 70.0, 72.0, 2.0)
    words = {
        "undistort": (image, "--out", tmp_path / "out"),
        "export": (*TWICE, "--to", "opencv", "--out", tmp_path / "a.yaml"),
    }[command]
    done = ran(command, tmp_path, *words)
    assert done.exit_code == 1
    (line,) = [one for one in done.stderr.splitlines() if "error" in one]
    assert "by the UV maps of `lensfit stmap --scale-to-sensor`" in line
    assert "of apply" not in line


def test_overscan_of_a_scaled_camera_has_its_film_back(tmp_path):
    near = ("--size", "960x640", "--f-number", 2, "--json", "--nearest-mm")
    focus = "--focus-distance-mm"
    done = ran("overscan", tmp_path, *MEASURED, *near, 900, focus, 2000)
    measured = json.loads(done.stdout)
    done = ran("overscan", tmp_path, *TWICE, *near, 1800, focus, 4000)
    assert done.exit_code == 1
    assert done.stderr.count("\n") == 1
    assert "--scale-to-sensor" in done.stderr
    done = ran("overscan", tmp_path, *SCALED, *near, 1800, focus, 4000)
    assert done.exit_code == 0, done.stderr
    assert NOTE in done.stderr
    twice = json.loads(done.stdout)
    for one, other in (
        (measured, twice),
        (measured["depth_of_field"], twice["depth_of_field"]),
    ):
        assert other["margins_px"] == one["margins_px"]
        assert other["sensor_mm"] == pytest.approx([2 * mm for mm in one["sensor_mm"]])
    blurs = [one["depth_of_field"]["blur_radius_px"] for one in (measured, twice)]
    assert blurs[0] == pytest.approx(blurs[1], rel=1e-6)


def test_overscan_over_scaled_focal_lengths_names_both_ends(tmp_path):
    words = ("--size", "960x640", "--scale-to-sensor", "--focal-length-mm", "17.5:70")
    done = ran("overscan", tmp_path, *words)
    assert done.exit_code == 0, done.stderr
    assert done.stderr.count("the look of 35 mm") == 2
    assert "put on 17.5 mm on 36 mm" in done.stderr
    assert "put on 70 mm on 36 mm" in done.stderr


def test_overscan_that_a_plate_of_a_scaled_camera_has(tmp_path):
    image = plate(tmp_path / "b.exr", 70.0, 72.0, 2.0)
    done = ran("overscan", tmp_path, "--plate", image)
    assert done.exit_code == 1
    assert "--scale-to-sensor" in done.stderr
    done = ran("overscan", tmp_path, "--plate", image, "--scale-to-sensor", "--json")
    assert done.exit_code == 0, done.stderr
    assert done.stderr.count("the look of 35 mm") == 1
    twice = json.loads(done.stdout)
    image = plate(tmp_path / "a.exr", 35.0, 36.0, 1.0)
    measured = json.loads(ran("overscan", tmp_path, "--plate", image, "--json").stdout)
    assert twice["margins_px"] == measured["margins_px"]
    assert twice["plate"] == measured["plate"]
    assert twice["sensor_mm"] == pytest.approx([2 * x for x in measured["sensor_mm"]])


def test_a_frame_far_taller_than_was_photographed_is_refused(tmp_path, applied):
    window = Window.of_size(48, 96)
    channels = dict(zip("RGB", np.moveaxis(scene(window), -1, 0), strict=True))
    header = {"lens/focal": 35.0, "lens/fstop": 2.8, "lens/focus": 2.0}
    for width, is_far in ((36.0, True), (20.0, False)):
        header |= {"lens/aperture": width}
        part = ExrPart(channels, window, window, header)
        write_exr(tmp_path / "tall.exr", ExrImage((part,)))
        done, made = applied(tmp_path / "tall.exr", "--no-defocus")
        assert (f"spans {width:g} x 72 mm" in done.stderr) is is_far
        assert made.exists() is not is_far
