"""Hard photographs: small ones of each kind, calibrated and judged by the ray trace.

Pictures of 400 x 300 at effort fastest, which are not what the tables of README.md are
made of: spots have few pixels, so errors are larger where blur is. The bars are half as
much again as was measured, so that a fit which loses its way is noticed.
"""

from typing import NamedTuple

import pytest

from data_synth.judge import judge
from data_synth.wavefront_cases import CASES, case_subject
from lensfit.preset.store import load_preset
from lensfit.workflow.calibrate import calibrate
from lensfit.workflow.shoot.file import load_shoot

SIZE_PX = (400, 300)


class Bars(NamedTuple):
    """The most that may be off.

    Attributes
    ----------
    chief_px, colour_px : Rms over the frame, at the worst focus distance.
    light : Part of the relative illumination, at the worst place.
    psf, psf_tenth : Relative error of spots: median, and 90th percentile.
    side : What the fit says of the side of focus, against the truth.
    """

    chief_px: float
    colour_px: float
    light: float
    psf: float
    psf_tenth: float
    side: str = "right"


BARS: dict[str, Bars] = {}


def test_every_case_has_its_bars():
    assert set(BARS) == set(CASES)


@pytest.mark.slow
@pytest.mark.parametrize("name", CASES)
def test_a_hard_case_is_as_good_as_it_was(name, tmp_path):
    case_subject(name, SIZE_PX).write(tmp_path)
    out = tmp_path / "out"
    calibrate(load_shoot(tmp_path / "shoot.toml"), out, effort="fastest")
    found = judge(load_preset(out / "preset.json"), tmp_path)
    bars = BARS[name]
    assert found["flags"] == []
    assert found["defocus_sign"] == bars.side
    assert max(found["chief_ray_px"].values()) < bars.chief_px
    assert max(found["lateral_colour_px"].values()) < bars.colour_px
    assert max(found["illumination_worst"].values()) < bars.light
    assert found["psf"]["all"]["median"] < bars.psf
    assert found["psf"]["all"]["p90"] < bars.psf_tenth
