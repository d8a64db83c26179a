"""A zoom's focal length is that of its ring, whoever wrote the camera.

The pinhole with the picture's angle of view has another one. Files that lensfit writes
state both; where a file states the pinhole's alone, the preset knows the ring.
"""

import json
from pathlib import Path

import msgspec
import numpy as np
import pytest
from command_line import run_well
from plate_makers import DISPLAY, SENSOR, make_preset, write_plate

from lensfit.io.exr import read_exr
from lensfit.preset.schema import Preset
from lensfit.preset.select_entry import ring_focal_length_mm
from lensfit.preset.store import save_preset

RING_MM, RATIOS = 38.0, {30.0: 0.97, 50.0: 1.02}
PINHOLE_MM = RING_MM * 0.99
STATED = {"lens/fstop": 2.8, "lens/focus": 2.0, **SENSOR}


def zoom() -> Preset:
    """Two focal lengths whose pinholes are 3 % shorter and 2 % longer."""
    preset = make_preset(*RATIOS)
    entries = []
    for entry in preset.entries:
        pinhole_mm = entry.focal_length_mm * RATIOS[entry.focal_length_mm]
        projection = msgspec.structs.replace(
            entry.projection, principal_distance_mm=pinhole_mm
        )
        entries.append(msgspec.structs.replace(entry, projection=projection))
    return msgspec.structs.replace(preset, entries=tuple(entries))


@pytest.fixture
def preset(tmp_path: Path) -> Path:
    save_preset(zoom(), tmp_path / "zoom.json")
    return tmp_path / "zoom.json"


def inspected(*words: object) -> dict:
    return json.loads(run_well("inspect", *words, "--json").stdout)[0]


def applied(preset: Path, plate: Path, out: Path, *words: object):
    """The note on it, and what was written."""
    done = run_well("apply", preset, plate, "--out", out, "--no-defocus", *words)
    return done.stderr, read_exr(out / plate.name).parts[0]


def test_apply_undoes_undistort_on_a_zoom(preset, tmp_path):
    plate = write_plate(tmp_path / "p.exr", {"lens/focal": RING_MM, **STATED})
    own = ("--no-falloff", "--no-lateral-colour")
    run_well("undistort", preset, plate, "--out", tmp_path / "straight")
    straight = tmp_path / "straight" / "p.exr"
    header = read_exr(straight, header_only=True).parts[0].attributes
    assert header["nominalFocalLength"] == pytest.approx(RING_MM)
    assert header["pinholeFocalLength"] == pytest.approx(PINHOLE_MM)
    said, again = applied(preset, straight, tmp_path / "again", *own)
    assert "38 mm" in str(again.attributes["lensfit/applied"])
    assert "pinhole" not in said
    before = read_exr(plate).parts[0]
    inside = (slice(8, 56), slice(8, 88))
    x, y = DISPLAY.x_min - before.data_window.x_min, -before.data_window.y_min
    wanted = before.channels["G"][y : y + 64, x : x + 96][inside]
    assert np.abs(again.channels["G"][inside] - wanted).max() < 0.02
    state = inspected(tmp_path / "again" / "p.exr")["state"]
    assert state["focal_length_mm"] == pytest.approx(RING_MM)


@pytest.mark.parametrize(
    ("to", "name", "option"),
    [("usd", "z.usda", "--camera"), ("opentrackio", "z.json", "--metadata")],
)
def test_cameras_that_lensfit_wrote_state_the_ring(preset, tmp_path, to, name, option):
    if to == "usd":
        pytest.importorskip("pxr", reason="usd-core is not installed")
    run_well(
        "export", preset, "--to", to, "--out", tmp_path / name, "--focal-length-mm", 38
    )
    plate = write_plate(tmp_path / "p.exr", STATED)
    found = inspected(plate, option, tmp_path / name, "--preset", preset)
    assert found["state"]["focal_length_mm"] == pytest.approx(RING_MM)
    (other,) = found["overruled"]["focal_length_mm"]
    assert other["value"] == pytest.approx(PINHOLE_MM, rel=1e-3)
    assert other["of"] == "pinhole"


@pytest.mark.parametrize("key", ["pinholeFocalLength", "nuke/camera/focal"])
def test_the_ring_is_found_from_a_pinhole_and_noted(preset, tmp_path, key):
    plate = write_plate(tmp_path / "p.exr", {key: PINHOLE_MM, **STATED})
    said, result = applied(preset, plate, tmp_path / "out")
    assert "38 mm" in str(result.attributes["lensfit/applied"])
    (note,) = (line for line in said.splitlines() if "pinhole" in line)
    assert f"{key} states the focal length of a pinhole (37.62 mm)" in note
    assert "38 mm on its ring (--focal-length-mm states another)" in note
    # With no preset it is what the file states.
    assert inspected(plate)["state"]["focal_length_mm"] == pytest.approx(PINHOLE_MM)
    shown = inspected(plate, "--preset", preset)["state"]
    assert shown["focal_length_mm"] == pytest.approx(RING_MM)


def test_a_camera_node_states_a_pinhole(preset, tmp_path):
    script = tmp_path / "shot.nk"
    script.write_text(f"Camera2 {{\n focal {PINHOLE_MM:.9g}\n name Camera1\n}}\n")
    plate = write_plate(tmp_path / "p.exr", STATED)
    said, result = applied(preset, plate, tmp_path / "out", "--camera", script)
    assert "38 mm" in str(result.attributes["lensfit/applied"])
    assert "38 mm on its ring" in said


@pytest.mark.parametrize("ring_mm", [30.0, 33.3, 41.0, 50.0, 51.0])
@pytest.mark.parametrize("focus_mm", [None, 2000.0, 1950.0])
def test_the_pinhole_of_the_ring_is_the_pinhole(ring_mm, focus_mm):
    preset = zoom()
    at_mm = min(ring_mm, 50.0)
    projection = preset.select(at_mm, None, focus_mm).entry.projection
    pinhole_mm = projection.principal_distance_mm * ring_mm / at_mm
    found = ring_focal_length_mm(preset, pinhole_mm, focus_mm)
    assert found == pytest.approx(ring_mm, rel=1e-6)


def test_a_prime_is_at_its_own_focal_length_and_another_is_none():
    prime = make_preset(35.0)
    assert ring_focal_length_mm(prime, 36.1, 2000.0) == 35.0
    assert ring_focal_length_mm(prime, 50.0, 2000.0) == pytest.approx(50.0)
