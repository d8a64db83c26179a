"""Which source of the camera state counts, that it is told, and that pixels follow."""

import math
import os
import pickle

import camera_files as files
import numpy as np
import OpenEXR
import pytest
from deep_files import write_deep
from plate_makers import DATA, DISPLAY, make_preset, sharp, write_plate

from lensfit.coords import Window
from lensfit.errors import CameraError, ImageError, SettingsError
from lensfit.io.exr import read_exr
from lensfit.plate.apply_options import ApplyOptions
from lensfit.plate.camera.plate_state import focus_distance_from_sensor_mm
from lensfit.plate.camera.sources import (
    CameraOptions,
    CameraSources,
    StateOverrides,
)
from lensfit.plate.frame.plate_lens import PlateLens
from lensfit.plate.frame.provenance import SAID
from lensfit.plate.plate_depth import DepthOptions, picked_region
from lensfit.plate.plate_file import plate_header
from lensfit.workflow.apply import apply
from lensfit.workflow.inspect import as_json, facts, inspect_images

PRIME = {"Lens Focal Length": "35.0"}
"""As the preset's."""
SIZE = (DISPLAY.width, DISPLAY.height)
PHOTOSITES: dict[str, object] = {
    "sensorPhotositePitch": 8.0,
    "sensorAcquisitionRectangle": ((0, 0), (2999, 1999)),
}
HEADER = {"lens/focal": 50.0, "lens/fstop": 5.6, "lens/aperture": 36.0}


def camera(plate, header=HEADER, *, overrides=None, width_mm=None, **options):
    sources = CameraSources(CameraOptions(**options), overrides)
    return sources.of_plate(plate, header, SIZE, width_mm)


def timecode(frame):
    return OpenEXR.TimeCode(10, 0, 0, frame, *[0] * 14)


def state_of(plate, preset=None, **options):
    lens = PlateLens(preset or make_preset(), ApplyOptions(**options))
    return lens.noted_state(plate_header(plate), plate), lens.notes.said


def test_each_source_is_overruled_by_the_one_before_it(tmp_path):
    plate = tmp_path / "plate.1001.exr"
    first = files.nuke(tmp_path, "focal 35")
    second = files.chan(tmp_path, f1001=40.0)
    steps = [
        (50.0, {}),
        (12 / math.tan(math.radians(20)), {"files": (second,)}),
        (35.0, {"files": (first, second)}),
    ]
    for wanted, options in steps:
        assert camera(plate, **options).number("focal_length_mm") == pytest.approx(
            wanted, rel=1e-6
        )
    settings = tmp_path / "lensfit.toml"
    settings.write_text("[camera]\nfocal_length_mm = 28\n")
    assert camera(plate).number("focal_length_mm") == 28
    with settings.open("a") as file:
        file.write("[[frames]]\nrange = '1001'\nfocal_length_mm = 24\n")
    assert camera(plate).number("focal_length_mm") == 24
    # What is named on the command line counts before what lies about.
    assert camera(plate, files=(first, second)).number("focal_length_mm") == 35
    named = tmp_path / "named.toml"
    named.write_text("[camera]\nfocal_length_mm = 25\n")
    both = camera(plate, files=(first, second), settings=named)
    assert [both.known["focal_length_mm"].value] + [
        known.value for known in both.overruled["focal_length_mm"]
    ] == [25, 35, pytest.approx(12 / math.tan(math.radians(20))), 50]
    stated = StateOverrides(focal_length_mm=21.0)
    found = camera(plate, files=(first, second), overrides=stated)
    assert found.known["focal_length_mm"][:2] == (21.0, "--focal-length-mm")
    sources = [known.source for known in found.overruled["focal_length_mm"]]
    assert [known.value for known in found.overruled["focal_length_mm"]] == [
        35,
        pytest.approx(12 / math.tan(math.radians(20))),
        24,
        28,
        50,
    ]
    for source, part in zip(
        sources,
        ("shot.nk", "camera.chan line 1", "[[frames]] 1", "[camera]", "lens/focal"),
        strict=True,
    ):
        assert part in source


def test_each_quantity_is_decided_by_itself(tmp_path):
    red = files.red_frames(tmp_path, 410, cooke="")
    static = files.red_static(tmp_path)
    found = camera(tmp_path / "p.1.exr", files=(red, static))
    assert found.known["f_number"].source.startswith(str(red))
    assert found.known["sensor_width_mm"].source.startswith(str(static))
    assert found.number("focal_length_mm") == 40


def test_rows_follow_the_plates_timecode_or_its_frame(tmp_path):
    arri = files.arri(tmp_path, {}, {}, {})
    header = {**HEADER, "timeCode": timecode(2)}
    plate = tmp_path / "p.1001.exr"
    assert camera(plate, header, files=(arri,)).number("focus_distance_mm") == 4000
    counted = camera(plate, files=(arri,), first_frame=1000)
    assert counted.number("focus_distance_mm") == 3000
    with pytest.raises(CameraError, match="--metadata-start"):
        camera(plate, files=(arri,))
    with pytest.raises(CameraError, match="none for 1001"):
        camera(plate, files=(arri,), first_frame=1002)


def test_a_t_stop_stands_for_an_f_number_only_when_nobody_knows_one(tmp_path):
    plate, sony = tmp_path / "p.1.exr", files.sony(tmp_path)
    known = camera(plate, files=(sony,))
    assert known.number("f_number") == 5.6
    assert any("knows the T-stop only" in note for note in known.notes)
    unknown = camera(plate, {}, files=(sony,))
    assert unknown.number("f_number") == pytest.approx(2.219, abs=1e-3)
    assert any("used as the f-number" in note for note in unknown.notes)
    assert "T-stop" in unknown.known["f_number"].source
    header = camera(plate, {"tStop": 2.0})
    assert (header.number("f_number"), len(header.notes)) == (2.0, 1)


def test_a_field_of_view_takes_the_height_that_goes_with_the_width(tmp_path):
    plate, chan = tmp_path / "p.1.exr", files.chan(tmp_path, f1=90.0)
    # Half a right angle: the focal length is half the height.
    by_format = camera(plate, {}, files=(chan,), width_mm=36.0)
    assert by_format.number("focal_length_mm") == pytest.approx(12)
    nuke = files.nuke(tmp_path, "haperture 24", "vaperture 18")
    stated = camera(plate, {}, files=(chan, nuke))
    assert stated.number("focal_length_mm") == pytest.approx(9)
    # The height of another sensor than the one stated does not count.
    width = StateOverrides(sensor_width_mm=30.0)
    overruled = camera(plate, {}, files=(chan, nuke), overrides=width)
    assert overruled.number("focal_length_mm") == pytest.approx(10)
    nobody = camera(plate, {}, files=(chan,))
    assert nobody.number("focal_length_mm") is None
    assert nobody.number("vertical_fov_deg") == 90


def test_a_broken_header_entry_hurts_only_where_it_counts(tmp_path):
    header = {"lens/focal": "wide"}
    with pytest.raises(ImageError, match="lens/focal"):
        camera(tmp_path / "p.exr", header)
    stated = StateOverrides(focal_length_mm=35.0)
    found = camera(tmp_path / "p.exr", header, overrides=stated)
    assert found.number("focal_length_mm") == 35


@pytest.mark.parametrize(
    ("header", "option"),
    [
        ({"lens/focal": "wide"}, "--focal-length-mm"),
        ({"aperture": -1.0}, "--f-number"),
        ({"tStop": -1.0}, "--f-number"),
        ({"focus": "near"}, "--focus-distance-mm"),
        ({"lens/aperture": "big"}, "--sensor-width-mm"),
    ],
)
def test_a_broken_entry_names_the_option_that_replaces_it(tmp_path, header, option):
    with pytest.raises(ImageError, match=next(iter(header))) as caught:
        camera(tmp_path / "p.exr", header)
    assert caught.value.remedy == f"mend it, or give {option}"
    word = {option.removeprefix("--").replace("-", "_"): 4.0}
    camera(tmp_path / "p.exr", header, overrides=StateOverrides(**word))


def test_what_no_frame_depends_on_stops_none(tmp_path):
    header = {**HEADER, "lens/overscan": "much", "tStop": "?"}
    found = camera(tmp_path / "p.exr", header)
    assert found.number("f_number") == 5.6
    assert set(found.bad) == {"overscan_percent", "t_number"}


@pytest.mark.parametrize(
    ("header", "said"),
    [
        ({"nominalFocalLength": 40.0, "lens/focal": 28.0}, "--focal-length-mm"),
        ({"aperture": 2.0, "lens/fstop": "2.83"}, "--f-number"),
        ({"focus": math.inf, "lens/focus": 2.0}, "--focus-distance-mm"),
        ({"lens/aperture": 36.0, "nuke/camera/haperture": 24.0}, "--sensor-width-mm"),
        ({"nominalFocalLength": 40.0, "pinholeFocalLength": 50.0}, "--focal-length-mm"),
        ({"sensorOverallDimensions": [36.0, 24.0], "lens/aperture": 40}, "--sensor-w"),
        # Rounded, the same, or told of different things.
        ({"aperture": 2.8, "lens/fstop": 2.83}, None),
        ({"lens/focal": 35.0, "cameraFocalLength": "35"}, None),
        ({"nominalFocalLength": 40.0, "pinholeFocalLength": 43.0}, None),
        (PHOTOSITES | {"sensorOverallDimensions": [36.0, 24.0]}, None),
        ({"sensorOverallDimensions": [36.0, 24.0], "lens/aperture": 20}, None),
    ],
)
def test_a_header_that_contradicts_itself_is_told(tmp_path, header, said):
    notes = camera(tmp_path / "p.1001.exr", header).notes
    if said is None:
        assert notes == ()
        return
    (note,) = notes
    assert note.startswith("p.1001.exr: the header contradicts itself")
    for part in (said, *header):
        assert part in note
    # Whoever states the value has decided it.
    stated = StateOverrides(50.0, 2.0, 2000.0, 36.0)
    assert camera(tmp_path / "p.exr", header, overrides=stated).notes == ()


@pytest.mark.slow
def test_a_contradiction_is_told_once_a_run_of_whatever_frame(tmp_path):
    for frame in (1001, 1002):
        focal = {"nominalFocalLength": 35 + frame / 1e5, "lens/focal": 28.0}
        write_plate(tmp_path / f"p.{frame}.exr", {**focal, "lens/aperture": 36.0})
    for workers in (1, 2):
        done = apply(
            make_preset(stops=()),
            tmp_path / "p.####.exr",
            tmp_path / f"out{workers}",
            options=sharp(),
            workers=workers,
        )
        assert len(done.written) == 2
        (note,) = (note for note in done.notes if "contradicts" in note)
        assert note.startswith("p.1001.exr")


def test_a_projects_aliases_count_before_the_built_in_ones(tmp_path):
    (tmp_path / "lensfit.toml").write_text(
        '[aliases]\nfocal_length_mm = {key = "my/focal", unit = "cm"}\n'
        'sensor_width_mm = "my/width"\nfocus_distance_mm = "my/focus"\n'
    )
    header = {**HEADER, "exr/my/focal": "8.5", "my/width": 24.0, "my/focus": 1500}
    found = camera(tmp_path / "p.exr", header)
    assert found.number("focal_length_mm") == 85
    assert found.number("sensor_width_mm") == 24
    assert found.number("focus_distance_mm") == 1500
    assert found.known["focal_length_mm"].source == "exr/my/focal"


def test_a_stated_settings_file_stands_alone(tmp_path):
    (tmp_path / "lensfit.toml").write_text("[camera]\nf_number = 2\n")
    other = tmp_path / "other.toml"
    other.write_text("[camera]\nfocal_length_mm = 25\n")
    found = camera(tmp_path / "p.exr", settings=other)
    assert (found.number("f_number"), found.number("focal_length_mm")) == (5.6, 25)
    with pytest.raises(SettingsError):
        camera(tmp_path / "p.exr", settings=tmp_path / "none.toml")


def test_a_settings_pull_moves_each_frame(tmp_path):
    (tmp_path / "lensfit.toml").write_text(
        "[[frames]]\nat = [1001, 1003]\nfocus_distance_mm = [1000, inf]\n"
        "sensor_width_mm = 30\n"
    )
    plates = [write_plate(tmp_path / f"p.{n}.exr") for n in (1001, 1002, 1003, 1004)]
    states = [state_of(plate)[0] for plate in plates]
    assert [s.lens_key[2] for s in states] == [1000, 2000, math.inf, 2000]
    assert [s.sensor_width_mm for s in states] == [30, 30, 30, 36]


def test_options_travel_to_workers(tmp_path):
    options = CameraOptions(
        (files.arri(tmp_path),), 1001, None, "cm", None, (1.0, 2.0, 3.0, 4.0)
    )
    assert pickle.loads(pickle.dumps(options)) == options


def test_a_missing_value_names_where_it_was_looked_for(tmp_path):
    arri = files.arri(tmp_path, {"Lens Focal Length": "--"})
    plate = write_plate(tmp_path / "p.1001.exr", {})
    applied = apply(
        make_preset(35.0, 70.0),
        plate,
        tmp_path / "out",
        options=ApplyOptions(camera=CameraOptions((arri,))),
    )
    (line,) = applied.failures
    for part in (
        "focal length",
        "lens/focal",
        str(arri),
        "--focal-length-mm",
        "p.1001",
    ):
        assert part in line


def test_a_row_that_is_missing_fails_its_frame_alone(tmp_path):
    arri = files.arri(tmp_path, PRIME, PRIME)
    for number in (1001, 1002, 1003):
        write_plate(tmp_path / f"p.{number}.exr", {})
    options = sharp(camera=CameraOptions((arri,), first_frame=1001))
    applied = apply(
        make_preset(), tmp_path / "p.####.exr", tmp_path / "out", options=options
    )
    assert len(applied.written) == 2
    (line,) = applied.failures
    assert "p.1003.exr" in line
    assert "none for 1003" in line


@pytest.mark.slow
@pytest.mark.skipif(len(os.sched_getaffinity(0)) < 2, reason="needs two cores")
def test_workers_read_the_same_sidecar(tmp_path):
    arri = files.arri(tmp_path, PRIME, PRIME)
    for number in (1001, 1002):
        write_plate(tmp_path / f"p.{number}.exr", {})
    options = sharp(camera=CameraOptions((arri,), first_frame=1001))
    plates = tmp_path / "p.####.exr"
    alone = apply(make_preset(), plates, tmp_path / "a", options=options)
    shared = apply(make_preset(), plates, tmp_path / "b", options=options, workers=2)
    assert len(alone.written) == 2
    assert alone.notes == shared.notes
    for one, other in zip(alone.written, shared.written, strict=True):
        assert one.read_bytes() == other.read_bytes()


def test_a_finished_frame_of_another_camera_is_told(tmp_path):
    plate, out = write_plate(tmp_path / "p.1001.exr"), tmp_path / "out"
    apply(make_preset(), plate, out, options=sharp())
    same = apply(make_preset(), plate, out, options=sharp())
    assert same.skipped
    (tmp_path / "lensfit.toml").write_text("[camera]\nfocus_distance_mm = 2500\n")
    other = apply(make_preset(), plate, out, options=sharp())
    assert other.written
    assert any("other settings" in note for note in other.notes)


def plate_with_depth(path, **extra):
    z = np.full((DATA.height, DATA.width), np.inf, np.float32)
    z[6 + 20 : 6 + 40, 8 + 30 : 8 + 60] = 3.0
    z[6 + 20 : 6 + 40, 8 + 30 : 8 + 35] = 1.0
    z[6 + 21, 8 + 50] = np.nan
    return write_plate(path, extra=extra | {"Z": z})


@pytest.mark.parametrize(
    ("pick", "depth_mm"),
    [
        ((45.0, 30.0), 3000),
        ((30.9, 20.0), 1000),
        # A fourth of the region is near, and more than a half is sky.
        ((0.0, 0.0, 60.0, 40.0), 3000),
        ((60.0, 40.0, 0.0, 0.0), 3000),
        ((49.0, 20.0, 52.0, 22.0), 3000),
    ],
)
def test_focus_picked_at_a_pixel_counts_from_the_sensor(tmp_path, pick, depth_mm):
    plate = plate_with_depth(tmp_path / "p.1001.exr")
    state, _ = state_of(plate, camera=CameraOptions(focus_at=pick))
    # The entrance pupil of this preset lies 50 mm in front of the sensor.
    assert state.lens_key[2] == pytest.approx(depth_mm + 50)


@pytest.mark.parametrize(
    ("pick", "said"),
    [
        ((1.0, 1.0), "only sky"),
        ((50.5, 21.5), "no depth"),
        ((96.0, 1.0), "no pixel"),
        ((-1.0, 1.0), "no pixel"),
        ((5.0, 5.0, 5.0, 9.0), "no pixel"),
    ],
)
def test_a_pick_that_finds_nothing_says_so(tmp_path, pick, said):
    plate = plate_with_depth(tmp_path / "p.1001.exr")
    with pytest.raises(ImageError, match=said):
        state_of(plate, camera=CameraOptions(focus_at=pick))


def test_a_pick_needs_depth(tmp_path):
    plate = write_plate(tmp_path / "p.1001.exr")
    with pytest.raises(ImageError, match="no depth channel"):
        state_of(plate, camera=CameraOptions(focus_at=(5.0, 5.0)))


@pytest.mark.parametrize(("kind", "factor"), [("perpendicular", 1), ("inverse", -1)])
def test_of_deep_pixels_the_nearest_that_shows_is_picked(tmp_path, kind, factor):
    counts = np.array([[3, 0]])
    samples = {name: np.full(3, 0.5, np.float32) for name in "RGB"}
    samples["A"] = np.array([0.5, 0.0, 0.5], np.float32)
    # One that shows nothing lies before the others.
    samples["Z"] = np.array([4.0, 1.0, 2.0], np.float32) ** factor
    plate = write_deep(tmp_path / "p.1.exr", counts, samples)
    depth = DepthOptions(kind=kind)
    state, _ = state_of(plate, depth=depth, camera=CameraOptions(focus_at=(0.0, 0.0)))
    assert state.lens_key[2] == pytest.approx(2050)
    with pytest.raises(ImageError, match="only sky"):
        state_of(plate, depth=depth, camera=CameraOptions(focus_at=(1.0, 0.0)))


def test_a_resumed_frame_is_picked_from_the_same_depth(tmp_path):
    plate, out = plate_with_depth(tmp_path / "p.1001.exr"), tmp_path / "out"
    options = ApplyOptions(camera=CameraOptions(focus_at=(45.0, 30.0)))
    made = apply(make_preset(), plate, out, options=options)
    said = read_exr(made.written[0], header_only=True).parts[0].attributes[SAID]
    assert "3050 mm focus" in str(said)
    again = apply(make_preset(), plate, out, options=options)
    assert (len(again.skipped), again.failures) == (1, [])
    assert not any("other settings" in note for note in again.notes)


def test_pixels_of_a_pick():
    display = Window(10, 20, 29, 39)
    assert picked_region((0, 0), display) == Window(10, 20, 10, 20)
    assert picked_region((19.9, 19.9), display) == Window(29, 39, 29, 39)
    assert picked_region((0, 0, 2, 3), display) == Window(10, 20, 11, 22)
    assert picked_region((-9, -9, 99, 99), display) == display


def test_the_pupils_offset_may_change_with_focus():
    class Breathing:
        def __init__(self, focus_mm):
            self.entrance_pupil_offset_mm = 50 + 0.001 * focus_mm

    # focus = 1000 + 50 + 0.001 focus
    assert focus_distance_from_sensor_mm(1000.0, Breathing) == pytest.approx(
        1050 / 0.999, rel=1e-6
    )  # pyright: ignore[reportArgumentType]
    assert focus_distance_from_sensor_mm(math.inf, Breathing) == math.inf  # pyright: ignore[reportArgumentType]


def test_focal_point_counts_from_the_pinhole(tmp_path):
    nuke = files.nuke(tmp_path, "focal_point 3")
    plate = write_plate(tmp_path / "p.1001.exr")
    state, notes = state_of(plate, camera=CameraOptions((nuke,)))
    assert state.lens_key[2] == pytest.approx(3050)
    assert any("focal_point" in note for note in notes)
    feet, notes = state_of(plate, camera=CameraOptions((nuke,), unit="ft"))
    assert feet.lens_key[2] == pytest.approx(3 * 304.8 + 50)
    assert not any("focal_point" in note for note in notes)


def test_inspect_tells_sources_and_what_they_overruled(tmp_path):
    arri = files.arri(tmp_path)
    write_plate(tmp_path / "p.1001.exr")
    sources = CameraSources(CameraOptions((arri,)), StateOverrides(f_number=4.0))
    (found,), errors = inspect_images([tmp_path / "p.1001.exr"], sources=sources)
    assert errors == []
    record = as_json(found)
    assert record["state"]["f_number"] == 4.0  # pyright: ignore[reportIndexIssue]
    assert record["state"]["sources"]["f_number"] == "--f-number"  # pyright: ignore
    assert record["overruled"]["focal_length_mm"] == [  # pyright: ignore
        {"value": 35.0, "source": "lens/focal"}
    ]
    rows = facts(found)
    assert ("", "35", "overruled: lens/focal") in rows
    assert rows[rows.index(("", "35", "overruled: lens/focal")) - 1][1] == "40"


def test_inspect_shows_what_only_a_preset_decides(tmp_path):
    chan = files.chan(tmp_path, f1001=40.0)
    write_plate(tmp_path / "p.1001.exr", {})
    nuke = files.nuke(tmp_path, "focal_point 3")
    sources = CameraSources(CameraOptions((chan, nuke)))
    (found,), _ = inspect_images([tmp_path / "p.1001.exr"], sources=sources)
    rows = {name: value for name, value, _ in facts(found)}
    assert rows["focus_distance_mm"] == "3000 from the pinhole"


def test_inspect_names_a_picture_that_a_sidecar_lacks(tmp_path):
    arri = files.arri(tmp_path, {}, {})
    write_plate(tmp_path / "p.1001.exr")
    sources = CameraSources(CameraOptions((arri,), first_frame=1))
    found, (error,) = inspect_images([tmp_path / "p.1001.exr"], sources=sources)
    assert found == []
    assert "none for 1001" in str(error)
