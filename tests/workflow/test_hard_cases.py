"""Hard photographs, each fitted and judged by the ray trace that made it.

Small pictures and the least effort, to be run often: bars are half as much again as was
measured so, no promise to users (notebooks/guide/accuracy.md has the figures of larger
ones); in focus alone blur is held to what is promised. What may never go is the side of
focus, and a map or fall-off that folds. A mosaic needs finer pictures;
`data_synth/bench/test_bench_wavefront.py` has it. Each case takes two to six minutes:
CI runs two of them, and `pytest -m hard` the others.
"""

from typing import NamedTuple

import pytest

from data_synth.judge import judge
from data_synth.wavefront_cases import CASES, case_subject
from lensfit.preset.store import load_preset
from lensfit.workflow.calibrate import calibrate
from lensfit.workflow.shoot.shoot_file import load_shoot

SIZE = (400, 300)


class Bars(NamedTuple):
    """Worst focus, px; worst channel, px; worst place; psf median, 90th percentile;
    what spots say of the side of focus."""

    chief: float
    colour: float
    light: float
    median: float
    p90: float
    sides: tuple[str, ...] = ("right",)


BARS = {
    "overlapping": Bars(0.075, 0.008, 0.054, 0.038, 0.066),
    "saturated": Bars(0.042, 0.215, 0.147, 0.095, 0.183),
    "tiny_dots": Bars(0.014, 0.017, 0.026, 0.039, 0.234),
    "cropped_grid": Bars(0.023, 0.045, 0.130, 0.078, 0.327),
    "tilted_chart": Bars(0.119, 0.017, 0.026, 0.065, 0.123),
    "corner_clipped": Bars(0.011, 0.005, 0.104, 0.059, 0.129),
    "decentred": Bars(0.122, 0.025, 0.039, 0.074, 0.254),
    "fast": Bars(0.029, 0.008, 0.005, 0.048, 0.101),
    "fisheye": Bars(0.011, 0.014, 0.035, 0.050, 0.140),
    "jpeg": Bars(0.014, 0.020, 0.093, 0.042, 0.071),
    "anamorphic": Bars(0.042, 0.018, 0.023, 0.138, 0.611),
    "printed_dots": Bars(0.044, 0.003, 0.058, 0.071, 0.163),
    "checkerboard": Bars(0.012, 0.004, 0.056, 0.042, 0.064),
    "line_grid": Bars(0.025, 0.008, 0.065, 0.075, 0.115),
    "single_focus": Bars(0.004, 0.005, 0.062, 0.050, 0.120, ("undecided",)),
    "left_out": Bars(0.102, 0.021, 0.030, 0.110, 0.152),
}

QUICK = ("tiny_dots", "single_focus")


def cases():
    """Every case with its marks."""
    for name in BARS:
        how_long = pytest.mark.slow if name in QUICK else pytest.mark.hard
        yield pytest.param(name, marks=how_long)


def judged(name, folder):
    """Figures of a preset made with the least effort; of spots, every fourth point."""
    photographs, results = folder / "photographs", folder / "results"
    case_subject(name, SIZE).write(photographs)
    report = calibrate(
        load_shoot(photographs / "shoot.toml"), results, effort="fastest"
    )
    assert report["blur_not_measured"] == []
    return judge(load_preset(results / "preset.json"), photographs, every=4)


def test_every_hard_case_has_its_test():
    assert set(BARS) | {"bayer"} == set(CASES)


@pytest.mark.parametrize("name", list(cases()))
def test_a_hard_case_is_fitted_as_well_as_it_was(name, tmp_path):
    found, bars = judged(name, tmp_path), BARS[name]
    assert found["defocus_sign"] in bars.sides
    assert found["flags"] == []
    assert max(found["chief_ray_px"].values()) <= bars.chief
    assert max(found["lateral_colour_px"].values()) <= bars.colour
    assert max(found["illumination_worst"].values()) <= bars.light
    psf = found["psf"]["all"]
    assert psf["median"] <= bars.median
    assert psf["p90"] <= bars.p90
