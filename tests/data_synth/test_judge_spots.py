"""Spots judged alone: one setting, all at once or one by one."""

import dataclasses
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from data_synth.judge_spots import judge_spots
from data_synth.psf_truth import Group, WavefrontTruth, write_truth
from data_synth.sensor import Frame
from data_synth.thin_lens import ThinLens

FRAME = Frame((1200, 900), (24.0, 18.0))
CHART_MM = 2000.0
PLACES_MM = np.array([[0.0, 0.0], [6.0, -4.0], [11.0, 8.0]])
SETTINGS = [(2.8, CHART_MM, True), (2.8, 1430.0, True), (4.0, 1430.0, False)]
SIZE, SUBPIXELS = 32, 2


def thin(f_number, focus_mm):
    return ThinLens(50.0, f_number, focus_mm)


def drawn(setting):
    lens = thin(*setting[:2])
    pitch_mm = FRAME.pitch_mm[0] / SUBPIXELS
    raster = {"pixel_pitch_mm": pitch_mm, "size_px": SIZE}
    spots = [[lens.psf(p, CHART_MM, c, **raster) for c in "rgb"] for p in PLACES_MM]
    return np.array(spots)


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """The truth is a thin lens'; one field point is dark."""
    folder = tmp_path_factory.mktemp("truth")
    spots = [drawn(setting) for setting in SETTINGS]
    spots[1][2] = np.nan
    groups = tuple(
        Group(n, focus, CHART_MM, seen, SUBPIXELS, SIZE) for n, focus, seen in SETTINGS
    )
    none = np.zeros((0, 3))
    truth = WavefrontTruth(
        FRAME, 50.0, CHART_MM, groups, tuple(spots), np.array([PLACES_MM] * 3), none,
        (), none, none, (), none, none,
    )  # fmt: skip
    write_truth(folder, truth)
    return folder


def test_the_lens_itself_scores_nothing_at_every_setting(folder):
    figures = judge_spots(thin, folder)
    for pool in ("all", "unseen_stop"):
        assert figures[pool]["p90"] < 1e-6
    assert figures["unseen_depth"] == {"median": None, "p90": None}


@dataclasses.dataclass(frozen=True)
class AtOnce(ThinLens):
    """Draws many spots together and must not be asked for one."""

    def psf(self, *_, **__):
        raise AssertionError("one by one")

    def psfs(self, points_mm, distance_mm, channels, **raster):
        one = partial(ThinLens.psf, self, object_distance_mm=distance_mm, **raster)
        return np.array([[one(p, channel=c) for c in channels] for p in points_mm])


def wrong(kind, f_number, focus_mm):
    return kind(50.0, 1.3 * f_number, focus_mm)


def test_spots_drawn_together_are_judged_as_those_drawn_alone(folder):
    together = judge_spots(partial(wrong, AtOnce), folder)
    alone = judge_spots(partial(wrong, ThinLens), folder)
    assert together == alone
    assert together["all"]["p90"] > 0.05


def test_one_setting_is_judged_alone(folder):
    whole = judge_spots(partial(wrong, ThinLens), folder)
    only = judge_spots(partial(wrong, ThinLens), folder, only=(2.8, 1430.0, CHART_MM))
    assert only == whole["by_setting"]["f2.8_focus1430_object2000"]
    unseen = judge_spots(thin, folder, only=(4.0, 1430.0, CHART_MM))
    assert unseen["p90"] < 1e-6
    assert judge_spots(thin, folder, only=(4.0, 1500.0, CHART_MM)) is None
