"""Peers, takes left out and efforts beside a calibration: what is asked; its rows."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
from skimage.io import imread
from wrong_usage import told_of_wrong_usage

from data_synth.bench.peers.fitted import Peer, simple_peers
from data_synth.bench.plot import curves_of, write_psf_plot
from data_synth.bench.wavefront import beside as module
from data_synth.bench.wavefront.beside import Beside, Seen, add_figures
from data_synth.bench.wavefront.rows import wavefront_rows
from lensfit.errors import FitError, ShootError

CHART_MM = 2000.0


def take_named(name, f_number, target_mm=CHART_MM, dot_images="pictures"):
    return SimpleNamespace(
        name=name,
        f_number=f_number,
        focus_distance_mm=1430.0,
        target_distance_mm=target_mm,
        dot_images=dot_images,
    )


TAKES = {
    "wide.exr": take_named("wide.exr", 1.4),
    "small.exr": take_named("small.exr", 2.8),
    "tilted.exr": take_named("tilted.exr", 1.4, None),
    "lines.exr": take_named("lines.exr", 8.0, dot_images=None),
}


@pytest.fixture
def seen(monkeypatch):
    """What is seen of a shoot whose fits only tell what they were given."""
    takes = [SimpleNamespace(image=name) for name in TAKES]
    observed = [SimpleNamespace(image=n, take=t) for n, t in TAKES.items()]
    spent = {"seconds": 4.0, "cpu_seconds": 3.0}

    def refitted(_, given, **asked):
        assert given is observed
        return Peer(("lensfit", asked), spent)

    def simple(given):
        names = tuple(take.name for take in given)
        return {"gaussians": Peer(("gaussians", names), spent)}

    monkeypatch.setattr(module, "refitted", refitted)
    monkeypatch.setattr(module, "simple_peers", simple)
    return Seen(SimpleNamespace(takes=takes, path="shoot.toml"), observed)


def found_by(seen, **wanted):
    judged, found = [], {}

    def spots(lens, folder, only=None):
        judged.append((lens, only))
        return {"median": 0.1, "p90": 0.2} if only else {"all": {}}

    add_figures(found, Beside(spots, **wanted), seen, "folder")
    return found, judged


def test_every_take_of_a_stated_setting_is_left_out_in_turn(seen):
    found, judged = found_by(seen, leave_out=("each",))
    assert list(found["left_out"]) == ["wide.exr", "small.exr"]
    assert judged == [
        (("lensfit", {"without": name}), (f_number, 1430.0, CHART_MM))
        for name, f_number in (("wide.exr", 1.4), ("small.exr", 2.8))
    ]


def test_peers_do_not_see_the_take_either(seen):
    found, judged = found_by(seen, leave_out=("small",), peers=True)
    assert set(found["peers"]) == {"gaussians", "Seidel only"}
    assert found["peers"]["gaussians"]["cpu_seconds"] == 3.0
    assert (("lensfit", {"seidel_only": True}), None) in judged
    assert list(found["left_out"]) == ["small.exr"]
    lens, only = judged[-1]
    assert lens == ("gaussians", ("wide.exr", "tilted.exr", "lines.exr"))
    assert only == (2.8, 1430.0, CHART_MM)
    assert list(found["left_out"]["small.exr"]["peers"]) == ["gaussians"]


def test_a_take_that_does_not_exist_is_told_before_anything_is_fitted(seen):
    with pytest.raises(ShootError, match="no take is called nosuch") as told:
        found_by(seen, leave_out=("nosuch",), peers=True)
    assert "wide, small, tilted, lines, or each" in str(told.value)


def test_peers_need_stated_settings():
    with pytest.raises(FitError, match="states its f-number"):
        simple_peers([])


def psf(median, p90):
    pools = ("all", "unseen_stop", "unseen_depth")
    return {pool: {"median": median, "p90": p90} for pool in pools}


def judged_row(**beside):
    unseen = {"unseen_depth": {"median": None, "p90": None}}
    return {
        "lens": "a lens",
        "figures": {
            "chief_ray_px": {"1": 0.01},
            "lateral_colour_px": {"1": 0.01},
            "illumination_worst": {"1": 0.01},
            "psf": psf(0.05, 0.19),
            "thin_lens": {"psf": psf(0.5, 1.1) | unseen},
            "defocus_sign": "right",
            "flags": [],
        },
        "beside": beside,
    }


def run(median, p90, seconds):
    return {"psf": psf(median, p90), "seconds": 2 * seconds, "cpu_seconds": seconds}


def test_peers_stand_beside_lensfit_at_every_kind_of_setting():
    rows = {
        r.what: r
        for r in wavefront_rows(judged_row(peers={"gaussians": run(0.2, 0.4, 3.0)}))
    }
    assert rows["psf, median"].peers == {"gaussians": 0.2, "thin lens": 0.5}
    assert rows["psf at a stop never shot, p90"].peers["gaussians"] == 0.4
    assert rows["psf at a depth never shot, p90"].peers == {"gaussians": 0.4}


def test_takes_left_out_have_bars_half_as_large_again():
    one = {
        "median": 0.16,
        "p90": 0.29,
        "peers": {"gaussians": dict.fromkeys(("median", "p90"))},
    }
    rows = wavefront_rows(judged_row(left_out={"far.exr": one}))
    median, p90 = rows[-2:]
    assert median.what == "psf with far.exr left out, median"
    assert (median.bar, p90.bar) == pytest.approx((0.15, 0.3))
    assert (median.passed, p90.passed) == (False, True)
    assert math.isnan(p90.peers["gaussians"])


def test_every_effort_has_a_row_with_error_and_seconds():
    efforts = {"fast": run(0.08, 0.2, 40.0), "best": run(0.06, 0.1, 120.0)}
    rows = wavefront_rows(judged_row(efforts=efforts))[-2:]
    assert [row.value for row in rows] == [0.08, 0.06]
    assert rows[1].peers == {"p90": 0.1, "seconds": 240.0, "processor seconds": 120.0}


def test_efforts_are_a_curve_and_peers_are_points(tmp_path):
    efforts = {"fast": run(0.08, 0.2, 40.0), "best": run(0.06, 0.1, 120.0)}
    row = judged_row(efforts=efforts, peers={"gaussians": run(0.2, 0.4, 3.0)})
    lensfit, gaussians, thin = curves_of(row)
    assert lensfit.seconds == [40.0, 120.0]
    assert (lensfit.labels, lensfit.worse) == (("fast", "best"), (0.2, 0.1))
    assert (gaussians.errors, gaussians.seconds) == ([0.2], [3.0])
    assert (thin.errors, thin.seconds) == ([0.5], [])
    path = write_psf_plot(row, tmp_path)
    assert np.mean(imread(path)[..., :3] < 200) > 0.005
    assert write_psf_plot(judged_row(), tmp_path) is None


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["--effort", "slow"], "'slow' is not one of fastest, fast, normal, best"),
        (["--data", "nowhere"], "holds no oracle/dg50/shoot.toml"),
        (["--cases", "nosuch"], "no prescription named nosuch; bundled are"),
    ],
)
def test_wrong_words_are_told(words, says, tmp_path):
    out = tmp_path / "never"
    given = ["bench", "wavefront", "--lenses", "0", *words, "--out", str(out)]
    assert says in told_of_wrong_usage(*given)
    assert not out.exists()
