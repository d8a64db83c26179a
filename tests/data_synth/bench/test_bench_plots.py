"""Error against time of fit, warp and render: every method, with its figures."""

import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from skimage.io import imread

from data_synth.bench import plot, warp

SETS = {"small": (0.02, 0.7), "large": (0.3, 1.2)}


def rows():
    """As `bench_fit` has them, with a set that has no peers."""
    found = []
    for name, (error, seconds) in SETS.items():
        peers = {"OpenCV 14": 1.5 * error}
        what = "held-out reprojection, px rms"
        found.append({"set": name, "what": what, "value": error, "peers": peers})
        peers = {"OpenCV 14": seconds / 10, "first": 9.0, "spread": 0.1}
        what = "geometric fit, s"
        found.append({"set": name, "what": what, "value": seconds, "peers": peers})
    straight = "straightness of lines, px rms"
    found.append({"set": "lines", "what": straight, "value": 0.1, "peers": {}})
    return found


@pytest.fixture
def drawn(monkeypatch):
    """Curves by name, as they go to the picture."""
    kept = {}

    def keep(curves, path, **_):
        kept.update({curve.name: curve for curve in curves})
        return path

    for module in (plot, warp):
        monkeypatch.setattr(module, "write_curves", keep)
    return kept


def test_a_fit_has_a_curve_for_every_method_over_the_sets(drawn):
    plot.write_fit_plot(rows(), Path())
    assert set(drawn) == {"lensfit", "OpenCV 14"}
    assert drawn["lensfit"].seconds == [0.7, 1.2]
    assert drawn["lensfit"].labels == ("small", "large")
    assert drawn["OpenCV 14"].errors == pytest.approx([0.03, 0.45])


def test_sets_without_peers_draw_nothing(drawn):
    assert plot.write_fit_plot(rows()[-1:], Path()) is None
    assert not drawn


def test_the_picture_of_a_fit_can_be_opened(tmp_path):
    path = plot.write_fit_plot(rows(), tmp_path)
    assert path is not None
    with Image.open(path) as picture:
        assert picture.format == "PNG"


@pytest.mark.slow
def test_a_warp_has_a_curve_for_every_method(drawn, monkeypatch, tmp_path):
    monkeypatch.setitem(warp.SIZES, "HD", (160, 90))
    result = warp.bench_warp(tmp_path, quick=True)
    points = {point["method"]: point for point in result["curves"]["warp"]}
    assert set(drawn) == set(points)
    assert drawn["lensfit cubic"].seconds == [points["lensfit cubic"]["seconds"]]
    written = json.loads((tmp_path / "bench_warp.json").read_text())
    assert written["curves"] == result["curves"]


RENDER_ROWS = [
    {
        "set": "plate",
        "what": "PSNR, dB",
        "peers": {"no defocus": 24.7, "layered discs": 33.1, "without mattes": 36.8},
    },
    {
        "set": "plate",
        "what": "seconds",
        "peers": {"processor": 0.7, "layered discs": 0.8},
    },
]
RENDER_CURVE = [
    {"tolerance": 1e-3, "seconds": 0.6, "psnr_db": 36.8},
    {"tolerance": 1e-2, "seconds": 0.3, "psnr_db": 35.4},
]


def test_peers_come_with_their_seconds_where_they_took_any():
    found = {"no defocus": (None, 24.7), "layered discs": (0.8, 33.1)}
    assert plot.peers_of(RENDER_ROWS) == found


def test_the_picture_of_a_render_has_something_on_it(tmp_path):
    path = plot.write_render_plot(
        {"rows": RENDER_ROWS, "curves": {"plate": RENDER_CURVE}}, tmp_path
    )
    picture = imread(path)[..., :3]
    assert picture.shape[0] > 400
    assert np.mean(picture < 200) > 0.005
