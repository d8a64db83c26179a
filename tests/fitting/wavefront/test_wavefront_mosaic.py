"""Dots behind a mosaic: fitted to what was measured alone, they are what they are."""

from dataclasses import replace

import numpy as np
import pytest
from drawn_lens import LAYOUT, Seidel, Shot, photographed

from lensfit.fitting.wavefront.dot_weights import initial_weights, robust_weights
from lensfit.fitting.wavefront.stages import (
    first_stage,
    recentre_patches,
    set_priors,
    solve_stage,
)
from lensfit.fitting.wavefront.term_groups import (
    FINE,
    candidate_term_groups,
    deviation_of,
)
from lensfit.mosaic import MOSAICS, photosites

TRUE = Seidel(12.0, -9.0, 14.0, 8.0, defocus_mm=(0.3, -0.25, 0.12))
NOISE = 0.02


SHOTS = [Shot(0, 0, 1700.0), Shot(1, 0, 2500.0), Shot(2, 0, 1900.0)]


@pytest.fixture(scope="module")
def whole():
    return photographed(TRUE, SHOTS, noise=NOISE)


def behind_mosaic(dot_data):
    """Every dot at another phase of a mosaic; what was not measured is black."""
    cells = dot_data.light.shape[-1]
    own = np.stack(
        [
            np.moveaxis(photosites(MOSAICS[dot % 4], (cells, cells)), -1, 0)
            for dot in range(len(dot_data.take))
        ]
    )
    light = np.where(own, dot_data.light, 0.0)
    return replace(dot_data, light=light, valid=dot_data.valid & own)


def at_truth(dot_data):
    stage = first_stage(dot_data, LAYOUT, TRUE.parameters())
    return recentre_patches(replace(stage, weight=initial_weights(dot_data, 0.02)), 3)


def test_others_photosites_have_no_weight(whole):
    masked = behind_mosaic(whole)
    own = masked.valid
    assert not np.any(initial_weights(masked, 0.02)[~own])
    stage = at_truth(masked)
    weight = robust_weights(masked, stage.residual, stage.nuisance[..., 1], 0.02)
    assert not np.any(weight[~own])
    assert np.all(weight[own] > 0)


def test_light_and_place_of_a_dot_are_those_without_a_mosaic(whole):
    masked = behind_mosaic(whole)
    used = whole.valid.any((2, 3))
    every, some = at_truth(whole), at_truth(masked)
    flux = some.nuisance[used][:, 0] / every.nuisance[used][:, 0]
    assert np.sqrt(np.mean((flux - 1) ** 2)) < 0.07
    cell_mm = float(whole.dots.cell_mm.mean())
    apart = (some.corner_mm - every.corner_mm)[used] / cell_mm
    assert np.abs(apart).max() < 0.15
    assert np.sqrt(np.mean(apart**2)) < 0.05


def found_from_near(dot_data) -> np.ndarray:
    """Third order and defocus, from four fifths of the truth."""
    term_groups = candidate_term_groups(dot_data, LAYOUT, np.array(TRUE.defocus_mm))
    term_groups = tuple(f for f in term_groups if f.name in ("defocus", "third_order"))
    deviation = deviation_of(term_groups, LAYOUT, FINE)
    start = np.where(deviation > 0, 0.8, 1.0) * TRUE.parameters()
    stage = set_priors(first_stage(dot_data, LAYOUT, start), deviation)
    # As the last stage of a fit has them.
    stage = replace(stage, ray_groups=4)
    for _ in range(6):
        stage = solve_stage(stage)
    return stage.parameters


@pytest.mark.slow
def test_the_lens_is_found_behind_a_mosaic():
    """On photographs of so many rays that theirs is not the largest error."""
    whole = photographed(TRUE, SHOTS, noise=NOISE, rays=1_600_000)
    truth = TRUE.parameters()
    coefficients, defocus = (LAYOUT.blocks[n] for n in ("coefficients", "defocus"))
    for dot_data in (whole, behind_mosaic(whole)):
        found = found_from_near(dot_data)
        np.testing.assert_allclose(found[coefficients], truth[coefficients], atol=0.4)
        np.testing.assert_allclose(found[defocus], truth[defocus], atol=0.004)
