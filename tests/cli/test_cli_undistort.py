"""`lensfit undistort`: photographs made straight, the camera that is left, and back.

A plate whose channels are its own pixel positions says after any warp where each pixel
was read, so that the lens' own equations are the judge.
"""

import json
import math

import numpy as np
import pytest
from plate_makers import CAMERA, DISPLAY, SENSOR, make_preset
from scipy.special import erf
from typer.testing import CliRunner

from lensfit.cli.main import app
from lensfit.coords import Window
from lensfit.io.exr import ExrImage, ExrPart, read_exr, write_exr
from lensfit.preset.store import save_preset
from lensfit.rendering.uv import PlateGeometry

FRAME = Window.of_size(240, 160)
HEADER = {**CAMERA, **SENSOR}
BACK = ["--no-defocus", "--tolerance", "2e-4"]
ROUND_TRIP_PX, ROUND_TRIP_RMS = 0.02, 0.003


@pytest.fixture
def lens(tmp_path):
    save_preset(make_preset(), tmp_path / "preset.json")
    return make_preset().at(35.0, 2.8, 2000.0)


def photograph(path, planes, window=FRAME, display=FRAME, header=HEADER):
    channels = {n: np.ascontiguousarray(p, np.float32) for n, p in planes.items()}
    part = ExrPart(channels, window, display, header)
    write_exr(path, ExrImage((part,)))
    return path


def ramps(window):
    """Each pixel's own position: x in red and blue, y in green."""
    x, y = np.moveaxis(window.pixel_centres(), -1, 0)
    return {"R": x, "G": y, "B": x}


def run(tmp_path, command, plate, *options):
    words = [command, tmp_path / "preset.json", plate, *options]
    return CliRunner().invoke(app, [str(word) for word in words])


def straight(tmp_path, plate, *options, out="straight"):
    words = ["--out", tmp_path / out, "--tolerance", "2e-4", *options]
    done = run(tmp_path, "undistort", plate, *words)
    assert done.exit_code == 0, done.output
    return read_exr(tmp_path / out / plate.name).parts[0]


def distorted_px(lens, window, channel="g"):
    geometry = PlateGeometry.of(lens, FRAME, 36.0)
    points = window.pixel_centres().reshape(-1, 2)
    mm = lens.distorted_from_undistorted(geometry.mm(points), channel)
    return geometry.px(np.asarray(mm)).reshape(window.height, window.width, 2)


def inside(read, margin=4.0):
    size = np.array([FRAME.width, FRAME.height])
    return ((read > margin) & (read < size - margin)).all(-1)


def test_each_pixel_reads_where_the_lens_puts_it(tmp_path, lens):
    plate = photograph(tmp_path / "a.0001.exr", ramps(FRAME))
    made = straight(tmp_path, plate)
    read = distorted_px(lens, made.data_window)
    seen = inside(read)
    assert seen.mean() > 0.7
    for name, axis in (("R", 0), ("G", 1), ("B", 0)):
        error = np.abs(made.channels[name] - read[..., axis])[seen]
        assert error.max() < 5e-3, name
    assert made.display_window == FRAME


def test_the_window_holds_all_of_the_photograph_and_nothing_beyond(tmp_path, lens):
    """Barrel distortion grows the picture; every pixel of the photograph is in it."""
    one = np.ones((FRAME.height, FRAME.width))
    plate = photograph(tmp_path / "a.exr", {n: one for n in "RGB"})
    made = straight(tmp_path, plate)
    window, green = made.data_window, made.channels["G"]
    assert window.joined(FRAME) == window
    assert window != FRAME
    read = distorted_px(lens, window)
    far = ~inside(read, margin=-11.0)
    assert far.any()
    assert (green[far] == 0).all()
    np.testing.assert_allclose(green[inside(read, margin=0.0)], 1, atol=1e-5)
    back = run(
        tmp_path,
        "apply",
        tmp_path / "straight" / "a.exr",
        "--out",
        tmp_path / "back",
        "--no-falloff",
        "--no-lateral-colour",
        *BACK,
    )
    assert back.exit_code == 0, back.output
    for plane in read_exr(tmp_path / "back" / "a.exr").parts[0].channels.values():
        np.testing.assert_allclose(plane, 1, atol=1e-4)


EFFECTS = {
    "distortion": ((), ("--no-falloff", "--no-lateral-colour")),
    "lateral colour too": (("--lateral-colour",), ("--no-falloff",)),
    "all": (("--lateral-colour", "--falloff"), ()),
}


@pytest.mark.parametrize("effects", EFFECTS)
def test_apply_is_the_inverse(tmp_path, lens, effects):
    """In position by ramps, in level by a picture as sharp as lenses make them."""
    off, on = EFFECTS[effects]
    sharp = sharp_picture(FRAME)
    flat = np.ones_like(sharp)
    plates = {"ramp": ramps(FRAME), "flat": dict.fromkeys("RGB", flat)}
    plates["sharp"] = dict.fromkeys("RGB", sharp)
    back = {}
    for name, planes in plates.items():
        plate = photograph(tmp_path / f"{name}.exr", planes)
        straight(tmp_path, plate, *off)
        words = ["--out", tmp_path / "back", *on, *BACK]
        done = run(tmp_path, "apply", tmp_path / "straight" / plate.name, *words)
        assert done.exit_code == 0, done.output
        result = read_exr(tmp_path / "back" / plate.name).parts[0]
        assert result.data_window == FRAME
        back[name] = result.channels
    for channel in "RGB":
        # What fall-off's own error does to the level is no error of position.
        position = back["ramp"][channel] / back["flat"][channel]
        error = position - ramps(FRAME)[channel]
        assert np.abs(error[2:-2, 2:-2]).max() < ROUND_TRIP_PX
        error = back["sharp"][channel] - sharp
        assert np.sqrt((error**2).mean()) < ROUND_TRIP_RMS
        assert np.abs(error).max() < 10 * ROUND_TRIP_RMS  # border included


@pytest.mark.slow
def test_apply_is_the_inverse_for_edges_half_a_pixel_sharp(tmp_path):
    save_preset(make_preset(), tmp_path / "preset.json")
    frame = Window.of_size(120, 80)
    edges, long_filter = squares(frame, 0.5), ("--filter", "sinc-16")
    planes = dict.fromkeys("RGB", edges)
    plate = photograph(tmp_path / "edges.exr", planes, frame, frame)
    straight(tmp_path, plate, *long_filter)
    words = ["--out", tmp_path / "back", *EFFECTS["distortion"][1], *BACK, *long_filter]
    done = run(tmp_path, "apply", tmp_path / "straight" / plate.name, *words)
    assert done.exit_code == 0, done.output
    back = read_exr(tmp_path / "back" / plate.name).parts[0].channels["G"]
    error = (back - edges)[10:-10, 10:-10]  # the border mirrors no square
    assert np.sqrt((error**2).mean()) < ROUND_TRIP_RMS
    assert np.abs(error).max() < 10 * ROUND_TRIP_RMS


def squares(window, edge_px):
    """A slanted checker of 32 px, of edges with this standard deviation."""
    x, y = np.moveaxis(window.pixel_centres(), -1, 0)
    cosine, sine = math.cos(0.12), math.sin(0.12)
    sides = []
    for along in (cosine * x + sine * y, cosine * y - sine * x):
        to_edge_px = np.abs((along / 32) % 2 - 1) * 32 - 16
        sides.append(erf(to_edge_px / (math.sqrt(2) * edge_px)))
    return 0.5 + 0.4 * sides[0] * sides[1]


def sharp_picture(window):
    """Amplitude as 1/f, blurred to 1/e at .2 cycles/px as a lens and its sensor would,
    of a standard deviation of .18."""
    rng = np.random.default_rng(3)
    shape = window.height, window.width
    fy, fx = np.meshgrid(
        np.fft.fftfreq(shape[0]), np.fft.rfftfreq(shape[1]), indexing="ij"
    )
    f = np.hypot(fx, fy)
    weight = np.exp(-((f / 0.2) ** 2)) / np.maximum(f, 1 / max(shape))
    weight[0, 0] = 0
    picture = np.fft.irfft2(np.fft.rfft2(rng.standard_normal(shape)) * weight, shape)
    return 0.5 + 0.18 * picture / picture.std()


def test_lateral_colour_and_falloff_are_taken_off(tmp_path, lens):
    geometry = PlateGeometry.of(lens, FRAME, 36.0)
    mm = geometry.mm(FRAME.pixel_centres().reshape(-1, 2))
    gain = np.asarray(lens.relative_illumination(mm, "g"))
    gain = gain.reshape(FRAME.height, FRAME.width)
    assert gain.min() < 0.9
    plate = photograph(tmp_path / "grey.exr", {n: 0.4 * gain for n in "RGB"})
    made = straight(tmp_path, plate, "--falloff")
    seen = inside(distorted_px(lens, made.data_window))
    np.testing.assert_allclose(made.channels["G"][seen], 0.4, rtol=1e-3)
    plate = photograph(tmp_path / "ramp.exr", ramps(FRAME))
    made = straight(tmp_path, plate, "--lateral-colour")
    for name, channel in (("R", "r"), ("B", "b")):
        read = distorted_px(lens, made.data_window, channel)
        error = np.abs(made.channels[name] - read[..., 0])[inside(read)]
        assert error.max() < 5e-3
    green = distorted_px(lens, made.data_window)
    assert np.abs(read - green)[inside(read)].max() > 0.05


def test_the_camera_is_the_pinhole_of_the_straight_picture(tmp_path, lens):
    """Points of a scene land where its focal length and centre in pixels put them."""
    x, y = np.meshgrid([-900.0, -300.0, 400.0, 1000.0], [-500.0, 100.0, 600.0])
    points = np.stack([x.ravel(), y.ravel(), np.full(x.size, 3000.0)], -1)
    geometry = PlateGeometry.of(lens, FRAME, 36.0)
    landed = geometry.px(np.asarray(lens.project(points)))
    centres = FRAME.pixel_centres()
    spots = np.zeros((FRAME.height, FRAME.width))
    for spot in landed:
        spots += np.exp(-((centres - spot) ** 2).sum(-1) / (2 * 1.5**2))
    plate = photograph(tmp_path / "a.1001.exr", {n: spots for n in "RGB"})
    words = ["--out", tmp_path / "out", "--json", "--tolerance", "2e-4"]
    done = run(tmp_path, "undistort", plate, *words)
    told = json.loads(done.stdout)
    cameras = json.loads((tmp_path / "out" / "a.camera.json").read_text())["cameras"]
    assert told["cameras"] == str(tmp_path / "out" / "a.camera.json")
    (camera,) = cameras
    assert (camera["file"], camera["frame"]) == ("a.1001.exr", 1001)
    assert camera["film_back_mm"] == [36.0, 24.0]
    focal, centre = (np.array(camera[k]) for k in ("focal_length_px", "centre_px"))
    # From the entrance pupil, which is where a pinhole would be.
    distance = 3000.0 - float(lens.entrance_pupil_offset_mm)
    wanted = centre + focal * points[:, :2] / distance
    made = read_exr(tmp_path / "out" / "a.1001.exr").parts[0]
    window = made.data_window
    assert camera["data_window"] == list(window)
    pitch = 36.0 / 240
    back = [window.width * pitch, window.height * pitch]
    np.testing.assert_allclose(camera["data_film_back_mm"], back)
    for position in wanted:
        near = np.round(position - np.array(window[:2])).astype(int)
        part = np.s_[near[1] - 8 : near[1] + 9, near[0] - 8 : near[0] + 9]
        light, at = made.channels["G"][part], window.pixel_centres()[part]
        found = (light[..., None] * at).sum((0, 1)) / light.sum()
        np.testing.assert_allclose(found, position, atol=0.02)


def test_a_sequence_is_resumed_and_its_cameras_are_complete(tmp_path, lens):
    for frame, focus in ((1, 2.0), (2, 2.0)):
        header = {**HEADER, "lens/focus": focus}
        photograph(tmp_path / f"a.{frame:04d}.exr", ramps(FRAME), header=header)
    words = ["--out", tmp_path / "out", "--overscan", "10", "--json"]
    first = run(tmp_path, "undistort", tmp_path / "a.####.exr", "--frames", "1", *words)
    assert len(json.loads(first.stdout)["written"]) == 1
    second = json.loads(
        run(tmp_path, "undistort", tmp_path / "a.####.exr", *words).stdout
    )
    assert [len(second[k]) for k in ("written", "skipped", "failures")] == [1, 1, 0]
    cameras = json.loads((tmp_path / "out" / "a.camera.json").read_text())["cameras"]
    assert [camera["frame"] for camera in cameras] == [1, 2]
    windows = {tuple(camera["data_window"]) for camera in cameras}
    assert windows == {tuple(FRAME.grown(12, 8))}


def test_chunks_of_a_farm_leave_the_cameras_of_all_frames(tmp_path, lens):
    for frame in (1, 2, 3, 4):
        photograph(tmp_path / f"a.{frame:04d}.exr", ramps(FRAME))
    for chunk in ("3-4", "1-2"):
        words = ["--out", tmp_path / "out", "--frames", chunk]
        done = run(tmp_path, "undistort", tmp_path / "a.####.exr", *words)
        assert done.exit_code == 0, done.output
    cameras = json.loads((tmp_path / "out" / "a.camera.json").read_text())["cameras"]
    assert [camera["frame"] for camera in cameras] == [1, 2, 3, 4]
    assert {camera["lens"] for camera in cameras} == {"Test 35"}


def test_single_plates_that_share_a_name_keep_their_cameras(tmp_path, lens):
    for name in ("z35.exr", "z38.exr"):
        straight(tmp_path, photograph(tmp_path / name, ramps(FRAME)))
    table = json.loads((tmp_path / "straight" / "z.camera.json").read_text())
    assert [one["file"] for one in table["cameras"]] == ["z35.exr", "z38.exr"]


def test_half_float_and_other_channels_stay_what_they_are(tmp_path, lens):
    planes = {n: p.astype(np.float32) for n, p in ramps(FRAME).items()}
    matte = np.arange(FRAME.width * FRAME.height, dtype=np.uint32)
    channels = {n: p.astype(np.float16) for n, p in planes.items()}
    channels["id"] = matte.reshape(FRAME.height, FRAME.width)
    part = ExrPart(channels, FRAME, FRAME, HEADER)
    write_exr(tmp_path / "a.exr", ExrImage((part,)))
    made = straight(tmp_path, tmp_path / "a.exr")
    assert made.channels["R"].dtype == np.float16
    y, x = -made.data_window.y_min, -made.data_window.x_min
    kept = made.channels["id"][y : y + FRAME.height, x : x + FRAME.width]
    assert (kept == channels["id"]).all()


def test_what_cannot_be_straightened_is_refused_in_one_line(tmp_path, lens):
    plate = photograph(tmp_path / "a.exr", ramps(FRAME))
    straight(tmp_path, plate)
    again = run(
        tmp_path, "undistort", tmp_path / "straight" / "a.exr", "--out", tmp_path / "b"
    )
    assert again.exit_code == 1
    assert "was straightened already" in again.stderr
    unknown = photograph(tmp_path / "b.exr", ramps(FRAME), header=SENSOR)
    words = ["--out", tmp_path / "c", "--falloff", "--keep", "--overwrite"]
    assert run(tmp_path, "undistort", unknown, *words).exit_code == 2
    grey = photograph(tmp_path / "c.exr", {"Z": np.ones((160, 240))})
    lacking = run(tmp_path, "undistort", grey, "--out", tmp_path / "c")
    assert lacking.exit_code == 1
    assert "c.exr" in lacking.stderr
    assert "holds no R, G, B" in lacking.stderr


def test_a_straight_plate_takes_the_lens_again_and_says_so(tmp_path, lens):
    """And the frame that comes back may be straightened again."""
    plate = photograph(tmp_path / "a.exr", ramps(DISPLAY), DISPLAY, DISPLAY)
    straight(tmp_path, plate)
    words = ["--out", tmp_path / "back", *BACK]
    assert (
        run(tmp_path, "apply", tmp_path / "straight" / "a.exr", *words).exit_code == 0
    )
    back = read_exr(tmp_path / "back" / "a.exr", header_only=True).parts[0].attributes
    assert "lensfit/undistorted" not in back
    assert "taken off" in back["lensfit/applied_before"]
    straight(tmp_path, tmp_path / "back" / "a.exr", out="twice")
