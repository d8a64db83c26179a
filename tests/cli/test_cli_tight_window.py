"""Elements whose data window is smaller than the frame: kept small, never padded."""

import json
from pathlib import Path

import msgspec
import numpy as np
import pytest
from command_line import run
from deep_files import write_deep
from plate_makers import CAMERA, DISPLAY, SENSOR, make_preset, scene

from lensfit.coords import Window
from lensfit.io.exr import ExrImage, ExrPart, read_exr, write_exr
from lensfit.plate.frame.tight_window import is_tight, known_window
from lensfit.preset.store import save_preset
from lensfit.rendering.circle import Circle
from lensfit.rendering.uv import PlateGeometry

ALL = {**CAMERA, **SENSOR}
ELEMENT = Window(20, 15, 49, 40)
SHARP = ("--no-defocus",)
DEEP = ("--depth-unit", "m", "--depth-kind", "perpendicular")


@pytest.fixture
def preset(tmp_path: Path) -> Path:
    """Distortion and lateral colour, and no fall-off, which would hide lost light."""
    (entry,) = make_preset().entries
    bare = msgspec.structs.replace(entry, fall_off=())
    save_preset(
        msgspec.structs.replace(make_preset(), entries=(bare,)), tmp_path / "p.json"
    )
    return tmp_path / "p.json"


def write(path: Path, window: Window, depth_m: float | None = None, **extra) -> Path:
    """A solid element, or the same within a plate as large as `window`."""
    inside = np.zeros((window.height, window.width), np.float32)
    top, left = ELEMENT.y_min - window.y_min, ELEMENT.x_min - window.x_min
    inside[top : top + ELEMENT.height, left : left + ELEMENT.width] = 1
    channels = {n: scene(window)[..., i] * inside for i, n in enumerate("RGB")}
    channels["A"] = inside
    if depth_m is not None:
        channels["Z"] = np.full_like(inside, depth_m)
    part = ExrPart(channels | extra, window, DISPLAY, dict(ALL))
    write_exr(path, ExrImage((part,)))
    return path


def applied(preset: Path, plate: Path, out: Path, *options: object):
    words = ["apply", preset, plate, "--out", out, "--json", *options]
    done = run(*words)
    assert done.exit_code == 0, done.stderr
    said = json.loads(done.stdout)
    return read_exr(said["written"][0]).parts[0], said["notes"]


def over_frame(part: ExrPart, name: str) -> np.ndarray:
    whole = np.zeros((DISPLAY.height, DISPLAY.width), np.float32)
    own = part.data_window
    rows = slice(own.y_min, own.y_max + 1)
    whole[rows, own.x_min : own.x_max + 1] = part.channels[name]
    return whole


@pytest.mark.parametrize("depth_m", [None, 2.0, 0.4, 9.0])
def test_it_is_what_a_padded_plate_gives_in_a_window_of_its_own(
    preset, tmp_path, depth_m
):
    options = SHARP if depth_m is None else (*DEEP, "--f-number", 1.4)
    tight = write(tmp_path / "tight.exr", ELEMENT, depth_m)
    padded = write(tmp_path / "padded.exr", DISPLAY, depth_m)
    small, notes = applied(preset, tight, tmp_path / "out", *options)
    large, _ = applied(preset, padded, tmp_path / "out", *options)
    assert large.data_window == DISPLAY
    assert not [note for note in notes if "overscan" in note]
    for name in "RGBA":
        gap = np.abs(over_frame(small, name) - large.channels[name])
        assert gap.max() < 1e-4
    # No larger than where its light is, and no further than the blur reaches.
    lens = make_preset().at(35.0, 1.4, 2000.0)
    geometry = PlateGeometry.of(lens, DISPLAY)
    blur_px = 0.0
    if depth_m is not None:
        depth_mm = np.full(1, 1000 * depth_m, np.float32)
        blur_px = float(abs(Circle.of(lens, geometry).radius_px(depth_mm)[0]))
    reach = 4 + blur_px  # the filter's taps, distortion and a pixel's own half
    own = small.data_window
    assert own.width <= ELEMENT.width + 2 * reach
    assert own.height <= ELEMENT.height + 2 * reach
    if blur_px > 3:
        assert own.width > ELEMENT.width + blur_px
    assert own.joined(ELEMENT.grown(-3, -3)) == own


def test_a_side_at_the_border_still_needs_overscan(preset, tmp_path):
    """An element cut off at the frame goes on beyond it, where the lens looks."""
    half = Window(-30, -20, 50, 83)
    cut = Window(0, 0, 50, 63)
    for window, told in ((half, False), (cut, True)):
        rgb = {n: scene(window)[..., i].copy() for i, n in enumerate("RGB")}
        plate = tmp_path / "half.exr"
        write_exr(plate, ExrImage((ExrPart(rgb, window, DISPLAY, dict(ALL)),)))
        part, notes = applied(preset, plate, tmp_path / f"{told}", *SHARP)
        assert any("overscan" in note for note in notes) == told
        assert part.data_window.x_min == (2 if told else 0)  # black is no light
        assert part.data_window.x_max < 60


def test_ids_and_depth_keep_all_their_pixels(preset, tmp_path):
    """Distortion moves the colours; ids stay on the undistorted plate."""
    ids = np.arange(ELEMENT.area, dtype=np.uint32).reshape(ELEMENT.height, -1)
    plate = write(tmp_path / "p.exr", ELEMENT, id=ids)
    part, _ = applied(preset, plate, tmp_path / "out", *SHARP)
    own = part.data_window
    top, left = ELEMENT.y_min - own.y_min, ELEMENT.x_min - own.x_min
    kept = part.channels["id"][top : top + ELEMENT.height, left : left + ELEMENT.width]
    assert kept.tobytes() == ids.tobytes()


def test_looks_that_spread_light_end_where_it_does(preset, tmp_path):
    plate = write(tmp_path / "p.exr", ELEMENT)
    plain, _ = applied(preset, plate, tmp_path / "a", *SHARP)
    look = ("--bloom-gain", 0.5, "--bloom-threshold", 0.5)
    bloomed, _ = applied(preset, plate, tmp_path / "b", *SHARP, *look)
    assert bloomed.data_window.area > plain.data_window.area


def test_kept_overscan_holds_light_that_leaves_the_frame(preset, tmp_path):
    """Nothing is lost inside the frame, and the window is not that of the plate."""
    plate = write(tmp_path / "p.exr", ELEMENT, 0.4)
    options = (*DEEP, "--f-number", 1.4)
    part, _ = applied(preset, plate, tmp_path / "a", *options)
    kept, _ = applied(preset, plate, tmp_path / "b", *options, "--keep-overscan")
    assert kept.data_window == part.data_window
    assert kept.channels["G"].tobytes() == part.channels["G"].tobytes()


def test_an_element_beside_the_frame_is_one_black_pixel(preset, tmp_path):
    window = Window(300, 300, 309, 309)
    grey = np.ones((10, 10), np.float32)
    part = ExrPart({"Y": grey}, window, DISPLAY, dict(ALL))
    write_exr(tmp_path / "p.exr", ExrImage((part,)))
    part, _ = applied(preset, tmp_path / "p.exr", tmp_path / "out", *SHARP)
    assert part.data_window.area == 1
    assert not part.channels["Y"].any()


def test_a_deep_element_stays_small_too(preset, tmp_path):
    shape = ELEMENT.height, ELEMENT.width
    samples = {n: np.full(shape, 0.5, np.float32).ravel() for n in "RGB"}
    samples |= {"A": np.ones(ELEMENT.area, np.float32)}
    samples |= {"Z": np.full(ELEMENT.area, 2.0, np.float32)}
    plate = write_deep(
        tmp_path / "deep.exr",
        np.ones(shape, int),
        samples,
        dict(ALL),
        windows=(ELEMENT, DISPLAY),
    )
    part, notes = applied(preset, plate, tmp_path / "out", *DEEP)
    assert part.data_window.width <= ELEMENT.width + 8
    assert not [note for note in notes if "overscan" in note]


def test_sides_inside_the_frame_are_known_without_end():
    assert not is_tight(DISPLAY, DISPLAY)
    assert not is_tight(DISPLAY.grown(4, 4), DISPLAY)
    assert is_tight(DISPLAY.grown(4, -1), DISPLAY)
    known = known_window(Window(0, -5, 60, 30), DISPLAY)
    assert (known.x_min, known.y_min) == (0, -5)
    assert min(known.x_max, known.y_max) > 1 << 20
