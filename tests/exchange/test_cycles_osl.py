"""The camera shader for Cycles: its numbers and its text.

Cycles itself renders through it in `tests/data_synth/bench/test_bench_cycles.py`.
"""

import json
import re

import numpy as np
import pytest
from command_line import run
from exchange_presets import SENSOR_MM, SIZE_PX, make_entry, make_preset

from lensfit.exchange.cycles_osl import cycles_osl_text
from lensfit.exchange.ray_series import fit_ray_series
from lensfit.exchange.samples import ExchangeFrame
from lensfit.preset.store import save_preset

pytestmark = pytest.mark.slow

FRAME = ExchangeFrame(SIZE_PX, SENSOR_MM[0])


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
