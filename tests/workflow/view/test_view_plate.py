"""What the view shows is what `lensfit apply` makes."""

import shlex
import subprocess
import sys
import threading
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from documents import PAGES
from typer.testing import CliRunner
from view_makers import (
    FAR_M,
    NEAR_M,
    Client,
    plate_client,
    thin_lens,
    write_depth_plate,
    written_lens,
)

from lensfit.cli import main
from lensfit.io.exr import ExrImage, read_exr, write_exr
from lensfit.io.transfer import encode
from lensfit.plate.apply_options import ApplyOptions
from lensfit.plate.camera.sources import StateOverrides
from lensfit.preset.store import load_preset
from lensfit.workflow.apply import apply
from lensfit.workflow.view.lens_adjustments import (
    LensAdjustments,
    StartCommand,
    command_line,
)
from lensfit.workflow.view.viewed_plate import ViewedPlate

PRIME = Path(__file__).parents[3] / "presets" / "prime_50" / "preset.json"
TURNED = {"f_number": 4.0, "focus_distance_mm": 1600.0, "knobs": {"blades": 6}}


def applied(plate: Path, out: Path) -> Path:
    options = ApplyOptions(
        overrides=StateOverrides(f_number=4.0, focus_distance_mm=1600.0),
        knobs={"blades": 6},
    )
    made = apply(thin_lens(), plate, out, options=options)
    assert made.failures == []
    return made.written[0]


def frame_of(path: Path) -> np.ndarray:
    part = read_exr(path).parts[0]
    return np.stack([part.channels[n] for n in "RGB"], -1).astype(np.float32)


def test_the_frame_is_the_file_that_apply_writes(client, plate: Path, tmp_path: Path):
    answer = client.post("render", format="exr", **TURNED)
    assert answer.status == 200
    (tmp_path / "seen.exr").write_bytes(answer.content)
    seen, made = (
        read_exr(tmp_path / "seen.exr"),
        read_exr(applied(plate, tmp_path / "o")),
    )
    for one, other in zip(seen.parts, made.parts, strict=True):
        assert one.channels.keys() == other.channels.keys()
        for name, samples in other.channels.items():
            np.testing.assert_array_equal(one.channels[name], samples)
            assert one.channels[name].dtype == samples.dtype
        # A preset says when it was made, and so does the frame's record of it.
        assert one.attributes.keys() == other.attributes.keys()


def test_the_lines_of_the_guide_fetch_the_frame(client: Client, tmp_path: Path):
    _, code = PAGES["view.md"].split("```python\n")
    lines = code.partition("```")[0]
    script = [sys.executable, "-c", lines, client.address]
    subprocess.run(script, cwd=tmp_path, check=True)
    message = {"f_number": 2.8, "knobs": {"coma_gain": 0.5}}
    asked = client.post("render", format="exr", **message)
    (tmp_path / "asked.exr").write_bytes(asked.content)
    seen, wanted = (frame_of(tmp_path / name) for name in ("frame.exr", "asked.exr"))
    np.testing.assert_array_equal(seen, wanted)


def test_the_full_picture_is_that_frame_in_srgb(client, plate: Path, tmp_path: Path):
    answer = client.post("render", quality="full", exposure_stops=1, **TURNED)
    assert answer.headers["content-type"] == "image/png"
    shown = cv2.imdecode(np.frombuffer(answer.content, np.uint8), 1)[..., ::-1]
    light = frame_of(applied(plate, tmp_path / "out")).astype(np.float16).astype(float)
    codes = np.round(encode(np.clip(2 * light, 0, 1), "srgb") * 255)
    np.testing.assert_array_equal(shown, codes)


def test_the_pixels_are_those_of_apply_to_the_bit(plate: Path, tmp_path: Path):
    viewed = ViewedPlate(thin_lens(), str(plate), ApplyOptions())
    wanted = LensAdjustments(
        f_number=4.0, focus_distance_mm=1600.0, knobs={"blades": 6}
    )
    made = frame_of(applied(plate, tmp_path / "out"))
    np.testing.assert_array_equal(viewed.pixels(wanted, "full"), made)
    neutral = viewed.pixels(LensAdjustments(), "full")
    assert np.abs(neutral - made).max() > 1e-2
    np.testing.assert_array_equal(viewed.pixels(wanted, "full"), made)


@pytest.mark.slow
def test_the_pixels_of_a_fitted_lens_are_those_of_apply_to_the_bit(tmp_path: Path):
    plate = write_depth_plate(tmp_path / "plate.exr", 240, 135)
    preset = load_preset(PRIME)
    stated = {"focal_length_mm": 50.0, "f_number": 2.0, "focus_distance_mm": 1600.0}
    knobs = {"coma_gain": 2.0}
    width = {"sensor_width_mm": preset.camera.sensor_width_mm}
    options = ApplyOptions(overrides=StateOverrides(**stated, **width), knobs=knobs)
    made = apply(preset, plate, tmp_path / "out", options=options)
    assert made.failures == []
    opened = ApplyOptions(overrides=StateOverrides(**width))
    viewed = ViewedPlate(preset, str(plate), opened)
    seen = viewed.pixels(LensAdjustments(**stated, knobs=knobs), "full")
    np.testing.assert_array_equal(seen, frame_of(made.written[0]))
    assert np.abs(seen - viewed.plate_pixels(0)).max() > 1e-2


@pytest.mark.slow
def test_an_f_number_far_from_the_measured_ones_is_a_sentence(tmp_path: Path):
    plate = write_depth_plate(tmp_path / "plate.exr", 240, 135)
    preset = load_preset(PRIME)
    width = StateOverrides(sensor_width_mm=preset.camera.sensor_width_mm)
    with plate_client(plate, preset, ApplyOptions(overrides=width)) as client:
        state = {"focal_length_mm": 50, "f_number": 0.5, "focus_distance_mm": 1600}
        for name in ("render", "plan"):
            refused = client.post(name, **state)
            assert refused.status == 422
            assert "f/0.5" in refused.json()["error"]
            assert "larger f-number" in refused.json()["error"]


def test_a_click_focuses_on_what_lies_there(client):
    near = client.post("focus", x=10, y=20).json()["focus_distance_mm"]
    far = client.post("focus", x=80, y=20).json()["focus_distance_mm"]
    # Depth counts from the pinhole, focus from the sensor, which lies behind it.
    assert NEAR_M * 1000 <= near < NEAR_M * 1000 + 80
    assert FAR_M * 1000 <= far < FAR_M * 1000 + 80
    sharp = client.post("render", focus_distance_mm=near).content
    blurred = client.post("render", focus_distance_mm=far).content
    plate = client.post("plate").content
    pictures = [cv2.imdecode(np.frombuffer(p, np.uint8), 1) for p in
                (sharp, blurred, plate)]  # fmt: skip
    left = [p[10:-10, 12:36].astype(float) for p in pictures]
    assert np.abs(left[0] - left[2]).mean() < 3
    assert np.abs(left[1] - left[2]).mean() > 6


@pytest.mark.parametrize(
    ("message", "said"),
    [
        ({"f_number": 0}, "f_number: expected a number above 0"),
        ({"f_number": "2"}, "f_number: expected a number"),
        ({"frame": -1}, "frame: expected a whole number of at least 0"),
        ({"f_nmber": 2}, 'unknown key "f_nmber"; did you mean "f_number"?'),
    ],
)
def test_a_message_is_refused_in_plain_words(client, message: dict, said: str):
    error = client.post("save", **message).json()["error"]
    assert error.startswith(said)
    assert "`" not in error
    assert "$" not in error


def test_depth_of_field_is_left_out(client, plate: Path, tmp_path: Path):
    line = client.post("command", f_number=4, defocus=False).json()["command"]
    assert line.endswith("--f-number=4 --no-defocus")
    blurred, sharp = (
        client.post("render", focus_distance_mm="inf", **more).content
        for more in ({}, {"defocus": False})
    )
    assert blurred != sharp
    assert client.get("api/lens").json()["defocus"] is True
    given = StartCommand("lens.json", "p.exr", (("--no-defocus",),))
    assert "--no-defocus" not in command_line(given, LensAdjustments(defocus=True))
    notes = client.post("save", defocus=False).json()["notes"]
    assert "Depth of field" in notes[0]


def test_a_click_beside_the_frame_is_a_sentence(client):
    answer = client.post("focus", x=5000, y=2)
    assert answer.status == 422
    assert "holds no pixel" in answer.json()["error"]


def test_the_command_line_makes_the_same_frame(client, plate: Path, tmp_path: Path):
    lens = written_lens(tmp_path)
    given = (("--tolerance", "0.01"),)
    client.server.started = StartCommand(str(lens), str(plate), given)
    line = client.post("command", **TURNED).json()["command"]
    words = shlex.split(line)
    assert words[:2] == ["lensfit", "apply"]
    words[words.index("--out") + 1] = str(tmp_path / "out")
    run = CliRunner().invoke(main.app, words[1:])
    assert run.exit_code == 0, run.output
    viewed = ViewedPlate(thin_lens(), str(plate), ApplyOptions(tolerance=0.01))
    wanted = LensAdjustments(
        f_number=4.0, focus_distance_mm=1600.0, knobs={"blades": 6}
    )
    np.testing.assert_array_equal(
        frame_of(tmp_path / "out" / plate.name), viewed.pixels(wanted, "full")
    )


def test_what_the_page_turns_takes_the_place_of_the_command_s():
    given = (("--focus-at", "1,2"), ("--f-number", "8.0"), ("--no-falloff",))
    started = StartCommand("lens.json", "p.exr", given)
    wanted = LensAdjustments(
        f_number=2.8, focus_distance_mm="inf", knobs={"ring_brightness": -0.5}
    )
    assert command_line(started, wanted) == (
        "lensfit apply lens.json p.exr --out lens --no-falloff --f-number=2.8 "
        "--focus-distance-mm=inf --ring-brightness=-0.5"
    )


def test_saved_to_the_shot_apply_makes_the_same_frame(client, plate, tmp_path: Path):
    settings = plate.parent / "lensfit.toml"
    settings.write_text("# the shot\n[camera]\nf_number = 8  # a guess\n")
    answer = client.post("save", **TURNED)
    assert answer.status == 200
    assert answer.json() == {"path": str(settings), "changed": True, "notes": []}
    assert settings.read_text() == (
        "# the shot\n[camera]\nfocus_distance_mm = 1600\nf_number = 4  # a guess\n"
        "\n[knobs]\nblades = 6\n"
    )
    made = apply(thin_lens(), plate, tmp_path / "out")
    assert made.failures == []
    other = tmp_path / "elsewhere"
    other.mkdir()
    moved = other / plate.name
    moved.write_bytes(plate.read_bytes())
    np.testing.assert_array_equal(
        frame_of(made.written[0]), frame_of(applied(moved, tmp_path / "stated"))
    )


def test_what_stands_in_the_settings_already_changes_nothing(client, plate: Path):
    settings = plate.parent / "lensfit.toml"
    assert client.post("save").json()["changed"] is False
    assert not settings.exists()
    assert client.post("save", f_number=22).json()["changed"] is True
    before = settings.stat().st_mtime_ns
    assert client.post("save", f_number=22).json()["changed"] is False
    assert settings.stat().st_mtime_ns == before


def test_what_no_lens_can_be_is_not_saved(client, plate: Path):
    refused = client.post("save", f_number=1e9)
    assert refused.status == 422
    assert "f_number" in refused.json()["error"]
    assert not (plate.parent / "lensfit.toml").exists()


def test_start_values_are_those_of_the_files_now(client, plate: Path):
    assert client.post("start").json()["camera"]["f_number"] == 2
    client.post("save", f_number=22, knobs={"coma_gain": 2})
    found = client.post("start").json()
    assert found["camera"]["f_number"] == 22
    assert found["knobs"] == {"coma_gain": 2}
    assert client.post("start", frame=9).status == 422


def test_a_note_names_what_overrides_the_settings(client, plate: Path):
    settings = plate.parent / "lensfit.toml"
    settings.write_text('[[frames]]\nrange = "1001-1002"\nf_number = 8\n')
    notes = client.post("save", f_number=2.8).json()["notes"]
    assert len(notes) == 1
    assert "[[frames]]" in notes[0]


def test_an_edited_settings_file_is_seen(client, plate: Path):
    before = client.post("render").content
    (plate.parent / "lensfit.toml").write_text("[camera]\nf_number = 11\n")
    assert client.post("render").content != before


def test_the_plan_is_that_of_the_command(client, plate: Path):
    found = client.post("plan", f_number=4.0).json()
    assert found["tolerance"] == 3e-3
    assert {"stage", "runs", "reason", "error", "seconds"} <= found["stages"][0].keys()
    assert any("--depth-unit" in note for note in found["notes"])


def test_what_the_plate_lacks_is_said_and_can_be_stated(tmp_path: Path):
    plate = write_depth_plate(tmp_path / "bare.exr")
    image = read_exr(plate)
    part = replace(image.parts[0], attributes={})
    write_exr(plate, ExrImage((part,)))
    with plate_client(plate, thin_lens()) as client:
        start = client.get("api/lens").json()
        assert start["camera"]["f_number"] is None
        refused = client.post("render")
        assert refused.status == 422
        assert "--focus-distance-mm" in refused.json()["error"]
        stated = client.post("render", f_number=2.0, focus_distance_mm="inf")
        assert stated.status == 200


def test_pictures_from_many_threads_are_each_their_own(plate: Path):
    viewed = ViewedPlate(thin_lens(), str(plate), ApplyOptions())
    stops = [2.0, 2.8, 4.0, 5.6]
    alone = {n: viewed.pixels(LensAdjustments(f_number=n), "full") for n in stops}
    viewed = ViewedPlate(thin_lens(), str(plate), ApplyOptions())
    wrong: list[float] = []

    def look(stop: float) -> None:
        seen = viewed.pixels(LensAdjustments(f_number=stop), "full")
        if not np.array_equal(seen, alone[stop]):
            wrong.append(stop)

    threads = [threading.Thread(target=look, args=(n,)) for n in stops * 2]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert wrong == []
