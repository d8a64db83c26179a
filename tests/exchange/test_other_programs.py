"""mrcal, Unreal and SynthEyes: out and back, and what other code makes of the files."""

import ast
import json
import re

import cv2
import numpy as np
import pytest
from command_line import run
from exchange_presets import SENSOR_MM, SIZE_PX, make_entry, make_lopsided, make_preset
from scipy.interpolate import BSpline, CubicSpline
from test_there_and_back import FRAME, apart_px, every_pixel_mm

from lensfit.exchange.foreign import StatedValues
from lensfit.exchange.mrcal import read_mrcal
from lensfit.exchange.syntheyes import read_syntheyes
from lensfit.preset.store import load_preset, save_preset

FILES = {
    "mrcal-opencv": "lens.cameramodel",
    "mrcal-splined": "lens.cameramodel",
    "unreal": "lens.ulens",
    "syntheyes": "lens.lni",
}


def written(folder, to, preset, *more):
    """The file, and what was said of it."""
    save_preset(preset, folder / "preset.json")
    out = folder / FILES[to]
    words = ["export", folder / "preset.json", "--to", to, "--json", "--out", out]
    done = run(*words, *more)
    assert done.exit_code == 0, done.output
    return out, json.loads(done.stdout)


def rays(preset):
    """Directions, and the pixels where they land, integers being centres."""
    lens = preset.at()
    points = every_pixel_mm()[::997]
    straight = np.asarray(lens.undistorted_from_distorted(points))
    about = straight - np.asarray(lens.distortion.principal_point_mm)
    slope = about / float(lens.distortion.principal_distance_mm)
    return np.column_stack([slope, np.ones(len(slope))]), FRAME.px(points) - 0.5


@pytest.mark.slow
@pytest.mark.parametrize("to", list(FILES))
@pytest.mark.parametrize("make", [make_preset, make_lopsided])
def test_every_pixel_is_as_far_off_as_was_said_both_ways(tmp_path, to, make):
    preset = make()
    out, said = written(tmp_path, to, preset)
    back = tmp_path / "back.json"
    done = run(
        "preset", "import", out, "--sensor-width-mm", SENSOR_MM[0], "--out", back
    )
    assert done.exit_code == 0, done.output
    mine, theirs = preset.at(), load_preset(back).at()
    residual = said["residuals"][0]
    for one, other in ((mine, theirs), (theirs, mine)):
        off = apart_px(one, other)
        assert np.sqrt(np.mean(off**2)) == pytest.approx(
            residual["rms_px"], rel=0.15, abs=0.004
        )
        assert off.max() == pytest.approx(residual["worst_px"], rel=0.15, abs=0.03)


def test_splines_hold_a_lens_that_opencv_does_not(tmp_path):
    _, closed = written(tmp_path, "mrcal-opencv", make_lopsided())
    _, splined = written(tmp_path, "mrcal-splined", make_lopsided())
    assert closed["residuals"][0]["worst_px"] > 0.1
    assert splined["residuals"][0]["worst_px"] < 0.01


def test_mrcals_splines_by_another_library(tmp_path):
    """The surfaces of the file as SciPy's B-splines."""
    preset = make_lopsided()
    out, _ = written(tmp_path, "mrcal-splined", preset)
    found = ast.literal_eval(out.read_text())
    name = found["lensmodel"]
    pattern = (
        r"LENSMODEL_SPLINED_STEREOGRAPHIC_order=3_Nx=(\d+)_Ny=(\d+)_fov_x_deg=(\d+)"
    )
    columns, rows, fov = map(int, re.fullmatch(pattern, name).groups())
    f, c = np.split(np.array(found["intrinsics"][:4]), 2)
    controls = np.array(found["intrinsics"][4:]).reshape(rows, columns, 2)
    direction, wanted = rays(preset)
    angle = np.arctan2(np.hypot(*direction[:, :2].T), direction[:, 2])
    unit = direction[:, :2] / np.linalg.norm(direction[:, :2], axis=1, keepdims=True)
    u = unit * 2 * np.tan(angle / 2)[:, None]
    per_unit = (columns - 3) / (4 * np.tan(np.radians(fov) / 4))

    def shapes(at, count):
        knots = np.arange(-2, count + 3, dtype=float)
        own = [BSpline.basis_element(knots[n : n + 5], False) for n in range(count)]
        return np.nan_to_num(np.stack([one(at) for one in own], -1))

    places = u * per_unit + (np.array([columns, rows]) - 1) / 2
    across, down = shapes(places[:, 0], columns), shapes(places[:, 1], rows)
    moved = np.einsum("nr,nc,rck->nk", down, across, controls)
    off = (u + moved) * f + c - wanted
    assert np.abs(off).max() < 0.01


def test_mrcals_closed_model_by_opencv(tmp_path):
    preset = make_preset()
    out, _ = written(tmp_path, "mrcal-opencv", preset)
    found = ast.literal_eval(out.read_text())
    assert found["lensmodel"] in ("LENSMODEL_OPENCV5", "LENSMODEL_OPENCV8")
    assert found["imagersize"] == list(SIZE_PX)
    assert found["extrinsics"] == [0.0] * 6
    fx, fy, cx, cy, *coefficients = found["intrinsics"]
    matrix = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])
    direction, wanted = rays(preset)
    landed, _ = cv2.projectPoints(
        direction, np.zeros(3), np.zeros(3), matrix, np.array(coefficients)
    )
    assert np.abs(landed[:, 0] - wanted).max() < 0.01


def test_a_file_of_mrcals_is_read(tmp_path):
    """As its own tests have them: comments, trailing commas, the older key."""
    path = tmp_path / "cam.cameramodel"
    path.write_text(
        "{\n    'lens_model':  'LENSMODEL_OPENCV4',\n    # fx,fy,cx,cy, then more\n"
        "    'intrinsics': [ 1750., 1760, 1999.5, 1099.5, -0.012, 0.035, -2e-4, 5e-4,],"
        "\n    'extrinsics': [ 2e-2, -3e-1, -1e-2,  1., 2, -3., ],\n\n"
        "    'imagersize': [ 4000, 2200 ]\n}\n"
    )
    lens = read_mrcal(path, StatedValues(sensor_width_mm=40.0))
    (state,) = lens.states
    assert lens.sensor_size_mm == (40.0, 22.0)
    assert state.principal_point_mm == pytest.approx((0, 0))
    matrix = np.array([[1750.0, 0, 1999.5], [0, 1760, 1099.5], [0, 0, 1]])
    direction = np.array([[0.3, -0.2, 1.0], [0.0, 0.4, 1.0], [-0.5, 0.1, 1.0]])
    landed, _ = cv2.projectPoints(
        direction,
        np.zeros(3),
        np.zeros(3),
        matrix,
        np.array([-0.012, 0.035, -2e-4, 5e-4]),
    )
    mm = direction[:, :2] * state.principal_distance_mm
    found_px = state.map.distorted(mm) / 0.01 + np.array([2000, 1100]) - 0.5
    assert found_px == pytest.approx(landed[:, 0], abs=1e-6)


def test_unreals_tables_are_opencvs_at_each_state(tmp_path):
    entries = make_entry(), make_entry(35.0, 3000.0)
    preset = make_preset(*entries)
    out, said = written(tmp_path, "unreal", preset)
    found = json.loads(out.read_text())
    assert [r["what"] for r in said["residuals"]] == [
        "distortion at 35 mm, focus 3000 mm",
        "distortion at 50 mm, focus 2000 mm",
    ]
    assert found["metadata"]["lensInfo"]["distortionModel"] == "Spherical"
    tables = {t["parameterName"]: t for t in found["cameraParameterTables"]}
    cells = {
        name: [[float(v) for v in row.split(",")] for row in table["data"].split(";")]
        for name, table in tables.items()
    }
    assert [row[:2] for row in cells["DistortionTable"]] == [
        [300.0, 35.0],
        [200.0, 50.0],
    ]
    width, height = SIZE_PX
    for number, (focal, focus) in enumerate(((35.0, 3000.0), (50.0, 2000.0))):
        lens = preset.at(focal, None, focus)
        (fx, fy), (cx, cy) = (
            cells[name][number][2:] for name in ("FocalLengthTable", "ImageCenterTable")
        )
        k1, k2, k3, p1, p2 = cells["DistortionTable"][number][2:]
        matrix = np.array(
            [[fx * width, 0, cx * width - 0.5], [0, fy * height, cy * height - 0.5],
             [0, 0, 1]]
        )  # fmt: skip
        points = every_pixel_mm()[::997]
        straight = np.asarray(lens.undistorted_from_distorted(points))
        about = straight - np.asarray(lens.distortion.principal_point_mm)
        slope = about / float(lens.distortion.principal_distance_mm)
        landed, _ = cv2.projectPoints(
            np.column_stack([slope, np.ones(len(slope))]), np.zeros(3), np.zeros(3),
            matrix, np.array([k1, k2, p1, p2, k3]),
        )  # fmt: skip
        off = np.linalg.norm(landed[:, 0] + 0.5 - FRAME.px(points), axis=-1)
        assert off.max() <= said["residuals"][number]["worst_px"] * 1.1 + 1e-3
    back = tmp_path / "back.json"
    assert run("preset", "import", out, "--out", back).exit_code == 0
    states = [
        (e.focal_length_mm, e.focus_distance_mm) for e in load_preset(back).entries
    ]
    assert sorted(states) == [(35.0, 3000.0), (50.0, 2000.0)]


RELATIVE = """\
<Lens title="Fish &amp; chips">
<Info><creator>by hand</creator><lin>0.05</lin></Info>
<DATA>
<sample rin="0" rout="0"/>
<sample rin="0.5" rout="0.49"/>
<sample rin="1" rout="0.95"/>
<sample rin="1.5" rout="1.36"/>
</DATA>
</Lens>
"""


def test_a_relative_table_counts_in_half_heights(tmp_path):
    path = tmp_path / "lens.lni"
    path.write_text(RELATIVE)
    lens = read_syntheyes(path, StatedValues(20.0, 30.0, size_px=(400, 200)))
    (state,) = lens.states
    assert lens.name == "Fish & chips"
    assert lens.sensor_size_mm == (20.0, 10.0)
    spline = CubicSpline([0, 0.5, 1, 1.5], [0, 0.49, 0.95, 1.36])
    for radius in (0.2, 0.5, 1.3):
        landed = state.map.distorted(np.array([[0.6, -0.8]]) * radius * 5.0)
        assert landed[0] == pytest.approx(np.array([0.6, -0.8]) * spline(radius) * 5.0)
    assert state.assumed == ("principal_distance_mm", "principal_point_mm")


@pytest.mark.parametrize(
    ("name", "text", "said"),
    [
        ("a.cameramodel", "{'lensmodel': 'LENSMODEL_CAHVOR', 'intrinsics': [1, 1],"
         " 'imagersize': [9, 9]}", "CAHVOR"),
        ("a.cameramodel", "{'lensmodel': 'LENSMODEL_OPENCV8', 'intrinsics': "
         "[9, 9, 1, 1], 'imagersize': [9, 9]}", "4 intrinsics"),
        ("a.cameramodel", "{'lensmodel': 'LENSMODEL_OPENCV4'", "dictionary"),
        ("a.cameramodel", "{'lensmodel': 'LENSMODEL_SPLINED_STEREOGRAPHIC_order=3_Nx=2_"
         "Ny=9_fov_x_deg=90', 'intrinsics': [9, 9], 'imagersize': [9, 9]}", "splines"),
        ("a.ulens", '{"metadata": {"type": "LensFile", "lensInfo": {"distortionModel": '
         '"Anamorphic"}}, "cameraParameterTables": []}', "spherical"),
        ("a.ulens", '{"metadata": {"type": "LensFile", "lensInfo": {"distortionModel": '
         '"Spherical"}}, "imageDimensions": {"width": 9, "height": 9}, '
         '"sensorDimensions": {"width": 9}, "cameraParameterTables": []}', "FocalLen"),
        ("a.lni", RELATIVE, "--size"),
        ("a.lni", RELATIVE.replace('rout="0.95"', 'rout="0.1"'), "rise"),
        ("a.lni", '<Lens mm="1"><DATA/></Lens>', "0 samples"),
    ],
)  # fmt: skip
def test_bad_files_are_one_line(tmp_path, name, text, said):
    (tmp_path / name).write_text(text)
    words = ["preset", "import", tmp_path / name, "--out", tmp_path / "out.json"]
    stated = ["--sensor-width-mm", 20]
    if said != "--size":
        stated += ["--size", "9x9", "--focal-length-mm", 20]
    done = run(*words, *stated)
    assert done.exit_code == 1, done.output
    assert done.stderr.count("\n") == 1
    assert said in done.stderr
    assert not (tmp_path / "out.json").exists()
