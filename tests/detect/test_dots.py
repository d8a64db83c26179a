"""Dots on simulated photographs: bias, covariance, flags, hard views, refusals."""

import numpy as np
import pytest
from dots_scene import (
    coverage,
    discs,
    grid,
    noisy,
    photograph,
    same_lattice,
    shaded,
    view,
)
from scipy.spatial import cKDTree
from scipy.stats import norm

from lensfit.detect.dots import find_dots, resembling
from lensfit.errors import DetectionError


def matched(observations, centres):
    """Errors of the found dots against the nearest true centre, and which it was."""
    distance, nearest = cKDTree(centres).query(observations.points_px)
    assert distance.max() < 2.0
    return observations.points_px - centres[nearest], nearest


def simple_scene(diameter_px, *, columns=9, rows=8, spacing=None):
    """A square grid whose dots fall on all sub-pixel phases."""
    pitch = spacing or 2.1 * diameter_px + 7
    pitch = np.floor(pitch) + np.array([0.119, 0.373])
    lattice = grid(columns, rows)
    centres = lattice * pitch + pitch * 0.8
    size = tuple(np.ceil(centres.max(0) + 0.8 * pitch).astype(int))
    return size, lattice, centres


@pytest.mark.parametrize("polarity", ["bright", "dark"])
@pytest.mark.parametrize("diameter_px", [2.0, 3.3, 6.0, 13.0, 31.0, 60.0])
def test_no_sub_pixel_bias_over_phases_and_sizes(diameter_px, polarity):
    size, lattice, centres = simple_scene(diameter_px)
    cover = coverage(size, centres, discs(diameter_px / 2, len(centres)), blur_px=0.6)
    picture = noisy(shaded(cover, polarity), 0, read=2e-5)
    found = find_dots(photograph(picture))
    error, nearest = matched(found, centres)
    assert len(found) == len(centres)
    assert same_lattice(found.lattice, lattice[nearest])
    assert np.abs(error.mean(0)).max() < 0.002
    assert np.sqrt((error**2).mean(0)).max() < 0.01


@pytest.mark.parametrize("polarity", ["bright", "dark"])
@pytest.mark.parametrize("diameter_px", [4.0, 11.0, 24.0])
def test_covariance_is_the_scatter(diameter_px, polarity):
    size, _, centres = simple_scene(diameter_px, columns=20, rows=16)
    cover = coverage(size, centres, discs(diameter_px / 2, len(centres)), blur_px=1.0)
    picture = shaded(cover, polarity)
    found = find_dots(photograph(noisy(picture, 4, read=0.012)), polarity=polarity)
    error, _ = matched(found, centres)
    expected = np.trace(found.covariance_px2, axis1=1, axis2=2).mean()
    ratio = np.sqrt((error**2).sum(1).mean() / expected)
    assert 0.8 < ratio < 1.25


def test_covariance_knows_the_lights_own_noise():
    size, _, centres = simple_scene(24.0, columns=20, rows=16)
    cover = coverage(size, centres, discs(12.0, len(centres)), blur_px=2.0)
    picture = noisy(shaded(cover, "bright"), 4, read=1e-4, well=20_000)
    found = find_dots(photograph(picture))
    error, _ = matched(found, centres)
    expected = np.trace(found.covariance_px2, axis1=1, axis2=2).mean()
    assert 0.8 < np.sqrt((error**2).sum(1).mean() / expected) < 1.25


@pytest.mark.parametrize("polarity", ["bright", "dark"])
def test_channels_are_measured_alike_so_lateral_colour_is_true(polarity):
    size, _, centres = simple_scene(10.0)
    shift = np.array([[0.3, -0.2], [0.0, 0.0], [-0.4, 0.1]])
    shapes = discs(5.0, len(centres))
    planes = [
        shaded(coverage(size, centres + s, shapes, blur_px=0.8), polarity)
        for s in shift
    ]
    picture = noisy(np.stack(planes, -1), 2, read=5e-4)
    found = find_dots(photograph(picture))
    error, _ = matched(found, centres)
    assert np.abs(error).max() < 0.02
    lateral = found.channel_points_px - found.points_px
    assert np.allclose(lateral.mean(1), shift, atol=0.005)
    assert found.flux.shape == (len(found), 3)


def test_single_channel_leaves_the_channels_unmeasured():
    size, _, centres = simple_scene(10.0)
    cover = coverage(size, centres, discs(5.0, len(centres)), blur_px=0.8)
    found = find_dots(photograph(shaded(cover, "dark")))
    assert np.isnan(found.channel_points_px).all()
    assert found.flux.shape == (len(found), 1)
    assert np.allclose(found.flux, 0.9, atol=0.01)
    assert np.allclose(found.diameter_px, 10.0, atol=0.8)


def test_flux_of_a_bright_dot_is_its_light():
    size, _, centres = simple_scene(12.0)
    cover = coverage(size, centres, discs(6.0, len(centres)), blur_px=1.5)
    picture = noisy(shaded(cover, "bright"), 1, read=1e-3)
    found = find_dots(photograph(picture))
    assert np.allclose(found.flux[:, 0], 0.8 * np.pi * 36, rtol=0.01)


@pytest.mark.parametrize("polarity", ["bright", "dark"])
@pytest.mark.parametrize(
    ("angle_deg", "tilt_deg", "barrel"),
    [(0, 30, 0.0), (41, 30, 0.0), (0, 0, 0.33), (67, 15, 0.3)],
)
def test_hard_views_with_missing_cropped_larger_dots_and_dirt(
    angle_deg, tilt_deg, barrel, polarity
):
    rng = np.random.default_rng(7)
    lattice = grid(49, 36)
    size = (1300, 1000)
    seen_from = {"angle_deg": angle_deg, "tilt_deg": tilt_deg, "barrel": barrel}
    centres = view(lattice, np.array(size) / 2, 27.0, **seen_from)
    spacing = cKDTree(centres).query(centres, k=2)[0][:, 1]
    radius = 0.2 * spacing
    radius[(lattice[:, 0] % 16 == 8) & (lattice[:, 1] % 12 == 6)] *= 1.8
    there = rng.random(len(centres)) > 0.2
    dirt = rng.random((60, 2)) * size
    everything = np.concatenate([centres[there], dirt])
    shapes = discs(np.append(radius[there], rng.uniform(0.7, 3.5, 60)), len(everything))
    cover = coverage(size, everything, shapes, blur_px=0.9)
    picture = noisy(shaded(cover, polarity), 3, read=4e-3)
    found = find_dots(photograph(picture))
    distance, nearest = cKDTree(centres).query(found.points_px)
    inside = (np.abs(centres / size - 0.5) < 0.5 - 8 / np.array(size)).all(1) & there
    right = (distance < 0.35) & there[nearest]
    assert np.count_nonzero(right) >= 0.97 * np.count_nonzero(inside)
    # Dirt that merges with a dot, or lies on a missing one, is beyond telling.
    assert np.count_nonzero(~right) <= 0.015 * len(found)
    assert same_lattice(found.lattice[right], lattice[nearest[right]], turned=True)


def test_an_illumination_gradient_moves_nothing():
    size, _, centres = simple_scene(9.0, columns=20, rows=15)
    cover = coverage(size, centres, discs(4.5, len(centres)), blur_px=0.8)
    x = np.linspace(0, 1, size[0])
    field = 0.03 + 0.97 * x**2 * np.linspace(0.5, 1, size[1])[:, None]
    picture = noisy(shaded(cover, "dark", field=field), 5, read=2e-4)
    found = find_dots(photograph(picture))
    error, _ = matched(found, centres)
    assert len(found) >= 0.99 * len(centres)
    bright = field[found.points_px[:, 1].astype(int), found.points_px[:, 0].astype(int)]
    assert np.sqrt((error[bright > 0.1] ** 2).sum(1).mean()) < 0.03


def half_lit_scene():
    """The penumbra of a shadow lies on the last rows of dots."""
    size, lattice, centres = simple_scene(13.0, columns=20, rows=18, spacing=26.0)
    cover = coverage(size, centres, discs(6.5, len(centres)), blur_px=1.3)
    edge, width = centres[:, 1].max() - 45.0, 14.0
    light = 0.01 + 0.99 * norm.sf((np.arange(size[1]) + 0.5 - edge) / width)
    picture = shaded(cover, "dark", field=light[:, None])
    lit = np.interp(centres[:, 1], np.arange(size[1]) + 0.5, light)
    return noisy(picture, 5, read=1e-3), lattice, centres, lit


def test_half_lit_dots_are_found_and_their_covariance_says_so():
    picture, lattice, centres, lit = half_lit_scene()
    found = find_dots(photograph(picture))
    error, nearest = matched(found, centres)
    assert set(np.flatnonzero(lit > 0.4)) <= set(nearest)
    assert same_lattice(found.lattice, lattice[nearest])
    half_lit = lit[nearest] < 0.9
    assert half_lit.sum() >= 20
    sigma = np.sqrt(np.trace(found.covariance_px2, axis1=1, axis2=2) / 2)
    assert np.linalg.norm(error[half_lit], axis=1).max() < 0.04
    assert (np.abs(error) < 3 * sigma[:, None])[half_lit].all()
    assert np.median(sigma[half_lit]) > 5 * np.median(sigma[~half_lit])
    assert not found.overlapping.any()


def test_dots_deep_in_a_penumbra_are_left_out():
    picture, _, centres, lit = half_lit_scene()
    _, nearest = matched(find_dots(photograph(picture)), centres)
    assert not set(np.flatnonzero(lit < 0.15)) & set(nearest)


def test_a_mark_with_no_neighbour_is_left_out():
    size, lattice, centres = simple_scene(12.0, columns=20, rows=12)
    alone = (lattice[:, 0] == 18) & (lattice[:, 1] == 5)
    there = (lattice[:, 0] < 16) | alone
    cover = coverage(size, centres[there], discs(6.0, there.sum()), blur_px=1.0)
    found = find_dots(photograph(noisy(shaded(cover, "dark"), 1, read=1e-3)))
    _, nearest = matched(found, centres)
    assert set(nearest) == set(np.flatnonzero(lattice[:, 0] < 16))


def test_masks_of_a_few_samples_say_little_of_a_dots_size():
    cells = grid(7, 7)
    area = np.where(cells[:, 0] == 3, 4.0, 20.0)
    usual = np.ones(len(cells))
    good = resembling(cells, cells * 30.0, usual, area, 0 * usual, usual > 0)
    assert good.all()


def test_saturated_dots_are_flagged_and_only_those():
    size, lattice, centres = simple_scene(12.0)
    cover = coverage(size, centres, discs(6.0, len(centres)), blur_px=1.0)
    picture = noisy(shaded(cover, "bright"), 6, read=1e-3)
    hot = np.flatnonzero(lattice[:, 0] == 3)
    for x, y in centres[hot]:
        picture[int(y) - 12 : int(y) + 12, int(x) - 12 : int(x) + 12] *= 2
    picture = np.minimum(picture, 1.0)
    found = find_dots(photograph(picture, saturation=1.0))
    _, nearest = matched(found, centres)
    assert set(nearest[found.saturated]) == set(hot)


def test_overlapping_blurred_discs_are_flagged_but_not_distant_ones():
    size, lattice, centres = simple_scene(16.0, spacing=36.0)
    radius = np.full(len(centres), 8.0)
    pair = (lattice[:, 1] == 4) & np.isin(lattice[:, 0], (4, 5))
    radius[pair] = 14.5
    cover = coverage(size, centres, discs(radius, len(centres)), blur_px=3.0)
    picture = noisy(shaded(cover, "bright"), 6, read=1e-3)
    found = find_dots(photograph(picture))
    _, nearest = matched(found, centres)
    beside = (np.abs(lattice[:, 1] - 4) <= 1) & (np.abs(lattice[:, 0] - 4.5) < 2)
    assert set(np.flatnonzero(pair)) <= set(nearest[found.overlapping])
    assert set(nearest[found.overlapping]) <= set(np.flatnonzero(beside))


def test_dots_cut_by_the_border_are_left_out():
    size, _, centres = simple_scene(12.0)
    centres = centres - centres.min(0) + [3.0, 40.0]  # first column half outside
    cover = coverage(size, centres, discs(6.0, len(centres)), blur_px=0.8)
    found = find_dots(photograph(shaded(cover, "dark")))
    _, nearest = matched(found, centres)
    assert np.array_equal(np.sort(nearest), np.flatnonzero(centres[:, 0] > 6.5))


def test_asymmetric_circle_grid():
    row, column = np.mgrid[:11, :6]
    lattice = np.stack([(2 * column + row % 2).ravel(), row.ravel()], 1)
    centres = lattice * 30.3 + 50
    cover = coverage((460, 410), centres, discs(9.0, len(centres)), blur_px=0.9)
    found = find_dots(photograph(shaded(cover, "dark")), asymmetric=True)
    _, nearest = matched(found, centres)
    assert len(found) == len(centres)
    assert same_lattice(found.lattice, lattice[nearest])
    assert (found.lattice.sum(1) % 2 == 0).all()


def refused(picture, **kwargs):
    with pytest.raises(DetectionError) as caught:
        find_dots(photograph(picture, **kwargs))
    return str(caught.value)


def test_pictures_without_a_grid_are_refused_in_one_sentence():
    noise = np.random.default_rng(1).random((500, 600))
    assert "no dots" in refused(np.zeros((400, 500)))
    assert "over-exposed" in refused(np.ones((400, 500)), saturation=1.0)
    for text in (refused(noise), refused(np.full((30, 40), 0.5))):
        assert "simulated.exr" in text
        assert ";" in text


def test_few_dots_are_refused():
    size, _, centres = simple_scene(12.0, columns=5, rows=3)
    cover = coverage(size, centres, discs(6.0, len(centres)), blur_px=1.0)
    assert "lattice" in refused(shaded(cover, "dark"))


def test_dots_scattered_without_a_lattice_are_refused():
    rng = np.random.default_rng(3)
    centres = rng.random((150, 2)) * [900, 700] + 20
    cover = coverage((940, 740), centres, discs(5.0, len(centres)), blur_px=1.0)
    assert "lattice" in refused(shaded(cover, "dark"))
