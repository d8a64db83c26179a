"""`lensfit stmap --plates`: maps that move with the camera, and coarse maps."""

import json
import re

import numpy as np
import pytest
from plate_makers import SENSOR, make_preset
from typer.testing import CliRunner

from lensfit.cli.main import app
from lensfit.coords import Window, px_from_uv
from lensfit.exchange.nuke_script import read_nuke_nodes
from lensfit.io.exr import ExrImage, ExrPart, write_exr
from lensfit.io.stmap import read_stmap
from lensfit.preset.store import save_preset
from lensfit.rendering.uv import PlateGeometry

FRAME = Window.of_size(192, 128)
FOCAL = {1001: 24.0, 1002: 35.0, 1003: 35.0, 1004: 50.0}


@pytest.fixture
def shot(tmp_path):
    """A zoom whose distortion depends on the focal length, zoomed through a shot."""
    save_preset(make_preset(24.0, 35.0, 50.0), tmp_path / "zoom.json")
    grey = np.zeros((FRAME.height, FRAME.width), np.float16)
    for number, focal in FOCAL.items():
        header = {**SENSOR, "lens/focal": focal, "lens/focus": 2.0}
        part = ExrPart(dict.fromkeys("RGB", grey), FRAME, FRAME, header)
        write_exr(tmp_path / f"plate.{number}.exr", ExrImage((part,)))
    return tmp_path


def run(folder, *options):
    words = ["stmap", folder / "zoom.json", *options]
    return CliRunner().invoke(app, [str(word) for word in words])


def written(shot, *options):
    words = ["--plates", shot / "plate.####.exr", "--out", shot / "maps", "--json"]
    done = run(shot, *words, *options)
    assert done.exit_code == 0, done.output
    return json.loads(done.stdout)


def exact_px(focal, channel="g", direction="redistort", size=(192, 128)):
    lens = make_preset(24.0, 35.0, 50.0).at(focal, None, 2000.0)
    frame = Window.of_size(*size)
    geometry = PlateGeometry.of(lens, frame, 36.0)
    mapping = {"redistort": geometry.undistorted, "undistort": geometry.distorted}
    points = frame.pixel_centres().reshape(-1, 2)
    found = mapping[direction](lens, channel)(points)
    return np.asarray(found).reshape(size[1], size[0], 2)


def test_each_frame_has_the_map_of_its_own_camera(shot):
    told = written(shot)
    assert told["different"] == 3
    assert told["per_channel"]
    assert len(told["files"]) == 2 * len(FOCAL)
    for number, focal in FOCAL.items():
        for direction in ("redistort", "undistort"):
            file = shot / "maps" / f"test-35_plate_{direction}.{number}.exr"
            assert str(file) in told["files"]
            found = read_stmap(file)
            for channel, uv in found.channel_uv.items():
                error = px_from_uv(uv, FRAME) - exact_px(focal, channel, direction)
                assert np.abs(error).max() < 1e-3
    one, same, other = (
        (shot / "maps" / f"test-35_plate_redistort.{n}.exr").read_bytes()
        for n in (1002, 1003, 1004)
    )
    assert one == same
    assert one != other


def test_sidecars_and_ranges_count_as_in_apply(shot):
    (shot / "lensfit.toml").write_text(
        "[[frames]]\nrange = '1001-1003'\nfocal_length_mm = 50\n"
    )
    told = written(shot, "--frames", "1001-1002", "--no-per-channel")
    assert (told["different"], told["per_channel"]) == (1, False)
    found = read_stmap(shot / "maps" / "test-35_plate_redistort.1001.exr")
    assert np.abs(px_from_uv(found.uv, FRAME) - exact_px(50.0)).max() < 1e-3


def test_the_script_reads_the_sequence_each_channel_by_its_own_layer(shot):
    told = written(shot, "--map-width", "96")
    nodes = read_nuke_nodes(told["script"])
    reads = [n for n in nodes if n.kind == "Read"]
    assert len(reads) == 2
    for node in reads:
        pattern = node.knobs["file"].strip('"')
        assert (node.knobs["first"], node.knobs["last"]) == ("1001", "1004")
        files = {pattern % number for number in FOCAL}
        assert files <= set(told["files"])
        assert node.knobs["format"].strip('"').split()[:2] == ["96", "64"]
    sizes = [n.knobs["format"] for n in nodes if n.kind == "Reformat"]
    assert [s.strip('"').split()[:2] for s in sizes] == [["192", "128"]] * 2
    moved = {(n.knobs["uv"], n.knobs["channels"]) for n in nodes if n.kind == "STMap"}
    assert moved == {
        ("stmap_r", "{rgba.red}"),
        ("stmap_g", "{rgba.green rgba.alpha}"),
        ("stmap_b", "{rgba.blue}"),
    }
    text = (shot / "maps" / "test-35_plate.nk").read_text()
    assert stack_of(text) == stack_wanted()


def reads_of(script):
    return [n.knobs for n in read_nuke_nodes(script) if n.kind == "Read"]


def test_chunks_of_a_farm_make_one_sequence_and_one_script(shot):
    """In whatever order; while a chunk is missing, the nearest map stands for it."""
    first = written(shot, "--frames", "1001,1004")
    for read in reads_of(first["script"]):
        assert (read["first"], read["last"]) == ("1001", "1004")
        assert read["on_error"] == '"nearest frame"'
    words = ["--plates", shot / "plate.####.exr", "--out", shot / "maps"]
    done = run(shot, *words, "--frames", "1003")
    assert "no maps of frames 1002 between 1001 and 1004" in said(done)
    last = written(shot, "--frames", "1002")
    assert last["script"] == first["script"]
    for read in reads_of(last["script"]):
        assert (read["first"], read["last"]) == ("1001", "1004")
        assert "on_error" not in read
        pattern = read["file"].strip('"')
        assert all((shot / (pattern % number)).is_file() for number in FOCAL)


def test_maps_that_no_script_reads_together_are_refused(shot):
    written(shot, "--frames", "1001", "--per-channel")
    words = ["--plates", shot / "plate.####.exr", "--out", shot / "maps"]
    for options, what in (
        (["--no-per-channel"], "a map for each colour"),
        (["--per-channel", "--map-width", "96"], "another size"),
    ):
        done = run(shot, *words, "--frames", "1002", *options)
        assert done.exit_code == 1
        assert what in said(done)
    written(shot, "--no-per-channel")  # all of them are replaced


def said(done):
    return re.sub(r"\s+", " ", done.stderr)


def stack_of(text):
    """What each STMap gets, by running the script's stack as Nuke does."""
    stack, named, found = [], {}, []
    body = re.sub(r"^#.*$", "", text, flags=re.MULTILINE)
    for match in re.finditer(
        r"^(\w+) \{\n(.*?)^\}|^set (\w+) \[stack 0\]|^push \$(\w+)", body, re.S | re.M
    ):
        kind, knobs, stored, pushed = match.groups()
        if stored:
            named[stored] = stack[-1]
        elif pushed:
            stack.append(named[pushed])
        else:
            told = dict(
                line.split(" ", 1) for line in re.findall(r"^ (.*)$", knobs, re.M)
            )
            inputs = [stack.pop() for _ in range(int(told.get("inputs", "1")))]
            if kind == "STMap":
                found.append((told["name"], *inputs))
            stack.append(told["name"])
    return found


def stack_wanted():
    """Input 0 is the picture, input 1 the enlarged map."""
    wanted = []
    for way in ("undistort", "redistort"):
        picture = f"plate_to_{way}"
        for channel in "rgb":
            wanted.append((f"STMap_{way}_{channel}", picture, f"enlarge_{way}"))
            picture = f"STMap_{way}_{channel}"
    return wanted


def test_a_coarse_map_spans_the_same_frame(shot):
    """Every fourth pixel, with pixels of its own about the frame; the height rounds."""
    words = ["--size", "202x101", "--focal-length-mm", "35", "--out", shot / "c"]
    done = run(shot, *words, "--map-width", "50", "--direction", "redistort")
    assert done.exit_code == 0, done.output
    (file,) = (shot / "c").iterdir()
    found = read_stmap(file)
    assert found.display_window == Window.of_size(50, 25)
    assert found.data_window == Window(-2, -2, 51, 26)
    lens = make_preset(24.0, 35.0, 50.0).at(35.0, None, 2000.0)
    geometry = PlateGeometry.of(lens, Window.of_size(202, 101), 36.0)
    coarse = found.data_window.pixel_centres() * np.array([202 / 50, 101 / 25])
    wanted = geometry.undistorted(lens, "g")(coarse.reshape(-1, 2))
    uv = found.uv.astype(float)
    read = np.stack([uv[..., 0] * 202, (1 - uv[..., 1]) * 101], -1)
    assert np.abs(read.reshape(-1, 2) - np.asarray(wanted)).max() < 2e-3


def test_the_error_of_coarse_maps_is_that_of_enlarging(shot):
    """Of linear enlarging a quarter with each doubling, of an ideal lens none."""
    words = ["--size", "4000x2667", "--focal-length-mm", "24", "--widths", "--json"]
    done = run(shot, *words, "--tolerance-px", "1e-6")
    rows = json.loads(done.stdout)
    assert [row["width_px"] for row in rows] == [512, 1024, 2048, 4000]
    linear = [row["linear_worst_px"] for row in rows]
    assert 3 < linear[0] / linear[1] < 5
    assert rows[0]["cubic_worst_px"] < linear[0]
    assert linear[-1] < 4000 * 2.0**-24 + 1e-4
    # By Taylor: an eighth of the second derivative times the pitch of samples squared.
    x = exact_px(24.0, size=(4000, 3))[1, :, 0]
    curved = np.abs(np.diff(x, 2)).max() * (4000 / 512) ** 2 / 8
    assert linear[0] > 0.5 * curved


def test_what_needs_plates_or_a_folder_says_so(shot):
    for words, said in (
        (["--frames", "1-2", "--out", shot / "m"], "needs --plates"),
        (["--metadata", shot / "a.csv", "--out", shot / "m"], "needs --plates"),
        ([], "is needed for maps"),
        (["--plates", "p.####.exr", "--size", "9x9", "--out", "m"], "goes without"),
    ):
        done = run(shot, *words)
        assert done.exit_code == 2
        assert said in re.sub(r"[\s│]+", " ", done.stderr)
    done = run(shot, "--plates", shot / "none.####.exr", "--out", shot / "m")
    assert done.exit_code == 1
    assert "no frame exists" in done.stderr
    assert not (shot / "m").exists()
