"""Overscan of a shot: what the CG is told is what `apply` then needs."""

import json

import numpy as np
import pytest
from plate_makers import CAMERA, SENSOR, make_preset, sharp, write_plate
from typer.testing import CliRunner

from lensfit.cli.main import app
from lensfit.coords import Window
from lensfit.errors import ImageError, PresetError
from lensfit.exchange.stmaps import StmapFrame
from lensfit.io.exr import read_exr
from lensfit.preset.knob_groups import AberrationKnobs
from lensfit.preset.knobs import Knobs
from lensfit.preset.store import save_preset
from lensfit.rendering.overscan import Margins, margins_read
from lensfit.workflow.apply import apply
from lensfit.workflow.overscan import OverscanQuestion, plan_overscan

SIZE = (96, 64)
"""Of the plates."""


def run(*arguments):
    return CliRunner().invoke(app, ["overscan", *map(str, arguments)])


def border(path):
    pixels = read_exr(path).parts[0].channels["G"]
    return np.concatenate([pixels[0], pixels[-1], pixels[:, 0], pixels[:, -1]])


def test_a_plate_with_the_data_window_it_states_has_no_black_border(tmp_path):
    preset = make_preset(stops=())
    plan = plan_overscan(preset, OverscanQuestion(SIZE))
    wide, short = plan.camera.data_window, plan.camera.data_window.grown(-4, -4)
    for name, window in (("wide", wide), ("short", short)):
        plate = write_plate(tmp_path / f"{name}.exr", window=window)
        applied = apply(preset, plate, tmp_path / "out", options=sharp())
        black = any("lensfit overscan" in note for note in applied.notes)
        assert black == (name == "short")
        assert (border(applied.written[0]).min() < 0.1) == (name == "short")


def test_maps_of_that_percentage_cover_the_same_pixels():
    plan = plan_overscan(make_preset(), OverscanQuestion((4096, 3072)))
    maps = StmapFrame((4096, 3072), plan.camera.percent)
    assert maps.data_window == plan.camera.data_window
    assert plan.camera.percent / 100 + 1 == pytest.approx(plan.factor, abs=2e-3)


def test_a_range_is_as_wide_as_its_worst_state():
    preset = make_preset(24.0, 35.0, 70.0)
    span = OverscanQuestion((960, 640), focal_length_mm=(28.0, 60.0))
    found = plan_overscan(preset, span)
    worst = Margins(0, 0, 0, 0)
    for focal in np.random.default_rng(0).uniform(28, 60, 12):
        lens = preset.at(float(focal), None, 2000.0)
        worst = worst.joined(margins_read(lens, Window.of_size(960, 640)))
    assert all(a <= b for a, b in zip(worst, found.margins, strict=True))
    everything = plan_overscan(preset, OverscanQuestion((960, 640)))
    assert everything.margins.left > found.margins.left
    assert everything.states > 3


def test_colours_alone_and_together():
    plan = plan_overscan(make_preset(), OverscanQuestion((960, 640)))
    red, green, blue = plan.channels.values()
    assert blue.left > green.left > red.left
    assert plan.margins == red.joined(green).joined(blue)


def test_depth_of_field_is_stated_apart():
    question = OverscanQuestion((960, 640), f_number=2.0, nearest_mm=900.0)
    plan = plan_overscan(make_preset(), question)
    assert plan.blur_px is not None
    assert plan.with_blur is not None
    sharp = plan_overscan(make_preset(), OverscanQuestion((960, 640)))
    assert plan.margins == sharp.margins
    assert sharp.blur_px is None
    assert plan.with_blur.left - plan.margins.left >= int(plan.blur_px)
    only_far = plan_overscan(make_preset(), OverscanQuestion((960, 640), f_number=2.0))
    assert only_far.blur_px is not None
    assert only_far.blur_px < plan.blur_px
    # f/N f' / (2 pitch): the sky, focused at 2 m from the sensor, 1950 mm ahead.
    radius = (35 / (1 + 35 / 1950)) / 2 * 35 / 1950 / (2 * 36 / 960)
    assert only_far.blur_px == pytest.approx(radius, rel=1e-6)


def test_what_cannot_be_answered_is_one_line(tmp_path):
    preset = make_preset(24.0, 70.0)
    with pytest.raises(PresetError, match="not in the preset"):
        plan_overscan(preset, OverscanQuestion(SIZE, focal_length_mm=(10.0, 24.0)))
    with pytest.raises(PresetError, match="inside the lens"):
        plan_overscan(preset, OverscanQuestion(SIZE, f_number=2.0, nearest_mm=40.0))
    with pytest.raises(ImageError, match="0 x 64"):
        plan_overscan(preset, OverscanQuestion((0, 64)))
    with pytest.raises(ImageError, match="-1 mm wide"):
        plan_overscan(preset, OverscanQuestion(SIZE, sensor_width_mm=-1.0))
    save_preset(preset, tmp_path / "preset.json")
    for wrong in (0.0, -2.0, np.nan, np.inf):
        with pytest.raises(ImageError, match="no f-number; give one above zero"):
            plan_overscan(preset, OverscanQuestion(SIZE, f_number=wrong))
    for option in ("--f-number", "--sensor-width-mm"):
        assert run(tmp_path / "preset.json", option, 0).exit_code == 1
    for wrong in ("70:24", "a", "24:35:70", "-5", "nan"):
        words = [tmp_path / "preset.json", "--focal-length-mm", wrong]
        assert run(*words).exit_code == 2


def test_the_command_says_the_same_to_people_and_machines(tmp_path):
    save_preset(make_preset(24.0, 35.0), tmp_path / "preset.json")
    words = [tmp_path / "preset.json", "--size", "4096x3072", "--f-number", 2.8]
    result = run(*words, "--json", "--per-channel")
    said = json.loads(result.stdout)
    plan = plan_overscan(
        make_preset(24.0, 35.0), OverscanQuestion((4096, 3072), f_number=2.8)
    )
    assert said["overscan_percent"] == plan.camera.percent
    assert said["data_window"] == list(plan.camera.data_window)
    assert said["sensor_mm"][0] == pytest.approx(36 * said["render_px"][0] / 4096)
    assert said["open_lens_io_factor"] == plan.factor
    assert said["channels"]["b"]["left"] == plan.margins.left
    assert plan.blur_camera is not None
    blurred = said["depth_of_field"]
    assert blurred["overscan_percent"] == plan.blur_camera.percent
    text = run(*words, "--per-channel").stdout
    for fact in (
        f"lens/overscan {plan.camera.percent:.4f} %",
        f"render {plan.camera.render_px[0]} x {plan.camera.render_px[1]}",
        f"OpenLensIO overscan {plan.factor:.6f}",
        f"blur of up to {plan.blur_px:.1f} px",
        f"largest of {plan.states} states",
        "b alone: left",
    ):
        assert fact in text


def test_a_focus_range_reaches_to_infinity_and_notes_what_was_not_measured(tmp_path):
    save_preset(make_preset(), tmp_path / "preset.json")
    result = run(tmp_path / "preset.json", "--focus-distance-mm", "1000:inf")
    assert result.exit_code == 0
    assert "outside what was measured" in result.stderr


def test_a_plate_is_judged_by_its_own_header(tmp_path):
    preset = tmp_path / "preset.json"
    save_preset(make_preset(24.0, 35.0, 70.0), preset)
    state = {"lens/focal": 30.0, "lens/aperture": 30.0, "lens/focus": 2.0}
    lens = make_preset(24.0, 35.0, 70.0).at(30.0, None, 2000.0)
    needed = margins_read(lens, Window.of_size(96, 64), sensor_width_mm=30.0)
    exact = Window(-needed.left, -needed.top, 95 + needed.right, 63 + needed.bottom)
    short = exact._replace(x_min=exact.x_min + 1)
    for window, enough in ((exact, True), (short, False)):
        header = {**state, "lens/overscan": 9.0}
        plate = write_plate(tmp_path / "plate.exr", header, window=window)
        said = json.loads(run(preset, "--plate", plate, "--json").stdout)
        assert said["margins_px"] == needed._asdict()
        assert said["plate"]["suffices"] == enough
        assert said["plate"]["stated_percent"] == 9.0
        text = run(preset, "--plate", plate).stdout
        assert ("header states 9 %: enough" in text) == enough
        assert ("too little" in text) != enough
    bare = write_plate(
        tmp_path / "bare.exr",
        {**state, "lens/overscan": 9.0},
        window=Window(0, 0, 95, 63),
    )
    assert "no pixel lies beyond" in run(preset, "--plate", bare).stderr
    assert run(preset, "--plate", tmp_path / "none.exr").exit_code == 1


def test_an_element_needs_no_overscan_where_it_ends_inside_the_frame(tmp_path):
    preset = tmp_path / "preset.json"
    save_preset(make_preset(), preset)
    for window, enough, sides in (
        (Window(20, 15, 49, 40), True, "left, top, right, bottom"),
        (Window(0, 15, 49, 40), False, "top, right, bottom"),
    ):
        plate = write_plate(tmp_path / "plate.exr", window=window)
        said = json.loads(run(preset, "--plate", plate, "--json").stdout)
        assert said["plate"]["suffices"] == enough
        text = " ".join(run(preset, "--plate", plate).stdout.split())
        word = "enough" if enough else "too little"
        ends = f"empty, as it ends inside the frame, on the {sides}: {word}"
        assert ends in text


def test_a_turned_lens_reads_as_far_as_its_plate_is_told(tmp_path):
    preset = make_preset(stops=())
    save_preset(preset, tmp_path / "preset.json")
    plain = plan_overscan(preset, OverscanQuestion(SIZE)).margins
    strong = Knobs(aberration=AberrationKnobs(distortion_gain=2.0))
    turned = plan_overscan(preset, OverscanQuestion(SIZE, knobs=strong)).margins
    assert turned.left > plain.left
    for margins in (plain, turned):
        window = Window(
            -margins.left, -margins.top, 95 + margins.right, 63 + margins.bottom
        )
        header = {**CAMERA, **SENSOR, "lensfit/distortion_gain": 2.0}
        plate = write_plate(tmp_path / "plate.exr", header, window=window)
        result = run(tmp_path / "preset.json", "--plate", plate, "--json")
        said = json.loads(result.stdout)
        applied = apply(preset, plate, tmp_path / "out", options=sharp(overwrite=True))
        black = any("lensfit overscan" in note for note in applied.notes)
        assert said["plate"]["suffices"] == (margins == turned) == (not black)
        assert said["margins_px"] == turned._asdict()


def test_knobs_on_the_command_line_count_over_preset_and_header(tmp_path):
    preset = tmp_path / "preset.json"
    save_preset(make_preset(stops=()), preset)
    strong = Knobs(aberration=AberrationKnobs(distortion_gain=2.0))
    question = OverscanQuestion(SIZE, knobs=strong)
    turned = plan_overscan(make_preset(stops=()), question).margins._asdict()
    size = ("--size", "96x64", "--json")
    wide = json.loads(run(preset, *size, "--distortion-gain", 2).stdout)
    assert wide["margins_px"] == turned
    header = {**CAMERA, **SENSOR, "lensfit/distortion_gain": 0.5}
    plate = write_plate(tmp_path / "p.exr", header)
    by_option = run(preset, "--plate", plate, "--json", "--distortion-gain", 2)
    assert json.loads(by_option.stdout)["margins_px"] == turned
    off = json.loads(run(preset, *size, "--disable", "distortion").stdout)
    assert off["margins_px"]["left"] < wide["margins_px"]["left"]
    blurred = (*size, "--f-number", 1.4, "--nearest-mm", 400)
    free = json.loads(run(preset, *blurred).stdout)["depth_of_field"]
    capped = run(preset, *blurred, "--maximum-blur-percent", 1)
    radius = json.loads(capped.stdout)["depth_of_field"]["blur_radius_px"]
    assert radius == pytest.approx(0.96)
    assert free["blur_radius_px"] > 1


def test_a_plate_of_unknown_focus_is_told_no_depth_of_field(tmp_path):
    preset = tmp_path / "preset.json"
    save_preset(make_preset(), preset)
    header = {**SENSOR, "lens/focal": 35.0, "lens/fstop": 2.8}
    plate = write_plate(tmp_path / "p.1001.exr", header)
    result = run(preset, "--plate", plate, "--json")
    assert result.exit_code == 0
    assert "depth_of_field" not in json.loads(result.stdout)
    assert "p.1001.exr: no focus distance is known" in result.stderr
    asked = run(preset, "--plate", plate, "--f-number", 2.8)
    assert asked.exit_code == 1
    (line,) = asked.stderr.splitlines()
    for part in (str(plate), "no focus distance, which depth of field needs"):
        assert part in line
    words = ("--f-number", 2.8, "--focus-distance-mm", 1500, "--json")
    stated = json.loads(run(preset, "--plate", plate, *words).stdout)
    assert stated["depth_of_field"]["blur_radius_px"] > 0


def test_the_one_measured_focus_distance_is_told(tmp_path):
    save_preset(make_preset(), tmp_path / "preset.json")
    notes = run(tmp_path / "preset.json", "--f-number", 2.8).stderr
    assert "the preset's only one, 2000 mm" in notes
    stated = ("--f-number", 2.8, "--focus-distance-mm", 2000)
    assert run(tmp_path / "preset.json", *stated).stderr == ""
