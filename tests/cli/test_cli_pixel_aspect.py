"""Pixels that are not square, and anamorphic plates in both forms: maps and overscan.

The lens knows millimetres of the sensor. Whatever pixels a plate has, each must read
where the lens says that the middle of its patch of sensor reads.
"""

import json
from pathlib import Path

import msgspec
import numpy as np
import pytest
from command_line import run
from plate_makers import CAMERA, SENSOR, make_preset

from lensfit.coords import Window
from lensfit.io.exr import ExrImage, ExrPart, read_exr, write_exr
from lensfit.io.stmap import read_stmap
from lensfit.preset.schema import Preset
from lensfit.preset.store import save_preset

SENSOR_MM = np.array([36.0, 24.0])
ALL = {**CAMERA, **SENSOR}


def squeezed_preset(squeeze: float) -> Preset:
    """A lens that makes the picture narrower along x, as anamorphic ones do."""
    (entry,) = make_preset().entries
    distortion = msgspec.structs.replace(entry.distortion, squeeze=squeeze)
    entry = msgspec.structs.replace(entry, distortion=distortion, lateral_colour=None)
    return msgspec.structs.replace(make_preset(), entries=(entry,))


def expected_uv(preset: Preset, size: tuple[int, int]) -> np.ndarray:
    """By the lens, of pixels that share out the whole sensor."""
    window = Window.of_size(*size)
    share = window.pixel_centres() / np.array(size)
    lens = preset.at(35.0, 2.8, 2000.0)
    landed = ((share - 0.5) * SENSOR_MM).reshape(-1, 2)
    mm = np.asarray(lens.undistorted_from_distorted(landed, "g"))
    found = mm.reshape(share.shape) / SENSOR_MM + 0.5
    return np.stack([found[..., 0], 1 - found[..., 1]], -1)


CASES = {
    "square": (1.0, (96, 64), ()),
    "spherical, twice as wide": (1.0, (48, 64), ("--pixel-aspect", 2)),
    "spherical, half as wide": (1.0, (192, 64), ("--pixel-aspect", 0.5)),
    "squeezed, told": (2.0, (96, 64), ("--pixel-aspect", 2)),
    "squeezed, by its height": (2.0, (96, 64), ()),
    "desqueezed, told": (2.0, (192, 64), ("--pixel-aspect", 1)),
    "desqueezed, by its height": (2.0, (192, 64), ()),
    "desqueezed, engraved 1.8": (1.79, (180, 67), ("--pixel-aspect", 1)),
}


@pytest.mark.parametrize("case", CASES)
def test_maps_read_where_the_lens_says(tmp_path, case):
    squeeze, size, options = CASES[case]
    preset = squeezed_preset(squeeze)
    save_preset(preset, tmp_path / "preset.json")
    shown = "x".join(map(str, size))
    words = ["stmap", tmp_path / "preset.json", "--size", shown, *options]
    done = run(*words, "--out", tmp_path / "maps", "--direction", "redistort")
    assert done.exit_code == 0, done.stderr
    (path,) = (tmp_path / "maps").glob("*.exr")
    gap_px = (read_stmap(path).uv - expected_uv(preset, size)) * np.array(size)
    most = 1e-3 if case != "desqueezed, engraved 1.8" else 0.05  # 180 x 67: rounded
    assert np.abs(gap_px).max() < most
    noted = "is taken as" in done.stderr
    assert noted == (squeeze > 1 and not options)


def waves(size: tuple[int, int]) -> np.ndarray:
    """The same scene for every size."""
    share = Window.of_size(*size).pixel_centres() / np.array(size)
    x, y = np.moveaxis(share, -1, 0)
    return (1 + 0.5 * np.sin(9 * x) * np.cos(7 * y)).astype(np.float32)


def write(path: Path, size: tuple[int, int], aspect: float, **extra) -> Path:
    window = Window.of_size(*size)
    channels = {n: waves(size) for n in "RGB"} | extra
    part = ExrPart(channels, window, window, dict(ALL), pixel_aspect=aspect)
    write_exr(path, ExrImage((part,)))
    return path


@pytest.mark.slow
@pytest.mark.parametrize(
    ("squeeze", "size", "aspect"),
    [(1.0, (192, 256), 2.0), (2.0, (768, 256), 1.0), (2.0, (384, 256), 2.0)],
)
def test_a_plate_shows_the_same_scene_whatever_its_pixels(
    tmp_path, squeeze, size, aspect
):
    preset = squeezed_preset(squeeze)
    save_preset(preset, tmp_path / "preset.json")
    plate = write(tmp_path / "p.exr", size, aspect)
    words = ["apply", tmp_path / "preset.json", plate, "--no-defocus", "--no-falloff"]
    assert run(*words, "--out", tmp_path / "out").exit_code == 0
    part = read_exr(tmp_path / "out" / "p.exr").parts[0]
    assert part.pixel_aspect == aspect
    u, v = np.moveaxis(expected_uv(preset, size), -1, 0)
    wanted = 1 + 0.5 * np.sin(9 * u) * np.cos(7 * (1 - v))
    inside = (np.abs(u - 0.5) < 0.48) & (np.abs(v - 0.5) < 0.48)
    assert np.abs(part.channels["G"] - wanted)[inside].max() < 1e-3


def test_overscan_counts_pixels_of_their_own_shape(tmp_path):
    save_preset(make_preset(), tmp_path / "preset.json")

    def asked(*options):
        done = run("overscan", tmp_path / "preset.json", "--json", *options)
        assert done.exit_code == 0, done.stderr
        return json.loads(done.stdout)

    square = asked("--size", "3840x2560")
    wide = asked("--size", "1920x2560", "--pixel-aspect", 2)
    for side, part in (("left", 2), ("right", 2), ("top", 1), ("bottom", 1)):
        gap = square["margins_px"][side] / part - wide["margins_px"][side]
        assert abs(gap) <= 3  # the filter's reach is in pixels
    assert wide["sensor_mm"] == pytest.approx(square["sensor_mm"], rel=2e-3)
    assert wide["open_lens_io_factor"] == pytest.approx(square["open_lens_io_factor"])
    plate = write(tmp_path / "p.exr", (48, 64), 2.0)
    assert asked("--plate", plate) | {"plate": None} == asked(
        "--size", "48x64", "--pixel-aspect", 2, "--focal-length-mm", 35
    ) | {"plate": None, "depth_of_field": asked("--plate", plate)["depth_of_field"]}


def test_what_is_neither_squeezed_nor_desqueezed_is_refused(tmp_path):
    save_preset(squeezed_preset(2.0), tmp_path / "preset.json")
    plate = write(tmp_path / "p.exr", (96, 64), 1.5)
    words = ["apply", tmp_path / "preset.json", plate, "--no-defocus"]
    done = run(*words, "--out", tmp_path / "out")
    assert done.exit_code == 1
    assert "a squeezed plate has 2, a desqueezed one 1" in done.stderr
    assert run(*words, "--out", tmp_path / "out", "--pixel-aspect", 2).exit_code == 0


def through_the_lens(folder: Path, scene: np.ndarray, shape: int) -> np.ndarray:
    """Green of a scene out of focus, in pixels so many times as wide as high."""
    seen = scene.reshape(len(scene), -1, shape).mean(-1).astype(np.float32)
    window = Window.of_size(seen.shape[1], len(seen))
    channels = dict.fromkeys("RGB", seen) | {"Z": np.full_like(seen, 0.5)}
    part = ExrPart(channels, window, window, dict(ALL), pixel_aspect=float(shape))
    plate = folder / f"p{shape}.exr"
    write_exr(plate, ExrImage((part,)))
    words = ["apply", folder / "preset.json", plate, "--no-distortion", "--no-falloff"]
    words += ["--no-lateral-colour", "--tolerance", 1e-3, "--out", folder / "out"]
    done = run(*words)
    assert done.exit_code == 0, done.stderr
    return read_exr(folder / "out" / plate.name).parts[0].channels["G"]


@pytest.mark.slow
def test_depth_of_field_is_the_same_whatever_the_pixels(tmp_path):
    save_preset(make_preset(), tmp_path / "preset.json")
    rng = np.random.default_rng(4)
    scene = 0.2 + 0.3 * rng.random((32, 48)).repeat(8, 0).repeat(8, 1)
    scene[40:200, 60:250] += 0.4
    square, wide = (through_the_lens(tmp_path, scene, shape) for shape in (1, 2))
    halved = square.reshape(256, 192, 2).mean(-1)
    away = (wide - halved)[24:-24, 24:-24]
    assert np.sqrt(np.mean(away**2)) < 2e-3  # each is within the tolerance of 1e-3


def test_a_light_is_round_on_the_sensor_whatever_the_pixels(tmp_path):
    save_preset(make_preset(), tmp_path / "preset.json")
    scene = np.zeros((256, 384))
    scene[126:132, 198:204] = 100.0
    disc = through_the_lens(tmp_path, scene, 2).astype(float)
    y, x = np.mgrid[:256, :192] + 0.5
    spread = [
        np.sqrt(np.average((at - np.average(at, weights=disc)) ** 2, weights=disc))
        for at in (2 * x, y)
    ]
    assert spread[0] == pytest.approx(spread[1], rel=0.05)


def aspects(folder: Path) -> list[float]:
    paths = sorted(folder.glob("*.exr"))
    return [read_exr(p, header_only=True).parts[0].pixel_aspect for p in paths]


def test_maps_have_the_pixel_aspect_of_their_plates(tmp_path):
    """As what reads them through a map is shown; a coarser map spans the same frame."""
    save_preset(squeezed_preset(2.0), tmp_path / "preset.json")
    plate = write(tmp_path / "p.1001.exr", (96, 64), 2.0)
    words = ("stmap", tmp_path / "preset.json", "--plates", plate, "--out")
    for name, options, wanted in (
        ("own", (), 2.0),
        ("stated", ("--pixel-aspect", 1.9), 1.9),
        ("each", ("--per-channel",), 2.0),
        ("coarse", ("--map-width", 48), 2.0),
    ):
        done = run(*words, tmp_path / name, *options)
        assert done.exit_code == 0, done.stderr
        assert aspects(tmp_path / name) == pytest.approx([wanted] * 2)
    size = ("--size", "96x64", "--pixel-aspect", 2, "--out", tmp_path / "size")
    assert run("stmap", tmp_path / "preset.json", *size).exit_code == 0
    assert aspects(tmp_path / "size") == pytest.approx([2.0, 2.0])
