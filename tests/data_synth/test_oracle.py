"""Another ray tracer's folder read as ours: axes, spots about chief rays, fall-off."""

import json

import numpy as np
import pytest

from data_synth.judge import geometry_figures
from data_synth.oracle import oracle_truth, write_oracle_shoot
from data_synth.psf_truth import read_truth

PITCH_MM = 0.01
WIDTH, HEIGHT = 400, 300
CHART_MM = 1000.0
PX_PER_MM = {"in": 2.0, "near": 2.1, "far": 1.9}
FIELD_MM = np.array([[0.0, 0.0], [30.0, 20.0]])
STOPS = (1.4, 2.8)


def landed(place_mm, state, channel):
    """Pixels of chief rays: y of the chart runs up, red a little larger."""
    scale = PX_PER_MM[state] * (1.01, 1.0, 1.0)[channel]
    middle = np.array([WIDTH / 2, HEIGHT / 2])
    return middle + np.asarray(place_mm) * [scale, -scale]


def dots_of(state):
    rows = []
    for j in range(-11, 12):
        for i in range(-13, 14):
            place = (7.0 * i, 7.0 * j)
            chief = np.concatenate([landed(place, state, c) for c in range(3)])
            rows.append([i, j, *place, *chief, *chief, 1.0, 1.0, 1.0])
    return rows


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("oracle")
    plan = {"D": CHART_MM, "near": 800.0, "far": 1300.0, "stops": STOPS, "focal": "20"}
    frame = {"W": WIDTH, "H": HEIGHT, "pitch_mm": PITCH_MM}
    about = {"plan": plan, "frame": frame}
    (folder / "truth_lens.json").write_text(json.dumps(about))
    for state in PX_PER_MM:
        (folder / f"dots_f1p4_{state}_truth.json").write_text(
            json.dumps({"dots": dots_of(state)})
        )
    x_mm, y_mm = np.linspace(0, 2, 3), np.linspace(0, 1.5, 4)
    light = 1 - 0.1 * x_mm[:, None] - 0.01 * y_mm[None]
    np.savez(
        folder / "truth_tables.npz",
        ri_x_mm=x_mm, ri_y_mm=y_mm, ri_f1p4=light, ri_f2p8=0.25 * light,
    )  # fmt: skip
    index, data = [], []
    for k, state in enumerate(PX_PER_MM):
        for stop in STOPS:
            for field, place in enumerate(FIELD_MM):
                for channel in range(3):
                    corner = np.round(4 * landed(place, state, channel)) - [3, 5]
                    spot = np.zeros((7, 9), np.uint16)
                    spot[5, 3] = 10
                    index.append(
                        [k, stop, field, channel, 4, *corner, 7, 9, len(data), 1.0]
                    )
                    data += spot.ravel().tolist()
    np.savez(
        folder / "truth_psf.npz",
        index=np.array(index), data=np.array(data, np.uint16), field_obj_mm=FIELD_MM,
    )  # fmt: skip
    (folder / "shoot.toml").write_text('[[take]]\nimage = "dots.exr"\n')
    (folder / "dots.exr").write_bytes(b"a photograph")
    return folder


def test_every_setting_was_photographed(folder):
    truth = oracle_truth(folder)
    settings = [
        (g.f_number, g.focus_distance_mm, g.object_distance_mm) for g in truth.groups
    ]
    focus = (CHART_MM, 800.0, 1300.0)
    assert settings == [(n, s, CHART_MM) for s in focus for n in STOPS]
    assert all(group.photographed for group in truth.groups)
    assert truth.frame.size_px == (WIDTH, HEIGHT)


def test_chief_rays_are_upright(folder):
    """An object to the right of and below the axis lands right and below."""
    truth = oracle_truth(folder)
    assert truth.chief_mm.shape == (3, 143, 3, 2)
    upper_left = truth.chief_object_mm[0]
    np.testing.assert_allclose(upper_left, [-12 * 7.0, -10 * 7.0, CHART_MM])
    for k, scale in enumerate(PX_PER_MM.values()):
        expected = truth.chief_object_mm[:, :2] * scale * PITCH_MM
        np.testing.assert_allclose(truth.chief_mm[k, :, 1], expected, atol=1e-9)
        np.testing.assert_allclose(truth.chief_mm[k, :, 0], 1.01 * expected, atol=1e-9)
        field = FIELD_MM * [1, -1] * scale * PITCH_MM
        np.testing.assert_allclose(truth.spot_chief_mm[2 * k], field, atol=1e-6)


def test_spots_lie_about_the_green_chief_ray(folder):
    truth = oracle_truth(folder)
    for spots, group in zip(truth.psf, truth.groups, strict=True):
        assert spots.shape == (2, 3, group.size, group.size)
        np.testing.assert_allclose(spots.sum((2, 3)), 1)
        # The sample whose corner is nearest to the chief ray; red lands further out.
        at = np.argwhere(spots[:, 1] > 0)[:, 1:] - group.size // 2
        np.testing.assert_array_equal(at, [[0, 0], [0, 0]])
        state = {CHART_MM: "in", 800.0: "near", 1300.0: "far"}[group.focus_distance_mm]
        red = np.round(4 * landed(FIELD_MM[1], state, 0))
        green = np.round(4 * landed(FIELD_MM[1], state, 1))
        row, column = np.argwhere(spots[1, 0] > 0)[0] - group.size // 2
        np.testing.assert_array_equal([column, row], red - green)


def test_fall_off_is_mirrored_to_the_whole_frame(folder):
    truth = oracle_truth(folder)
    places, light = truth.light_mm[1], truth.light[1]
    assert places.min(0).tolist() == [-2.0, -1.5]
    expected = 0.25 * (1 - 0.1 * abs(places[:, 0]) - 0.01 * abs(places[:, 1]))
    np.testing.assert_allclose(light[:, 1], expected)
    assert np.isnan(light[:, [0, 2]]).all()
    worst = geometry_figures(lambda *_: Darker(), truth)["illumination_worst"]
    assert worst["f2.8_focus1000"] < 1e-12


class Darker:
    """The lens of the folder, its red and blue all wrong."""

    def project(self, object_points_mm, channel="g"):
        return np.asarray(object_points_mm)[:, :2] * 0.02

    def relative_illumination(self, points_mm, channel="g"):
        x, y = np.abs(np.asarray(points_mm)).T
        return (1 - 0.1 * x - 0.01 * y) if channel == "g" else 0.3 + 0.01 * x


def test_photographs_are_copied_and_truth_is_written(folder, tmp_path):
    write_oracle_shoot(folder, tmp_path / "dg")
    assert (tmp_path / "dg" / "dots.exr").read_bytes() == b"a photograph"
    assert len(read_truth(tmp_path / "dg").groups) == 6
    with pytest.raises(OSError, match=r"shoot\.toml"):
        write_oracle_shoot(tmp_path / "nowhere", tmp_path / "other")
