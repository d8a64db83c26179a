"""The camera shader for Cycles: its numbers, its text, and Blender itself.

Where `LENSFIT_BPY_PYTHON` names a Python that has Blender's `bpy` (or this one has it),
Cycles renders through the shader, and what it shows is compared with the lens.
"""

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from exchange_presets import SENSOR_MM, SIZE_PX, make_entry, make_preset
from typer.testing import CliRunner

from lensfit.cli.main import app
from lensfit.exchange.cycles_osl import cycles_osl_text
from lensfit.exchange.ray_series import fit_ray_series
from lensfit.exchange.samples import ExchangeFrame
from lensfit.preset.store import load_preset, save_preset

ROOT = Path(__file__).parents[2]
PRIME = ROOT / "presets" / "prime_50" / "preset.json"
FRAME = ExchangeFrame(SIZE_PX, SENSOR_MM[0])
BPY = os.environ.get("LENSFIT_BPY_PYTHON", sys.executable)


def run(*words):
    return CliRunner().invoke(app, [str(word) for word in words])


@pytest.fixture(scope="module")
def perfect():
    """A lens whose blur nobody measured, and its sums."""
    lens = make_preset(make_entry()).at(50.0, 4.0, 2000.0)
    made, _ = fit_ray_series(lens, FRAME)
    return lens, made


@pytest.fixture(scope="module")
def positions_mm():
    x, y = (np.linspace(-0.45, 0.45, n) for n in (7, 5))
    return np.stack(np.meshgrid(x, y), -1).reshape(-1, 2) * SENSOR_MM


@pytest.mark.parametrize("channel", ["r", "g", "b"])
def test_rays_through_the_middle_are_chief_rays(perfect, positions_mm, channel):
    lens, made = perfect
    middle = np.zeros_like(positions_mm)
    number = "rgb".index(channel)
    tangent, crossing = made.rays(positions_mm, middle, number, 0)
    assert np.abs(crossing).max() < 0.05
    far_mm = 5e6 * np.column_stack([tangent, np.ones(len(tangent))])
    landed = np.asarray(lens.project(far_mm, channel))
    off_px = np.linalg.norm(FRAME.px(landed) - FRAME.px(positions_mm), axis=-1)
    assert off_px.max() < 0.02


def test_rays_fill_the_entrance_pupil_and_meet_in_focus(perfect):
    """Seen from the scene the pupil is a disc as wide as the blur of depth needs; on
    the axis all its rays go to one point at the focus distance."""
    lens, made = perfect
    turn = np.linspace(0, 2 * np.pi, 12, endpoint=False)
    rim = np.stack([np.cos(turn), np.sin(turn)], -1)
    axis = np.broadcast_to(np.asarray(lens.distortion.principal_point_mm), rim.shape)
    tangent, crossing = made.rays(axis, rim, 1, 0)
    per_vergence_mm2, sharp_per_mm = lens.blur_per_vergence()
    c = float(lens.distortion.principal_distance_mm)
    assert np.allclose(
        np.linalg.norm(crossing, axis=-1), per_vergence_mm2 / c, rtol=2e-3
    )
    met = tangent + sharp_per_mm * crossing
    assert np.ptp(met, axis=0).max() * c / FRAME.pitch_mm < 0.02


def test_light_is_the_fall_off(perfect, positions_mm):
    lens, made = perfect
    number = np.arange(4000)
    turn, reach = number * 2.399963, np.sqrt((number + 0.5) / len(number))
    places = np.stack([reach * np.cos(turn), reach * np.sin(turn)], -1)
    for point in positions_mm[::4]:
        same = np.broadcast_to(point, places.shape)
        for channel in "rgb":
            mean = made.light(same, places, "rgb".index(channel)).mean()
            wanted = float(lens.relative_illumination(point[None], channel)[0])
            assert mean == pytest.approx(wanted, rel=0.01)


def test_the_text_holds_these_sums(perfect, positions_mm):
    """Tables and loops of the source, evaluated by themselves."""
    _, made = perfect
    text = cycles_osl_text(made, "a lens\nin lines")
    assert text.startswith("// a lens\n// in lines\nshader lensfit_camera(")
    places = 0.7 * positions_mm / np.array(SENSOR_MM) * 2
    tables = {
        "on_frame": positions_mm / np.array(made.half_mm),
        "in_stop": places,
    }
    products = {}
    for name, at in tables.items():
        degrees = re.findall(rf"{name}\[(\d+)\] = tx\[(\d+)\] \* ty\[(\d+)\];", text)
        order = [int(n) for n, _, _ in degrees]
        assert order == list(range(len(order)))
        most = max(int(d) for _, *pair in degrees for d in pair)
        table = np.polynomial.chebyshev.chebvander(at, most)
        products[name] = np.stack(
            [table[:, 0, int(a)] * table[:, 1, int(b)] for _, a, b in degrees], -1
        )
    loops = re.findall(
        r"int i\[\d+\] = \{(.*?)\};\s+int j\[\d+\] = \{(.*?)\};"
        r"((?:\s+float v\d\[\d+\] = \{.*?\};)+)",
        text,
    )
    assert len(loops) == 1 + 3 * 3
    sums = []
    for i, j, values in loops:
        shapes = products["on_frame"][:, np.array(i.split(","), int)]
        shapes = shapes * products["in_stop"][:, np.array(j.split(","), int)]
        columns = re.findall(r"\{(.*?)\}", values)
        sums.append([shapes @ np.array(c.split(","), float) for c in columns])
    for channel in range(3):
        x, y, _ = sums[1 + 3 * channel : 4 + 3 * channel]
        tangent, crossing = made.rays(positions_mm, places, channel, -1)
        for axis, part in enumerate((x, y)):
            assert np.allclose(part[0] - part[1], tangent[:, axis], atol=1e-7)
            assert np.allclose(part[2] - part[3], crossing[:, axis], atol=1e-5)


def test_it_is_exported_with_its_residuals(tmp_path):
    save_preset(make_preset(make_entry()), tmp_path / "lens.json")
    out = tmp_path / "lens.osl"
    words = ["export", tmp_path / "lens.json", "--to", "cycles-osl", "--json"]
    done = run(*words, "--out", out, "--f-number", "4")
    assert done.exit_code == 0, done.output
    found = json.loads(done.stdout)
    assert found["residuals"][0]["worst_px"] < 0.05
    assert found["residuals"][1]["worst_px"] < 0.2
    assert found["residuals"][2]["worst_light"] < 0.01
    assert any("diffract" in note for note in found["notes"])
    assert "at f/4" in out.read_text()


def test_without_an_f_number_it_says_what_to_give(tmp_path):
    plain = make_entry(fall_off=())
    save_preset(make_preset(plain), tmp_path / "lens.json")
    words = ["export", tmp_path / "lens.json", "--to", "cycles-osl"]
    done = run(*words, "--out", tmp_path / "lens.osl")
    assert done.exit_code == 1
    assert done.stderr.count("\n") == 1
    assert "--f-number" in done.stderr
    assert not (tmp_path / "lens.osl").exists()


def has_bpy() -> bool:
    found = subprocess.run([BPY, "-c", "import bpy"], capture_output=True, check=False)
    return found.returncode == 0


@pytest.fixture(scope="module")
def blender(tmp_path_factory):
    """Renders through a shader: a picture (rows, columns, 3)."""
    if not has_bpy():
        pytest.skip(
            "Blender's bpy is not installed; LENSFIT_BPY_PYTHON names its Python"
        )
    folder = tmp_path_factory.mktemp("blender")

    def render(shader: Path, size_px, width_mm: float, **wanted):
        import OpenEXR

        out = folder / "picture.exr"
        request = {"shader": str(shader), "out": str(out), "size_px": size_px}
        request |= {"sensor_width_mm": width_mm} | wanted
        (folder / "request.json").write_text(json.dumps(request))
        scene = Path(__file__).parent / "blender_scene.py"
        done = subprocess.run(
            [BPY, scene, folder / "request.json"], capture_output=True, text=True
        )
        assert "error:" not in done.stderr, done.stderr
        channels = OpenEXR.File(str(out)).channels()
        pixels = channels["RGB" if "RGB" in channels else "RGBA"].pixels
        out.unlink()
        return np.asarray(pixels, float)[..., :3]

    return render


SMALL = (400, 300)


@pytest.fixture(scope="module")
def prime(tmp_path_factory):
    """The bundled prime at f/2 and f/8 with its shaders, for small pictures."""
    preset, found = load_preset(PRIME), {}
    for stop in (2.0, 8.0):
        shader = tmp_path_factory.mktemp("shader") / "lens.osl"
        words = ["export", PRIME, "--to", "cycles-osl", "--size", "400x300"]
        words += ["--focal-length-mm", 50, "--focus-distance-mm", 2000]
        done = run(*words, "--f-number", stop, "--out", shader)
        assert done.exit_code == 0, done.output
        found[stop] = preset.at(50.0, stop, 2000.0), shader
    return preset.camera.sensor_width_mm, found


@pytest.mark.slow
def test_cycles_shows_a_chart_where_the_lens_does(blender, prime):
    width_mm, shaders = prime
    lens, shader = shaders[8.0]
    frame = ExchangeFrame(SMALL, width_mm)
    c, pupil = (
        float(lens.distortion.principal_distance_mm),
        float(lens.entrance_pupil_offset_mm),
    )
    ahead = 2000.0 - pupil
    x, y = (np.linspace(-0.42, 0.42, n) for n in (5, 3))
    dots = np.stack(np.meshgrid(x, y), -1).reshape(-1, 2) * frame.area_mm * ahead / c
    radius = 4 * frame.pitch_mm * ahead / c
    discs = [[*dot, ahead, radius] for dot in dots.tolist()]
    picture = blender(shader, SMALL, width_mm, samples=400, discs=discs)
    objects = np.column_stack([dots, np.full(len(dots), 2000.0)])
    for channel in "rgb":
        wanted = frame.px(np.asarray(lens.project(objects, channel)))
        for at in wanted:
            left, top = (at - 12).astype(int)
            near = picture[top : top + 24, left : left + 24, "rgb".index(channel)]
            rows, columns = np.mgrid[top : top + 24, left : left + 24] + 0.5
            found = [(near * part).sum() / near.sum() for part in (columns, rows)]
            assert np.hypot(*(found - at)) < 0.05


@pytest.mark.slow
def test_cycles_shows_the_fall_off(blender, prime):
    width_mm, shaders = prime
    lens, shader = shaders[2.0]
    frame = ExchangeFrame(SMALL, width_mm)
    picture = blender(shader, SMALL, width_mm, samples=64, sky=1.0)
    cells = picture.reshape(10, 30, 10, 40, 3).mean((1, 3))
    rows, columns = np.mgrid[0:300, 0:400] + 0.5
    at_mm = frame.mm(np.column_stack([columns.ravel(), rows.ravel()]))
    for channel in "rgb":
        light = np.asarray(lens.relative_illumination(at_mm, channel))
        wanted = light.reshape(10, 30, 10, 40).mean((1, 3))
        assert np.abs(cells[..., "rgb".index(channel)] / wanted - 1).max() < 0.01


@pytest.mark.slow
@pytest.mark.parametrize(
    ("at", "distance_mm"), [((0.6, 0.5), 2600.0), ((0.5, -0.6), 1700.0)]
)
def test_cycles_blurs_a_light_as_the_lens_does(blender, prime, at, distance_mm):
    width_mm, shaders = prime
    lens, shader = shaders[2.0]
    frame, size, finer = ExchangeFrame(SMALL, width_mm), 25, 3
    landed_mm = np.array(at) * frame.area_mm / 2
    c = float(lens.distortion.principal_distance_mm)
    ahead = distance_mm - float(lens.entrance_pupil_offset_mm)
    point = np.array([*landed_mm / c * ahead, distance_mm])
    for _ in range(20):
        moved = landed_mm - np.asarray(lens.project(point[None]))[0]
        point[:2] += moved / c * ahead
    corner = np.floor(frame.px(landed_mm[None])[0]).astype(int) - size // 2
    radius = frame.pitch_mm * ahead / c
    picture = blender(
        shader, SMALL, width_mm,
        samples=8192,
        discs=[[*point[:2], ahead, radius]],
        region=[*corner.tolist(), *(corner + size).tolist()],
    )  # fmt: skip
    number = np.arange(19)
    turn, reach = 2.4 * number, radius * np.sqrt((number + 0.5) / 19)
    lights = np.tile(point, (19, 1))
    lights[:, :2] += np.stack([reach * np.cos(turn), reach * np.sin(turn)], -1)
    chief = np.asarray(lens.project(lights))
    room = size + 9
    kernels = np.asarray(
        lens.psfs(
            chief, distance_mm, pixel_pitch_mm=frame.pitch_mm / finer,
            size_px=room * finer,
        )
    )  # fmt: skip
    for number, name in enumerate("rgb"):
        wanted = np.zeros((size * finer, size * finer))
        for place, kernel in zip(frame.px(chief), kernels[:, number], strict=True):
            shift = np.round(((place - corner) - room / 2) * finer).astype(int)
            rows, columns = (np.arange(size * finer) - s for s in (shift[1], shift[0]))
            wanted += kernel[np.ix_(rows, columns)]
        wanted = wanted.reshape(size, finer, size, finer).sum((1, 3))
        found = picture[..., number] / picture[..., number].sum()
        wanted /= wanted.sum()
        apart = np.linalg.norm(found - wanted) / np.linalg.norm(wanted)
        assert apart < 0.1, (name, apart)
