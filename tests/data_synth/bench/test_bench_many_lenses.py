"""Many judged lenses together: what counts as short, and which shortfall is silent."""

import math

from data_synth.bench.wavefront.rows import many_lenses_rows

GOOD = {
    "chief_ray_px": {"2000": 0.01},
    "lateral_colour_px": {"r-g": 0.01, "b-g": 0.02},
    "illumination_worst": {"f2_focus2000": 0.01},
    "psf": {"all": {"median": 0.05, "p90": 0.1}},
    "defocus_sign": "right",
    "flags": [],
    "covered": {"chief_rays": 70.0, "psf": 60.0},
}


def lens(converged=True, **figures):
    said = {"converged": converged, "said_short": not converged}
    return {"lens": "a", "figures": GOOD | figures} | said


def told(*rows):
    return {row.what: row for row in many_lenses_rows(list(rows))}


def test_one_lens_or_none_says_nothing_together():
    assert many_lenses_rows([lens()]) == []
    assert many_lenses_rows([lens(), {"figures": None, "converged": None}]) == []


def test_lenses_within_every_bar_count_nowhere():
    found = told(lens(), lens())
    counts = [row for what, row in found.items() if what.startswith("lenses")]
    assert len(counts) == 8
    assert [row.value for row in counts] == [0.0] * 8
    assert {row.set for row in counts} == {"2 lenses"}


def test_every_shortfall_counts_once():
    found = told(
        lens(),
        lens(chief_ray_px={"1000": 0.01, "2000": 0.06}),
        lens(lateral_colour_px={"r-g": 0.04, "b-g": 0.0}),
        lens(illumination_worst={"f2_focus2000": 0.03}),
        lens(defocus_sign="undecided"),
        lens(flags=["folds"]),
    )
    for what in (
        "lenses with chief rays over 0.05 px",
        "lenses with lateral colour over 0.03 px",
        "lenses with fall-off over 2 %",
        "lenses with the side of focus wrong or undecided",
        "lenses that fold or darken below zero",
    ):
        assert found[what].value == 1.0, what
    assert found["lenses with the side of focus wrong or undecided"].passed is False
    assert found["lenses whose psf falls short"].value == 0.0


def test_a_psf_that_falls_short_is_silent_unless_it_was_said():
    wide = {"all": {"median": 0.05, "p90": 0.3}}
    unknown = {"all": {"median": None, "p90": None}}
    silent = "lenses whose psf falls short and that did not say so"
    for psf in (wide, unknown, None):
        said = told(lens(), lens(converged=False, psf=psf))
        assert (said[silent].value, said[silent].passed) == (0.0, True)
        assert said["lenses whose psf falls short"].value == 1.0
        assert said["lenses said not to have converged"].value == 1.0
        kept_still = told(lens(), lens(psf=psf))
        assert (kept_still[silent].value, kept_still[silent].passed) == (1.0, False)
    assert told(*[lens()] * 99, lens(psf=wide))[silent].passed


def test_coverage_is_the_mean_of_lenses_that_state_it():
    found = told(lens(), lens(covered={"chief_rays": 50.0}))
    chief = found["stated deviations of chief rays cover, %"]
    assert (chief.value, chief.passed, chief.set) == (60.0, True, "2 lenses")
    psf = found["stated deviations of psf cover, %"]
    assert (psf.value, psf.set) == (60.0, "1 lenses")


def test_deviations_that_no_lens_states_fail():
    row = told(lens(), lens())["stated deviations of fall off cover, %"]
    assert math.isnan(row.value)
    assert row.passed is False
