"""A USD camera out and back, read by Pixar's own library."""

import json

import numpy as np
import pytest
from command_line import run
from exchange_presets import SENSOR_MM, SIZE_PX, make_lopsided, make_preset
from test_there_and_back import FRAME, apart_px, every_pixel_mm

from lensfit.exchange.opencv import opencv_distorted
from lensfit.preset.store import load_preset, save_preset

pytest.importorskip("pxr", reason="usd-core is not installed")


@pytest.fixture(params=["round", "lopsided"])
def exported(request, tmp_path):
    preset = make_preset() if request.param == "round" else make_lopsided()
    save_preset(preset, tmp_path / "preset.json")
    words = ["export", tmp_path / "preset.json", "--to", "usd", "--json"]
    words += ["--out", tmp_path / "camera.usda", "--f-number", "2.8"]
    done = run(*words, "--sensor-width-mm", SENSOR_MM[0])
    assert done.exit_code == 0, done.output
    return tmp_path, preset, json.loads(done.stdout)["residuals"][0]


def camera_of(path):
    from pxr import Usd

    stage = Usd.Stage.Open(str(path))
    return stage, stage.GetDefaultPrim()


def test_every_pixel_is_as_far_off_as_was_said_both_ways(exported):
    folder, preset, said = exported
    back = run("preset", "import", folder / "camera.usda", "--out", folder / "b.json")
    assert back.exit_code == 0, back.output
    mine, theirs = preset.at(), load_preset(folder / "b.json").at()
    for one, other in ((mine, theirs), (theirs, mine)):
        off = apart_px(one, other)
        assert np.sqrt(np.mean(off**2)) == pytest.approx(
            said["rms_px"], rel=0.1, abs=0.002
        )
        assert off.max() == pytest.approx(said["worst_px"], rel=0.1, abs=0.02)


def test_the_frustum_is_that_of_the_undistorted_picture(exported):
    """USD's own camera shows a point where the pinhole of the lens puts it."""
    from pxr import Gf, UsdGeom

    folder, preset, _ = exported
    _, prim = camera_of(folder / "camera.usda")
    frustum = UsdGeom.Camera(prim).GetCamera().frustum
    lens = preset.at()
    rays = np.array([[0.0, 0.0], [0.2, -0.15], [-0.3, 0.2], [0.1, 0.25]])
    onto = frustum.ComputeViewMatrix() * frustum.ComputeProjectionMatrix()
    for x, y in rays:
        seen = onto.Transform(Gf.Vec3d(100 * x, -100 * y, -100))
        share = np.array([seen[0], -seen[1]]) / 2
        wanted = np.array(lens.distortion.principal_point_mm) + np.array(
            [x, y]
        ) * float(lens.distortion.principal_distance_mm)
        np.testing.assert_allclose(share * np.array(SENSOR_MM), wanted, atol=1e-4)


def test_numbers_are_those_of_the_schema(exported):
    """Pixels from the corner, twelve coefficients, an f-stop and the focus distance
    from the entrance pupil, all of the type that NVIDIA's schema has."""
    folder, preset, _ = exported
    stage, prim = camera_of(folder / "camera.usda")
    assert stage.GetMetadata("metersPerUnit") == 0.01
    applied = prim.GetPrimTypeInfo().GetAppliedAPISchemas()
    assert applied == ["OmniLensDistortionOpenCvPinholeAPI"]
    prefix = "omni:lensdistortion:opencvPinhole:"
    names = [
        a.GetName() for a in prim.GetAttributes() if a.GetName().startswith(prefix)
    ]
    kinds = {str(prim.GetAttribute(n).GetTypeName()) for n in names}
    assert kinds == {"float", "int2"}
    get = {n.removeprefix(prefix): prim.GetAttribute(n).Get() for n in names}
    assert len(get) == 12 + 4 + 1
    assert tuple(get["imageSize"]) == SIZE_PX
    assert prim.GetAttribute("fStop").Get() == pytest.approx(2.8)
    lens = preset.at()
    focus_mm = lens.focus_distance_mm - float(lens.entrance_pupil_offset_mm)
    assert prim.GetAttribute("focusDistance").Get() == pytest.approx(focus_mm / 10)
    # By the formula of OpenCV, from corner to corner of the picture.
    order = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6", "s1", "s2", "s3", "s4")
    coefficients = np.array([*(get[n] for n in order), 0.0, 0.0])
    points = every_pixel_mm()[:: SIZE_PX[0] * 20 + 37]
    straight = np.asarray(lens.undistorted_from_distorted(points))
    middle = np.asarray(lens.distortion.principal_point_mm)
    rays = (straight - middle) / float(lens.distortion.principal_distance_mm)
    bent = opencv_distorted(rays, coefficients)
    px = bent * [get["fx"], get["fy"]] + [get["cx"], get["cy"]]
    wanted = points / FRAME.pitch_mm + np.array(SIZE_PX) / 2
    assert np.abs(px - wanted).max() < 0.6


def test_what_is_no_camera_with_a_lens_is_one_line(exported):
    from pxr import Usd, UsdGeom

    folder, _, _ = exported
    stage = Usd.Stage.CreateNew(str(folder / "bare.usdc"))
    UsdGeom.Camera.Define(stage, "/shot/camera")
    stage.Save()
    two = (folder / "camera.usda").read_text()
    second = two[two.index("def Camera") :].replace('"Camera" (', '"Witness" (', 1)
    (folder / "two.usda").write_text(two + second)
    (folder / "cut.usda").write_text(two[: len(two) // 2])
    broken = two.replace("opencvPinhole:fx = ", "opencvPinhole:fx = -")
    (folder / "negative.usda").write_text(broken)
    for name, said in (
        ("bare.usdc", "has 1 cameras, and none with OpenCV's lens"),
        ("two.usda", "say which with --lens"),
        ("cut.usda", "cannot be read"),
        ("negative.usda", "fx = "),
    ):
        done = run("preset", "import", folder / name, "--out", folder / "no.json")
        assert done.exit_code == 1
        (line,) = done.stderr.strip().splitlines()
        assert name in line
        assert said in line
        assert not (folder / "no.json").exists()
    words = ["--lens", "Witness", "--out", folder / "w.json"]
    assert run("preset", "import", folder / "two.usda", *words).exit_code == 0
