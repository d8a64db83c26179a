"""Cameras of USD, samples of OpenTrackIO and sidecars of clips on the command line."""

import json

import camera_files as files
import numpy as np
import pytest
from command_line import run
from plate_makers import SENSOR, make_preset, write_plate

from lensfit.coords import Window
from lensfit.io.camera.read_camera_file import read_camera_file
from lensfit.io.camera.table import FrameKey
from lensfit.io.exr import ExrImage, ExrPart, read_exr, write_exr
from lensfit.preset.store import save_preset

USD = """\
#usda 1.0
(
    metersPerUnit = {metres}
)
def Xform "shot"
{{
    def Camera "main"
    {{
        float focalLength.timeSamples = {{ 1001: {first}, 1011: {last} }}
        float horizontalAperture = {width}
        float fStop = 2.8
        float focusDistance = {focus}
    }}
{more}
}}
"""
SECOND = '    def Camera "witness"\n    {\n        float focalLength = 18\n    }\n'


@pytest.fixture
def plate(tmp_path):
    plane, window = np.zeros((30, 40), np.float32), Window.of_size(40, 30)
    for frame in (1001, 1006):
        part = ExrPart({"Y": plane}, window, window, {})
        write_exr(tmp_path / f"p.{frame}.exr", ExrImage((part,)))
    return tmp_path / "p.1006.exr"


def camera(plate, *words):
    done = run("inspect", "--json", plate, *words)
    assert done.exit_code == 0, done.output
    return json.loads(done.stdout)[0]["state"]


@pytest.mark.parametrize(("metres", "tenth"), [(0.01, 1.0), (1.0, 0.01)])
def test_a_usd_camera_counts_in_its_scene(tmp_path, plate, metres, tenth):
    """Tenths of a unit, whatever that is; and lengths of the scene."""
    pytest.importorskip("pxr", reason="usd-core is not installed")
    text = USD.format(
        metres=metres, first=50 * tenth, last=60 * tenth, width=24 * tenth,
        focus=2 / metres, more="",
    )  # fmt: skip
    path = tmp_path / "shot.usda"
    path.write_text(text)
    found = camera(plate, "--camera", path)
    assert found["focal_length_mm"] == pytest.approx(55.0)
    assert found["sensor_width_mm"] == pytest.approx(24.0)
    assert found["f_number"] == pytest.approx(2.8)
    # From the pinhole, which only a preset has a place for.
    readings, _ = read_camera_file(path).at(FrameKey(1006), None)
    assert readings["focus_from_pupil_mm"].value == pytest.approx(2000.0)


def test_one_of_several_usd_cameras_is_named(tmp_path, plate):
    pytest.importorskip("pxr", reason="usd-core is not installed")
    path = tmp_path / "shot.usda"
    path.write_text(
        USD.format(metres=0.01, first=50, last=60, width=24, focus=200, more=SECOND)
    )
    done = run("inspect", plate, "--camera", path)
    assert done.exit_code == 1
    assert "--camera-name" in done.stderr
    assert "/shot/witness" in done.stderr
    found = camera(plate, "--camera", path, "--camera-name", "witness")
    assert found["focal_length_mm"] == 18.0


@pytest.mark.parametrize("text", ["#usda 1.0\nnonsense {", "#usda 1.0\n"])
def test_a_usd_file_without_a_camera_is_one_line(tmp_path, plate, text):
    pytest.importorskip("pxr", reason="usd-core is not installed")
    (tmp_path / "bad.usda").write_text(text)
    done = run("inspect", plate, "--camera", tmp_path / "bad.usda")
    assert done.exit_code == 1
    assert done.stderr.count("\n") == 1
    assert "bad.usda" in done.stderr


def sample(frame: int, **lens: float) -> dict:
    timecode = {"hours": 1, "minutes": 2, "seconds": 3, "frames": frame}
    return {"timing": {"timecode": timecode}, "lens": lens}


def stream() -> list[dict]:
    first = sample(4, pinholeFocalLength=35.0, focusDistance=1.5, fStop=4.0)
    size = {"width": 28.0, "height": 15.75}
    first["static"] = {
        "camera": {"activeSensorPhysicalDimensions": size},
        "lens": {"model": "Zoom"},
    }
    return [first, sample(5, pinholeFocalLength=36.0, focusDistance=2.5, tStop=4.3)]


@pytest.mark.parametrize("lines", [False, True], ids=["list", "lines"])
def test_samples_of_opentrackio_are_rows(tmp_path, plate, lines):
    path = tmp_path / "track.json"
    text = "\n".join(map(json.dumps, stream())) if lines else json.dumps(stream())
    path.write_text(text)
    found = camera(plate, "--metadata", path, "--metadata-start", 1005)
    assert found["focal_length_mm"] == 36.0
    assert found["focus_distance_mm"] == 2500.0
    assert found["sensor_width_mm"] == 28.0
    assert found["lens_model"] == "Zoom"
    assert found["f_number"] == pytest.approx(4.3)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ('{"a": 1}', "without a lens"),
        ('[{"lens": {"fStop": "wide"}}]', "fStop"),
        ('[{"lens": {"pinholeFocalLength": -5}}]', "pinholeFocalLength"),
        ("[1, 2]", "no object"),
        ('{"lens": ', "JSON"),
    ],
)
def test_a_bad_stream_is_one_line(tmp_path, plate, text, said):
    (tmp_path / "bad.json").write_text(text)
    done = run("inspect", plate, "--metadata", tmp_path / "bad.json")
    assert done.exit_code == 1
    assert done.stderr.count("\n") == 1
    assert said in done.stderr


def test_apply_takes_a_clip_of_an_ale(tmp_path):
    save_preset(make_preset(), tmp_path / "preset.json")
    clips = [clip.replace("50", "35") for clip in files.ALE_CLIPS]
    sidecar = files.ale(tmp_path, *clips)
    plate = write_plate(tmp_path / "A001C002.1001.exr", SENSOR)
    words = ("apply", tmp_path / "preset.json", plate, "--out", tmp_path / "out")
    done = run(*words, "--no-defocus", "--metadata", sidecar)
    assert done.exit_code == 0, done.stderr
    (part,) = read_exr(tmp_path / "out" / plate.name).parts
    assert "1498.6 mm focus" in str(part.attributes["lensfit/applied"])
    assert "T-stop" in done.stderr


def test_inspect_shows_what_each_tells(tmp_path):
    plate = write_plate(tmp_path / "p.1001.exr", SENSOR)
    f4, xml = files.mosys(tmp_path, 2.5), files.sony_xml(tmp_path)
    done = run("inspect", plate, "--metadata", f4, "--metadata", xml, "--json")
    assert done.exit_code == 0, done.stderr
    state = json.loads(done.stdout)[0]["state"]
    assert state["focus_distance_mm"] == pytest.approx(2500, rel=1e-6)
    assert state["lens_model"] == "S7i-32"


@pytest.mark.parametrize("make", [files.ale, files.mosys, files.sony_xml])
def test_what_is_cut_short_is_one_line(tmp_path, make):
    path = make(tmp_path)
    path.write_bytes(path.read_bytes()[:20])
    plate = write_plate(tmp_path / "p.exr", SENSOR)
    done = run("inspect", plate, "--metadata", path)
    assert done.exit_code == 1
    assert done.stderr.count("\n") == 1
    assert str(path) in done.stderr
