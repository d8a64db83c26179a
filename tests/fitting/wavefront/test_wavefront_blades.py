"""The iris: its blades are counted and turned, and a round one is left round."""

from dataclasses import replace

import numpy as np
import pytest
from drawn_lens import LAYOUT, PLACES_MM, Seidel, Shot, photographed

from lensfit.fitting.wavefront.descent import fit_blades
from lensfit.fitting.wavefront.stages import (
    first_stage,
    recentre_patches,
    set_priors,
    solve_stage,
)

IRIS = LAYOUT.blocks["iris"]
LENS = Seidel(4.0, 0.0, 5.0, 3.0, defocus_mm=(0.5, -0.4))


def iris_of(lens: Seidel, shots: list[Shot]):
    """The stage after a look at the iris; everything else is known."""
    dot_data = photographed(lens, shots, noise=0.03, places_mm=PLACES_MM[:4])
    start = lens.parameters()
    start[IRIS] = [0.0, 0.0, 0.1]
    return fit_blades(recentre_patches(first_stage(dot_data, LAYOUT, start)))


@pytest.mark.slow
@pytest.mark.parametrize("rotation_rad", [0.2, 0.75])
def test_seven_straight_blades_are_counted_and_turned(rotation_rad):
    """Seen point-mirrored on the two sides of focus."""
    lens = replace(LENS, blades=7, rotation_rad=rotation_rad)
    shots = [Shot(0, 1), Shot(1, 1)]
    stage = iris_of(lens, shots)
    assert stage.blades == 7
    free = np.zeros(LAYOUT.size)
    free[IRIS][1:] = [3.0, 1.0]
    stage = solve_stage(set_priors(stage, free), 12)
    squeeze, rotation, curvature = stage.parameters[IRIS]
    sector = 2 * np.pi / 7
    away = (rotation - rotation_rad + sector / 2) % sector - sector / 2
    assert abs(away) < 0.03
    assert abs(curvature) < 0.15
    assert squeeze == 0


def test_a_round_iris_is_left_round():
    stage = iris_of(LENS, [Shot(0, 1), Shot(1, 1)])
    assert stage.blades == 0
    np.testing.assert_array_equal(stage.parameters[IRIS], [0.0, 0.0, 0.1])


def test_wide_open_nobody_asks():
    dot_data = photographed(LENS, [Shot(0, 0)], rays=2000, places_mm=PLACES_MM[:2])
    stage = first_stage(dot_data, LAYOUT, LENS.parameters())
    assert fit_blades(stage) is stage
