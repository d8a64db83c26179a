"""Plates through a preset: channels, windows, camera state, failures, resuming."""

import numpy as np
import pytest
from plate_makers import (
    CAMERA,
    DATA,
    DISPLAY,
    SENSOR,
    make_preset,
    scene,
    sharp,
    write_plate,
)

from lensfit.coords import Window
from lensfit.errors import ImageError, PresetError
from lensfit.io.exr import ExrImage, ExrPart, read_exr, write_exr
from lensfit.io.stmap import write_stmap
from lensfit.plate.apply_options import ApplyOptions
from lensfit.plate.camera.sources import StateOverrides
from lensfit.rendering.frame import render
from lensfit.rendering.render_stages import Switches
from lensfit.workflow.apply import apply


def noise(dtype, seed):
    bits = np.random.default_rng(seed).integers(0, 2**32, (76, 112), np.uint32)
    return bits.view(np.float32) if dtype == np.float32 else bits.astype(dtype)


def test_a_plate_comes_out_as_the_renderer_says(tmp_path):
    plate = write_plate(
        tmp_path / "plate.0001.exr", {**CAMERA, **SENSOR, "owner": "me"}
    )
    applied = apply(make_preset(), plate, tmp_path / "out", options=sharp())
    assert applied.failures == []
    (part,) = read_exr(applied.written[0]).parts
    assert part.data_window == part.display_window == DISPLAY
    lens = make_preset().at(35.0, 2.8, 2000.0)
    exact = render(scene(DATA), None, lens, data_window=DATA, display_window=DISPLAY)
    for index, name in enumerate("RGB"):
        assert np.abs(part.channels[name] - exact[..., index]).max() < 1e-6
    assert part.attributes["owner"] == "me"
    assert part.attributes["lens/focal"] == pytest.approx(35.0)
    kept = part.attributes["originalDataWindow"]
    assert np.concatenate(kept).tolist() == list(DATA)


def test_ids_depth_and_matte_keep_their_bits(tmp_path):
    extra = {
        "CryptoObject00.r": noise(np.float32, 1),
        "CryptoObject00.g": noise(np.float32, 2),
        "CryptoObject00.b": noise(np.float32, 3),
        "CryptoObject00.a": noise(np.float32, 4),
        "depth.Z": noise(np.float32, 5),
        "count": noise(np.uint32, 6),
        "small.R": scene(DATA)[..., 0].astype(np.float16),
        "small.G": scene(DATA)[..., 1].astype(np.float16),
        "small.B": scene(DATA)[..., 2].astype(np.float16),
    }
    header = {**CAMERA, **SENSOR, "cryptomatte/542cafa/name": "CryptoObject"}
    plate = write_plate(tmp_path / "plate.exr", header, extra)
    for keep in (True, False):
        options = ApplyOptions(keep_overscan=keep, overwrite=True)
        applied = apply(make_preset(), plate, tmp_path / "out", options=options)
        (part,) = read_exr(applied.written[0]).parts
        inside = np.s_[:, :] if keep else np.s_[6:70, 8:104]
        for name in list(extra)[:6]:
            assert part.channels[name].tobytes() == extra[name][inside].tobytes()
        assert part.data_window == (DATA if keep else DISPLAY)
        # The half layer is rendered like the beauty, and stays half.
        assert part.channels["small.R"].dtype == np.float16
        gap = part.channels["small.R"].astype(np.float32) - part.channels["R"]
        assert np.abs(gap).max() < 2e-3
        assert not np.array_equal(part.channels["R"], scene(DATA)[..., 0][inside])


def test_only_named_layers_are_rendered(tmp_path):
    rgb = scene(DATA)
    extra = {f"diffuse.{n}": rgb[..., i].copy() for i, n in enumerate("RGB")}
    plate = write_plate(tmp_path / "plate.exr", extra=extra)
    options = sharp(layers=["diffuse"], keep_overscan=True)
    applied = apply(make_preset(), plate, tmp_path / "out", options=options)
    (part,) = read_exr(applied.written[0]).parts
    assert np.array_equal(part.channels["R"], rgb[..., 0])
    assert not np.array_equal(part.channels["diffuse.R"], rgb[..., 0])


def test_several_parts_are_each_kept(tmp_path):
    rgb = scene(DATA)
    beauty = ExrPart(
        {n: rgb[..., i].copy() for i, n in enumerate("RGB")},
        DATA,
        DISPLAY,
        {**CAMERA, **SENSOR},
        name="beauty",
    )
    depth = ExrPart({"Z": noise(np.float32, 7)}, DATA, DISPLAY, name="depth")
    write_exr(tmp_path / "plate.exr", ExrImage((depth, beauty)))
    applied = apply(make_preset(), tmp_path / "plate.exr", tmp_path / "out")
    assert applied.failures == []
    first, second = read_exr(applied.written[0]).parts
    assert (first.name, second.name) == ("depth", "beauty")
    own = depth.channels["Z"][6:70, 8:104]
    assert first.channels["Z"].tobytes() == own.tobytes()
    assert set(second.channels) == {"R", "G", "B"}


def test_switches_off_and_cropped_is_a_plain_crop(tmp_path):
    plate = write_plate(tmp_path / "plate.exr")
    switches = Switches(False, False, False, False)
    options = ApplyOptions(switches=switches)
    applied = apply(make_preset(), plate, tmp_path / "out", options=options)
    (part,) = read_exr(applied.written[0]).parts
    assert np.array_equal(part.channels["G"], scene(DATA)[6:70, 8:104, 1])


def test_a_sequence_goes_on_past_a_bad_frame_and_resumes(tmp_path):
    for number in (1, 2, 4):
        write_plate(tmp_path / f"plate.{number:04d}.exr")
    (tmp_path / "plate.0002.exr").write_bytes(b"no picture")
    told = []
    applied = apply(
        make_preset(),
        tmp_path / "plate.####.exr",
        tmp_path / "out",
        frames="1-4",
        options=sharp(),
        progress=lambda *state: told.append(state),
    )
    assert [p.name for p in applied.written] == ["plate.0001.exr", "plate.0004.exr"]
    assert len(applied.failures) == 2
    assert "plate.0002.exr" in applied.failures[0]
    assert applied.failures[1] == (
        f"{tmp_path / 'plate.0003.exr'}: frame 3 of the stated frames 1-4 does not "
        "exist; render it first, or leave it out of the range (--frames)"
    )
    assert told[-1] == ("frames", 4, 4)
    assert len(list((tmp_path / "out").iterdir())) == 2  # nothing half-written

    write_plate(tmp_path / "plate.0002.exr")
    before = applied.written[0].stat().st_mtime_ns
    again = apply(
        make_preset(), tmp_path / "plate.####.exr", tmp_path / "out", options=sharp()
    )
    assert [p.name for p in again.written] == ["plate.0002.exr"]
    assert len(again.skipped) == 2
    assert applied.written[0].stat().st_mtime_ns == before


def test_a_frame_absent_from_the_range_of_the_pattern_is_named_by_it(tmp_path):
    write_plate(tmp_path / "plate.0001.exr")
    pattern = tmp_path / "plate.1-2####.exr"
    told = []
    applied = apply(
        make_preset(),
        pattern,
        tmp_path / "out",
        options=sharp(),
        frame_done=lambda _, outcome, *counts: told.append(outcome.failure),
    )
    (failure,) = applied.failures
    assert "frame 2 of the stated frames 1-2 does not exist" in failure
    assert told == [None, failure]


def test_frames_follow_their_own_metadata_and_overrides_count_more(tmp_path):
    preset = make_preset(35.0, 70.0)
    write_plate(tmp_path / "plate.0001.exr")
    write_plate(tmp_path / "plate.0002.exr", {**CAMERA, **SENSOR, "lens/focal": 70.0})
    applied = apply(
        preset, tmp_path / "plate.####.exr", tmp_path / "out", options=sharp()
    )
    wide, long = (read_exr(p).parts[0].channels["G"] for p in applied.written)
    assert np.abs(wide - long).max() > 0.02
    options = sharp(overrides=StateOverrides(focal_length_mm=70.0))
    stated = apply(
        preset, tmp_path / "plate.0001.exr", tmp_path / "stated", options=options
    )
    assert np.array_equal(read_exr(stated.written[0]).parts[0].channels["G"], long)


@pytest.mark.parametrize(
    ("lacking", "preset", "option"),
    [
        ("lens/focal", make_preset(35.0, 70.0), "--focal-length-mm"),
        ("lens/fstop", make_preset(stops=(2.8, 5.6)), "--f-number"),
    ],
)
def test_a_missing_value_names_itself_the_frame_and_the_way_out(
    tmp_path, lacking, preset, option
):
    header = {k: v for k, v in {**CAMERA, **SENSOR}.items() if k != lacking}
    plate = write_plate(tmp_path / "plate.0007.exr", header)
    (failure,) = apply(preset, plate, tmp_path / "out").failures
    assert "plate.0007.exr" in failure
    assert lacking in failure
    assert option in failure
    assert "\n" not in failure


def test_what_is_assumed_is_noted_once(tmp_path):
    for number in (1, 2):
        write_plate(tmp_path / f"plate.{number}.exr", CAMERA)
    applied = apply(
        make_preset(), tmp_path / "plate.#.exr", tmp_path / "out", options=sharp()
    )
    (note,) = applied.notes
    assert "sensor width" in note
    assert "36 mm" in note


def test_a_lens_out_of_reach_is_told_with_the_frame(tmp_path):
    plate = write_plate(tmp_path / "p.exr", {**CAMERA, **SENSOR, "lens/focal": 85.0})
    (failure,) = apply(make_preset(), plate, tmp_path / "out", options=sharp()).failures
    assert "p.exr" in failure
    assert "85" in failure


def test_no_colour_and_no_frame_at_all(tmp_path):
    part = ExrPart({"Z": noise(np.float32, 1)}, DATA, DISPLAY, {**CAMERA, **SENSOR})
    write_exr(tmp_path / "z.exr", ExrImage((part,)))
    applied = apply(make_preset(), tmp_path / "z.exr", tmp_path / "out")
    assert "no R, G, B" in applied.failures[0]
    assert "a layer needs all three, or Y; its channels are Z" in applied.failures[0]
    with pytest.raises(ImageError, match="no frame exists"):
        apply(make_preset(), tmp_path / "none.####.exr", tmp_path / "out")


def test_a_result_never_replaces_its_plate(tmp_path):
    plate = write_plate(tmp_path / "plate.exr")
    before = plate.read_bytes()
    applied = apply(make_preset(), plate, tmp_path)
    assert "would replace its own source" in applied.failures[0]
    assert plate.read_bytes() == before


def test_an_external_map_replaces_the_distortion(tmp_path):
    plate = write_plate(tmp_path / "plate.exr")
    centres = DISPLAY.pixel_centres()
    uv = np.stack([(centres[..., 0] + 2) / 96, 1 - (centres[..., 1] - 1) / 64], -1)
    write_stmap(tmp_path / "map.exr", uv.astype(np.float32), DISPLAY)
    switches = Switches(lateral_colour=False, falloff=False, defocus=False)
    options = ApplyOptions(switches=switches, stmap=tmp_path / "map.exr")
    applied = apply(make_preset(), plate, tmp_path / "out", options=options)
    (part,) = read_exr(applied.written[0]).parts
    assert np.array_equal(part.channels["R"], scene(DATA)[5:69, 10:106, 0])
    kept = sharp(keep_overscan=True, stmap=tmp_path / "map.exr")
    (failure,) = apply(make_preset(), plate, tmp_path / "kept", options=kept).failures
    assert "does not cover" in failure


def test_preset_errors_before_the_first_frame_are_raised(tmp_path):
    with pytest.raises(PresetError):
        make_preset(35.0, 70.0).at()
    options = ApplyOptions(stmap=tmp_path / "none.exr")
    plate = write_plate(tmp_path / "plate.exr")
    with pytest.raises(ImageError):
        apply(make_preset(), plate, tmp_path / "out", options=options)


def test_the_path_traced_plate(tmp_path, data_dir):
    plate = data_dir / "plates" / "plate.0001.exr"
    applied = apply(make_preset(), plate, tmp_path)
    assert applied.failures == []
    (before,), (after,) = read_exr(plate).parts, read_exr(applied.written[0]).parts
    rows, columns = slice(27, 567), slice(48, 1008)
    for name, samples in before.channels.items():
        same = np.array_equal(
            samples[rows, columns].view(np.uint32), after.channels[name].view(np.uint32)
        )
        assert same == (name not in ("R", "G", "B", "A")), name
    assert min(after.channels[n].min() for n in "RGB") >= 0
    assert after.channels["A"].max() <= 1


def test_borders_without_source_are_told_and_overscan_cures_them(tmp_path):
    """A barrel lens looks beyond the frame: a plate without overscan lacks that."""
    bare, wide = tmp_path / "bare.exr", tmp_path / "wide.exr"
    write_plate(bare, window=DISPLAY)
    write_plate(wide, window=Window(-30, -20, 125, 83))
    preset = make_preset()
    notes = [
        apply(preset, plate, tmp_path / "out", options=sharp()).notes
        for plate in (bare, wide)
    ]
    assert any("outside the plate" in note for note in notes[0])
    assert not any("outside the plate" in note for note in notes[1])


def test_numbers_that_are_none_are_told(tmp_path):
    red = scene(DATA)[..., 0].copy()
    red[30, 40] = np.nan
    for frame in (1, 2, 3):
        write_plate(tmp_path / f"p.{frame}.exr", extra={"R": red} if frame > 1 else {})
    applied = apply(
        make_preset(), tmp_path / "p.#.exr", tmp_path / "out", options=sharp()
    )
    (note,) = (note for note in applied.notes if "NaN" in note)
    assert note.startswith("p.2.exr holds NaN")


def test_an_undistort_map_is_refused(tmp_path):
    write_plate(tmp_path / "p.exr")
    path = tmp_path / "lens_undistort.exr"
    uv = np.zeros((DISPLAY.height, DISPLAY.width, 2), np.float32)
    write_stmap(path, uv, DISPLAY, attributes={"lensfit/map": "undistort"})
    options = ApplyOptions(stmap=path)
    with pytest.raises(ImageError, match="undistort map"):
        apply(make_preset(), tmp_path / "p.exr", tmp_path / "out", options=options)


@pytest.mark.parametrize("kept_bytes", [0, 300, -40])
def test_a_damaged_frame_is_no_finished_one(tmp_path, kept_bytes):
    plate, out = write_plate(tmp_path / "p.exr"), tmp_path / "out"
    (target,) = apply(make_preset(), plate, out, options=sharp()).written
    whole = target.read_bytes()
    target.write_bytes(whole[:kept_bytes])
    again = apply(make_preset(), plate, out, options=sharp())
    assert again.written == [target]
    assert f"{target} was damaged and is rendered again" in again.notes
    assert target.read_bytes() == whole
    assert apply(make_preset(), plate, out, options=sharp()).skipped == [target]


@pytest.mark.parametrize("content", [b"a text", b"\x76\x2f\x31\x01" + bytes(2000)])
def test_what_others_left_there_is_never_replaced(tmp_path, content):
    plate, out = write_plate(tmp_path / "p.exr"), tmp_path / "out"
    out.mkdir()
    (out / "p.exr").write_bytes(content)
    done = apply(make_preset(), plate, out, options=sharp())
    assert "no frame that lensfit rendered" in str(done.failures)
    assert (out / "p.exr").read_bytes() == content


def test_frames_of_a_single_plate_cannot_be_chosen(tmp_path):
    plate = write_plate(tmp_path / "p.1001.exr")
    with pytest.raises(ImageError, match="single picture"):
        apply(make_preset(), plate, tmp_path / "out", frames="1-9")


@pytest.mark.parametrize(
    ("width_mm", "told"), [(0.036, True), (3.6, True), (12.0, False), (36.0, False)]
)
def test_a_sensor_in_another_unit_is_told(tmp_path, width_mm, told):
    plate = write_plate(tmp_path / "p.exr", {**CAMERA, "lens/aperture": width_mm})
    notes = apply(make_preset(), plate, tmp_path / "out", options=sharp()).notes
    assert any("make sure that this is in mm" in note for note in notes) == told


@pytest.mark.parametrize("width_mm", [0.0, -5.0, float("nan"), 1e-9])
def test_a_sensor_without_width_is_refused_in_one_line(tmp_path, width_mm):
    write_plate(tmp_path / "p.exr", CAMERA)
    options = ApplyOptions(overrides=StateOverrides(sensor_width_mm=width_mm))
    applied = apply(
        make_preset(), tmp_path / "p.exr", tmp_path / "out", options=options
    )
    assert "--sensor-width-mm" in applied.failures[0]


def test_a_cropped_frame_states_no_overscan(tmp_path):
    write_plate(tmp_path / "p.exr", {**CAMERA, **SENSOR, "lens/overscan": 8.0})
    apply(make_preset(), tmp_path / "p.exr", tmp_path / "out", options=sharp())
    header = read_exr(tmp_path / "out" / "p.exr", header_only=True).parts[0].attributes
    assert header["lens/overscan"] == 0.0
