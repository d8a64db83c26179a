"""A sidecar that leaves out a quantity for one frame: the next source, and a note."""

import camera_files as files
import pytest
from plate_makers import make_preset, write_plate

from lensfit.plate.apply_options import ApplyOptions
from lensfit.plate.camera.sources import (
    CameraOptions,
    CameraSources,
    StateOverrides,
)
from lensfit.workflow.apply import apply

HEADER = {"lens/focal": 50.0, "lens/fstop": 5.6, "lens/focus": 3.0, "lens/aperture": 36}
FOCAL = {"Lens Focal Length": "n.a."}
STOP = {"Lens Iris": "--", "Lens Linear Iris": "--"}


def camera(frame, *rows, overrides=None, **options):
    sources = CameraSources(
        CameraOptions(files=rows, first_frame=1001, **options), overrides
    )
    return sources.of_plate(f"p.{frame}.exr", HEADER, (96, 64))


@pytest.mark.parametrize(
    ("marked", "said"),
    [
        (
            FOCAL,
            "arri.csv states no focal length for frame 1003, as it does for others; "
            "lens/focal (50 mm) of the header is used (--focal-length-mm states "
            "another)",
        ),
        (
            STOP,
            "arri.csv states no f-number for frame 1003, as it does for others; "
            "lens/fstop (5.6) of the header is used (--f-number states another)",
        ),
        (
            {"Lens Focus Distance": "--"},
            "arri.csv states no focus distance for frame 1003, as it does for others; "
            "lens/focus (3000 mm) of the header is used (--focus-distance-mm states "
            "another)",
        ),
    ],
)
def test_the_frame_that_falls_to_the_header_is_told(tmp_path, marked, said):
    table = files.arri(tmp_path, {}, {}, marked)
    assert [n for n in camera(1003, table).notes if "states no" in n] == [said]
    assert not any("states no" in n for n in camera(1002, table).notes)


def test_what_no_row_states_and_what_a_better_source_states_is_no_jump(tmp_path):
    never = files.arri(tmp_path, FOCAL, FOCAL, name="never.csv")
    once = files.arri(tmp_path, {}, FOCAL)
    stated = StateOverrides(focal_length_mm=35.0)
    for found in (camera(1002, never), camera(1002, once, overrides=stated)):
        assert not any("states no" in n for n in found.notes)


def test_the_sidecar_that_counts_in_its_place_is_named(tmp_path):
    first = files.arri(tmp_path, {}, FOCAL, name="first.csv")
    second = files.arri(tmp_path, {}, {}, name="second.csv")
    (note,) = [n for n in camera(1002, first, second).notes if "states no" in n]
    assert note.startswith("first.csv states no focal length for frame 1002")
    assert "second.csv line 3, Lens Focal Length (40 mm) is used" in note
    assert not any("states no" in n for n in camera(1002, second, first).notes)


def test_a_run_is_told_once(tmp_path):
    rows = [{"Lens Focal Length": f} for f in ("35.000", "n.a.", "n.a.")]
    table = files.arri(tmp_path, *rows)
    header = {**HEADER, "lens/focal": 35.0, "lens/fstop": 2.8, "lens/aperture": 36.0}
    for number in (1001, 1002, 1003):
        write_plate(tmp_path / f"p.{number}.exr", header)
    options = ApplyOptions(camera=CameraOptions(files=(table,), first_frame=1001))
    applied = apply(
        make_preset(), tmp_path / "p.####.exr", tmp_path / "out", options=options
    )
    told = [n for n in applied.notes if "states no" in n]
    assert len(told) == 1
    assert "for frame 1002" in told[0]
