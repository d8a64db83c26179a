"""Line grids drawn from a formula: centres, numbers, colour, noise and refusals.

Also lines that all lie alike on the pixels, and print beside them.
"""

import numpy as np
import pytest
from chart_scene import a4, photographed
from drawn_grids import View, draw, line_grid, photograph
from scipy.ndimage import gaussian_filter

from lensfit.detect.line_measure import LINE_WIDTH_DEVIATION
from lensfit.detect.lines import find_lines
from lensfit.errors import DetectionError

VIEW = View()


def whole_offset(found, view):
    """The whole number of pitches between found and true lattice coordinates."""
    offset = view.lattice(found.points_px) - found.lattice
    whole = np.round(np.median(offset, axis=0))
    assert np.abs(offset - whole).max() < 0.2
    return whole


def across(found, view, points_px=None):
    """Signed distance of samples from the true lines, across them, pixels."""
    points_px = found.points_px if points_px is None else points_px
    lattice = view.lattice(points_px)
    rows = np.arange(len(found))
    lattice[rows, found.family] = (found.lattice + whole_offset(found, view))[
        rows, found.family
    ]
    return ((points_px - view.pixels(lattice, points_px)) * found.normal).sum(1)


@pytest.mark.parametrize("blur_px", [0.4, 0.8, 1.5])
@pytest.mark.parametrize("width", [0.06, 0.12])
def test_centres_of_noiseless_bright_lines_are_unbiased(width, blur_px):
    found = find_lines(photograph(draw(VIEW, line_grid(width), blur_px=blur_px)))
    error = across(found, VIEW)
    assert len(found) > 250
    assert abs(error.mean()) < 0.002
    assert error.std() < 0.008
    assert np.abs(error).max() < 0.06


@pytest.mark.parametrize("dark", [False, True], ids=["bright", "dark"])
@pytest.mark.parametrize("turn_rad", [0.0, 0.6])
@pytest.mark.parametrize("width", [0.09, 0.12])
def test_the_width_of_lines_is_measured(width, turn_rad, dark):
    colours = {"dark": 0.9, "light": 0.1} if dark else {}
    view = View(rotation_rad=turn_rad)
    image = draw(view, line_grid(width), blur_px=0.8, **colours)
    found = find_lines(photograph(image))
    assert found.bright is not dark
    assert found.lines.width_pitches == pytest.approx(width, rel=LINE_WIDTH_DEVIATION)
    pitch_px = np.median(found.edge_blur_px) / np.hypot(
        0.8 / view.pitch_px, width / np.sqrt(12)
    )
    assert pitch_px == pytest.approx(view.pitch_px, rel=0.1)


def test_blur_may_hide_the_width_of_lines():
    found = find_lines(photograph(draw(VIEW, line_grid(0.06), blur_px=2.5)))
    assert found.are_lines
    assert found.lines.width_pitches is None


def test_line_numbers_survive_rotation_and_strong_distortion():
    view = View(rotation_rad=0.6, radial=0.4, perspective=(0.15, 0.1))
    found = find_lines(photograph(draw(view, line_grid(0.1), blur_px=0.6)))
    integer = found.lattice[np.arange(len(found)), found.family]
    assert np.array_equal(integer, np.round(integer))
    error = across(found, view)
    assert error.std() < 0.02
    assert np.abs(error).max() < 0.15


def test_dark_lines_on_unevenly_lit_paper():
    def shade(place):
        return 0.3 + 0.7 * place[..., 0] * (1 - 0.5 * place[..., 1])

    image = draw(VIEW, line_grid(0.1), dark=0.9, light=0.1, blur_px=0.8, shade=shade)
    found = find_lines(photograph(image))
    error = across(found, VIEW)
    assert error.std() < 0.02
    columns, rows = np.floor(found.points_px).astype(int).T
    paper = 0.9 * shade(np.stack([columns, rows], -1) / VIEW.size_px)
    assert np.median(np.abs(found.flux[:, 0] / paper - 1)) < 0.06


def test_scatter_matches_the_stated_covariance():
    noise = 0.03
    image = draw(VIEW, line_grid(0.09), blur_px=0.8, noise=noise, seed=3)
    found = find_lines(photograph(image))
    clean = find_lines(photograph(draw(VIEW, line_grid(0.09), blur_px=0.8)))
    error = across(found, VIEW)
    variance = np.einsum(
        "ni,nij,nj->n", found.normal, found.covariance_px2, found.normal
    )
    chi = np.sqrt(np.mean(error**2 / variance))
    assert 0.8 < chi < 1.25
    assert error.std() > 3 * across(clean, VIEW).std()


def test_flux_of_bright_lines_is_width_times_contrast():
    found = find_lines(photograph(draw(View(radial=0), line_grid(0.1), blur_px=0.6)))
    scale = np.linalg.norm(
        View(radial=0).lattice(found.points_px + 0.5 * found.normal)
        - View(radial=0).lattice(found.points_px - 0.5 * found.normal),
        axis=1,
    )
    expected = 0.1 / scale * 0.78
    assert np.median(np.abs(found.flux[:, 0] / expected - 1)) < 0.02


def test_colour_fringes_are_measured_across_the_line():
    shifts = {"r": (0.4, 0.0), "g": (0.0, 0.0), "b": (-0.2, 0.3)}
    channels = [
        draw(VIEW.shifted(*shift), line_grid(0.1), blur_px=0.6)
        for shift in shifts.values()
    ]
    found = find_lines(photograph(*channels))
    for channel, shift in enumerate(shifts.values()):
        moved = found.channel_points_px[channel] - found.points_px
        expected = found.normal @ np.array(shift)
        assert np.abs((moved * found.normal).sum(1) - expected).max() < 0.05
        assert np.std((moved * found.normal).sum(1) - expected) < 0.015


def test_light_of_a_channel_is_whole_however_blurred():
    """Blue may reach far beyond where green ends."""
    blurs_px = (0.6, 0.6, 2.0)
    channels = [draw(VIEW, line_grid(0.1), blur_px=blur) for blur in blurs_px]
    flux = find_lines(photograph(*channels)).flux
    assert np.nanmedian(np.abs(flux[:, 2] / flux[:, 1] - 1)) < 0.05


def test_nearly_every_visible_length_is_sampled_even_without_some_crossings():
    image = draw(VIEW, line_grid(0.1), blur_px=0.6)
    whole = find_lines(photograph(image))
    image[150:190, 190:230] = 0.02
    holed = find_lines(photograph(image))
    assert len(holed) > 0.93 * len(whole)
    assert np.abs(across(holed, VIEW)).max() < 0.1


def test_clipped_lines_are_flagged():
    image = np.minimum(draw(VIEW, line_grid(0.1), blur_px=0.5), 0.6)
    assert find_lines(photograph(image, saturation=0.6)).saturated.all()


def test_a_blank_and_a_noisy_photograph_are_refused_in_one_sentence():
    noise = np.random.default_rng(5).normal(0.5, 0.1, (300, 400))
    for image in (np.full((300, 400), 0.5), noise):
        with pytest.raises(DetectionError, match="line") as refusal:
            find_lines(photograph(image))
        assert "drawn.exr" in str(refusal.value)


def test_noise_on_lines_that_leave_the_picture_makes_no_line_there():
    """Upright lines twice as close as level ones, none of which is near the border."""
    rows, columns = np.mgrid[0:480, 0:640] + 0.5

    def line(place, pitch_px):
        return np.clip(
            2.0 - np.abs(place - pitch_px * np.round(place / pitch_px)), 0, 1
        )

    grid = np.maximum(line(columns - 20, 50.0), line(rows - 90, 100.0))
    for seed in range(3):
        noise = np.random.default_rng(seed).normal(0, 0.003, grid.shape)
        picture = (0.7 * gaussian_filter(grid, 0.8) + noise).astype(np.float32)
        found = find_lines(photograph(picture))
        level = found.family == 1
        off = (found.points_px[level, 1] - 90 + 50) % 100 - 50
        assert np.abs(off).max() < 0.5
        assert len(np.unique(found.lattice[level, 1])) == 4


@pytest.mark.parametrize("offset_px", [0.0, 0.5])
def test_lines_that_all_lie_alike_on_the_pixels(offset_px: float):
    view = View(
        pitch_px=32.0, rotation_rad=0.0, radial=0.0, perspective=(0.0, 0.0),
        offset_px=(offset_px, offset_px),
    )  # fmt: skip
    found = find_lines(photograph(draw(view, line_grid(0.1), blur_px=0.6, noise=0.002)))
    miss = (view.lattice(found.points_px) * 32.0) % 32
    across = np.where(found.family == 0, miss[:, 0], miss[:, 1])
    assert np.abs((across + 16) % 32 - 16).max() < 0.05
    assert len(found) > 200


def test_code_and_ruler_are_no_lines():
    layout = a4("line-grid")
    picture, _ = photographed(layout)
    found = find_lines(picture)
    for axis, count in enumerate(layout.pattern.lattice_size):
        numbers = np.unique(found.lattice[found.family == axis, axis])
        np.testing.assert_array_equal(numbers, np.arange(count))
