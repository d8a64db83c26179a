"""Pictures of dots: light is kept, and cells that must not be used are marked."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from drawn_grids import View, draw, line_grid
from drawn_grids import photograph as drawn_photograph
from found_marks import found_marks
from scipy.ndimage import gaussian_filter

from lensfit.detect.dot_diameter import cut_rims
from lensfit.detect.dot_images import CELLS, cut_dot_images
from lensfit.detect.lines import find_lines
from lensfit.detect.observations import Observations
from lensfit.mosaic import MOSAICS, filled_in, photosites
from lensfit.photograph import Photograph

SIZE = (400, 300)


def marks_at(points_px, diameter_px) -> Observations:
    """Dots at these places."""
    points_px = np.asarray(points_px, float)
    count = len(points_px)
    return found_marks(
        points_px,
        SIZE,
        lattice=np.stack([np.arange(count), np.zeros(count)], -1),
        diameter_px=np.broadcast_to(np.asarray(diameter_px, float), count).copy(),
    )


def photograph_of(pixels: np.ndarray, saturation: float = np.inf) -> Photograph:
    if pixels.ndim == 2:
        pixels = pixels[..., None]
    return Photograph(
        pixels.astype(np.float32), Path("dots.exr"), "", saturation=saturation
    )


def disc(centre, diameter: float) -> np.ndarray:
    """A disc of light 1, columns x and rows y of the whole photograph."""
    x, y = np.meshgrid(np.arange(SIZE[0]) + 0.5, np.arange(SIZE[1]) + 0.5)
    return (np.hypot(x - centre[0], y - centre[1]) < diameter / 2).astype(float)


def test_lines_are_pictured_within_the_grid():
    view = View()
    pixels = draw(view, line_grid(0.12), blur_px=0.8)
    lines = find_lines(drawn_photograph(pixels))
    found = cut_dot_images(drawn_photograph(pixels), lines)
    assert found is not None
    assert found.cell_px == 1
    assert len(found.marks) <= 400
    seen = lines.lattice[found.marks]
    assert (seen > lines.lattice.min(0) + 0.4).all()
    assert (seen < lines.lattice.max(0) - 0.4).all()
    assert found.valid[:, 1].mean() > 0.9
    # The line through the middle lies there whichever way it runs.
    inner = slice(CELLS // 2 - 2, CELLS // 2 + 2)
    assert (found.light[:, 1, inner, inner].max((1, 2)) > 0.6).all()


@pytest.mark.parametrize(("diameter", "cell"), [(8.0, 1), (20.0, 2), (60.0, 4)])
def test_cells_of_several_pixels_keep_the_light(diameter, cell):
    centre = (203.3, 148.6)
    pixels = disc(centre, diameter) * np.linspace(0.5, 1.5, SIZE[0])
    found = cut_dot_images(photograph_of(pixels), marks_at([centre], diameter))
    assert found is not None
    assert found.cell_px == cell
    np.testing.assert_allclose(
        found.light[0, 1].sum() * cell**2, pixels.sum(), rtol=1e-5
    )
    assert found.valid.all()
    assert not found.clipped.any()
    middle = (np.arange(CELLS) + 0.5) * cell
    light = found.light[0, 1]
    x = light.sum(0) @ middle / light.sum() + found.corner_px[0, 0]
    y = light.sum(1) @ middle / light.sum() + found.corner_px[0, 1]
    columns, rows = np.arange(SIZE[0]) + 0.5, np.arange(SIZE[1]) + 0.5
    assert x == pytest.approx(pixels.sum(0) @ columns / pixels.sum(), abs=5e-3 * cell)
    assert y == pytest.approx(pixels.sum(1) @ rows / pixels.sum(), abs=5e-3 * cell)


def test_a_coloured_photograph_keeps_its_channels():
    pixels = disc((200.0, 150.0), 8.0)[..., None] * [1.0, 2.0, 3.0]
    found = cut_dot_images(photograph_of(pixels), marks_at([(200.0, 150.0)], 8.0))
    assert found is not None
    assert found.channels == 3
    sums = found.light[0].sum((1, 2))
    np.testing.assert_allclose(sums / sums[0], [1.0, 2.0, 3.0], rtol=1e-6)
    grey = cut_dot_images(
        photograph_of(pixels[..., :1]), marks_at([(200.0, 150.0)], 8.0)
    )
    assert grey is not None
    assert grey.channels == 1
    np.testing.assert_array_equal(grey.light[0, 0], grey.light[0, 2])


@pytest.mark.parametrize(
    ("centre", "outside"),
    [
        ((5.0, 150.0), (slice(None), slice(0, 7))),
        ((SIZE[0] - 5.0, 150.0), (slice(None), slice(17, None))),
        ((200.0, 5.0), (slice(0, 7), slice(None))),
        ((200.0, SIZE[1] - 5.0), (slice(17, None), slice(None))),
    ],
    ids=["left", "right", "top", "bottom"],
)
def test_cells_outside_the_frame_are_masked(centre, outside):
    found = cut_dot_images(photograph_of(np.ones(SIZE[::-1])), marks_at([centre], 8.0))
    assert found is not None
    assert found.cell_px == 1
    expected = np.ones((CELLS, CELLS), bool)
    expected[outside] = False
    np.testing.assert_array_equal(found.valid[0, 1], expected)
    np.testing.assert_array_equal(found.light[0, 1] > 0, expected)


def test_cells_nearer_to_a_neighbour_are_masked():
    points = [(200.0, 150.0), (214.0, 150.0), (200.0, 141.0)]
    marks = marks_at(points, [8.0, 8.0, np.nan])
    found = cut_dot_images(photograph_of(np.ones(SIZE[::-1])), marks)
    assert found is not None
    np.testing.assert_array_equal(found.marks, [0, 1])
    x = found.corner_px[0, 0] + np.arange(CELLS) + 0.5
    y = found.corner_px[0, 1] + np.arange(CELLS) + 0.5
    x, y = np.meshgrid(x, y)
    expected = (x < 207.0) & (y > 145.5)
    away = (np.abs(x - 207.0) > 0.6) & (np.abs(y - 145.5) > 0.6)
    np.testing.assert_array_equal(found.valid[0, 1][away], expected[away])
    assert 0 < expected.sum() < expected.size


def test_a_cell_with_one_clipped_pixel_is_marked():
    pixels = np.full((*SIZE[::-1], 3), 0.5)
    pixels[150, 200, 1] = 1.0
    found = cut_dot_images(photograph_of(pixels, 1.0), marks_at([(200.0, 150.0)], 20.0))
    assert found is not None
    assert found.cell_px == 2
    assert found.clipped.sum() == 1
    assert found.clipped[0, 1, 12, 12]
    assert found.valid.all()


@pytest.mark.parametrize("mosaic", MOSAICS)
def test_a_cell_counts_in_the_channel_that_was_measured_there(mosaic):
    pixels = np.ones((*SIZE[::-1], 3))
    photograph = replace(photograph_of(pixels), mosaic=mosaic)
    found = cut_dot_images(photograph, marks_at([(200.0, 150.0), (101.0, 97.0)], 8.0))
    assert found is not None
    assert found.cell_px == 1
    own = photosites(mosaic, SIZE)
    for dot, (x, y) in enumerate(found.corner_px):
        part = own[y : y + CELLS, x : x + CELLS]
        np.testing.assert_array_equal(np.moveaxis(found.valid[dot], 0, -1), part)
    np.testing.assert_array_equal(found.offset_px, 0)


@pytest.mark.parametrize("mosaic", MOSAICS)
@pytest.mark.parametrize("diameter", [20.0, 40.0])
def test_larger_cells_of_a_mosaic_hold_what_was_measured(mosaic, diameter):
    centre = (203.3, 148.6)
    y, x = np.mgrid[: SIZE[1], : SIZE[0]] + 0.5
    ramp = 0.01 * (x - centre[0]) + 0.02 * (y - centre[1])
    own = photosites(mosaic, SIZE)
    pixels = np.where(own, ramp[..., None], 1e6)
    found = cut_dot_images(
        replace(photograph_of(pixels), mosaic=mosaic), marks_at([centre], diameter)
    )
    assert found is not None
    cell = found.cell_px
    assert cell % 2 == 0
    assert found.valid.all()
    middle = (np.arange(CELLS) + 0.5) * cell
    for k in range(3):
        to = found.corner_px[0] + found.offset_px[k] - centre
        expected = 0.01 * (middle + to[0]) + 0.02 * (middle[:, None] + to[1])
        np.testing.assert_allclose(found.light[0, k], expected, atol=1e-5)


@pytest.mark.parametrize(
    ("diameter", "pixels_of_cell"), [(8.0, (1, 1)), (20.0, (1, 2))]
)
def test_noise_of_a_mosaic_is_that_of_its_photosites(diameter, pixels_of_cell):
    sigma = 0.02
    rng = np.random.default_rng(3)
    noisy = rng.normal(0.0, sigma, (*SIZE[::-1], 3))
    photograph = replace(photograph_of(filled_in(noisy, "bggr")), mosaic="bggr")
    found = cut_dot_images(photograph, marks_at([(200.0, 150.0)], diameter))
    assert found is not None
    other, green = pixels_of_cell
    expected = sigma / np.sqrt([other, green, other])
    np.testing.assert_allclose(found.read_noise, expected, rtol=0.06)


@pytest.mark.parametrize("sigma", [1e-3, 0.02])
@pytest.mark.parametrize("diameter", [8.0, 60.0])
def test_read_noise_is_that_of_the_photograph(sigma, diameter):
    """Of a cell: that of a pixel, less by the pixels in it. The dot is no noise."""
    rng = np.random.default_rng(4)
    dot = disc((200.0, 150.0), diameter)
    pixels = dot[..., None] + rng.normal(0.05, 1, (*SIZE[::-1], 3)) * sigma
    found = cut_dot_images(photograph_of(pixels), marks_at([(200.0, 150.0)], diameter))
    assert found is not None
    np.testing.assert_allclose(found.read_noise * found.cell_px, sigma, rtol=0.1)


@pytest.mark.parametrize("dark", [False, True])
@pytest.mark.parametrize("blur_px", [0.7, 3.0, 5.0])
def test_noise_is_not_the_slope_of_a_blurred_picture(blur_px: float, *, dark: bool):
    """Dots of half the pitch, whose blur touches and leaves nothing even."""
    sigma, pitch = 0.004, 20
    row, column = np.indices(SIZE[::-1]) % pitch - (pitch - 1) / 2
    scene = gaussian_filter((np.hypot(row, column) < pitch / 3).astype(float), blur_px)
    light = (1 - scene if dark else scene)[..., None]
    noisy = light + np.random.default_rng(4).normal(0, sigma, (*SIZE[::-1], 3))
    marks = replace(marks_at([(200.0, 150.0)], 12.0), bright=not dark)
    found = cut_dot_images(photograph_of(noisy), marks)
    assert found is not None
    assert (found.pixel_noise > 0.85 * sigma).all()
    assert (found.pixel_noise < 1.5 * sigma).all()


def test_without_sizes_there_is_nothing_to_cut():
    marks = marks_at([(200.0, 150.0)], np.nan)
    assert cut_dot_images(photograph_of(np.ones(SIZE[::-1])), marks) is None


def test_dark_dots_are_bright_ones_turned_about():
    """Here one is cut by the frame's edge: what lies beyond takes no light."""
    for centre in ((203.3, 148.6), (4.0, 148.6)):
        bright = marks_at([centre], 8.0)
        light = disc(centre, 8.0)
        of_bright = cut_dot_images(photograph_of(light), bright)
        of_dark = cut_dot_images(
            photograph_of(1 - light), replace(bright, bright=False)
        )
        assert of_bright is not None
        assert of_dark is not None
        np.testing.assert_allclose(of_dark.light, of_bright.light, atol=1e-6)
        np.testing.assert_array_equal(of_dark.valid, of_bright.valid)


def test_what_clips_around_a_dark_dot_is_not_used():
    centre = (203.3, 148.6)
    pixels = np.minimum(1.2 - disc(centre, 8.0), 1.0)
    pixels[:, 215:] = 0.9
    found = cut_dot_images(
        photograph_of(pixels, 1.0), replace(marks_at([centre], 8.0), bright=False)
    )
    assert found is not None
    assert not found.clipped.any()
    assert found.valid.any()
    # The field left of the dot is clipped, that on the right is what surrounds it.
    assert not found.valid[..., :5].any()
    np.testing.assert_allclose(found.light[..., -3:], 0.0, atol=1e-6)


def test_noise_around_dark_dots_is_that_of_the_white():
    rng = np.random.default_rng(4)
    white = 1 - disc((203.3, 148.6), 8.0)
    noisy = white + rng.normal(0, 0.002 + 0.02 * white)
    found = cut_dot_images(
        photograph_of(noisy), replace(marks_at([(203.3, 148.6)], 8.0), bright=False)
    )
    assert found is not None
    np.testing.assert_allclose(found.read_noise * found.cell_px, 0.022, rtol=0.1)


def blurred_dot(centre, diameter: float, blur_px: float) -> np.ndarray:
    return gaussian_filter(disc(centre, diameter), blur_px)


@pytest.mark.parametrize(
    ("diameter", "blur_px", "finer"),
    [(30.0, 1.0, True), (60.0, 2.0, True), (8.0, 1.0, False), (20.0, 8.0, False)],
)
def test_rims_of_large_sharp_dots_are_cut_in_finer_cells(diameter, blur_px, finer):
    centre = (203.3, 148.6)
    photograph = photograph_of(blurred_dot(centre, diameter, blur_px))
    marks = marks_at([centre], np.hypot(diameter, 4 * blur_px))
    whole = cut_dot_images(photograph, marks)
    rims = cut_rims(photograph, marks, whole)
    assert whole is not None
    assert (rims is not None) == finer
    if rims is None:
        return
    assert rims.cell_px < whole.cell_px
    assert rims.towards_px is not None
    np.testing.assert_array_equal(rims.marks, 0)
    # Four sides of the dot, each with the edge through the middle of its picture.
    angles = np.sort(np.arctan2(*rims.towards_px.T[::-1]))
    np.testing.assert_allclose(np.diff(angles), np.pi / 2)
    light = rims.light[:, 1]
    lit = light.sum((1, 2))
    assert np.all(light.max((1, 2)) > 0.9)
    assert np.all(light.min((1, 2)) < 0.1)
    assert np.all((lit > 0.2 * CELLS**2) & (lit < 0.6 * CELLS**2))


def test_corners_are_cut_as_wide_as_their_edges_are_blurred():
    points = np.array([[100.0, 100.0], [200.0, 150.0]])
    picture = photograph_of(np.ones((SIZE[1], SIZE[0])))
    for blur_px, cell in ((0.6, 1), (5.0, 2)):
        seen = found_marks(points, SIZE, edge_blur_px=np.full(2, blur_px), bright=False)
        found = cut_dot_images(picture, seen)
        assert found is not None
        assert found.cell_px == cell
        # They are not turned about, as dark dots are.
        np.testing.assert_array_equal(found.light, 1.0)
        assert cut_rims(picture, seen, found) is None


def test_around_a_corner_the_picture_goes_on_beyond_the_frame():
    rows = np.arange(SIZE[1], dtype=float)[:, None] / SIZE[1]
    picture = photograph_of(np.broadcast_to(rows, SIZE[::-1]).copy())
    points = np.array([[5.0, 100.0], [200.0, 150.0]])
    seen = found_marks(points, SIZE, edge_blur_px=np.full(2, 0.6), bright=False)
    found = cut_dot_images(picture, seen)
    assert found is not None
    beyond = ~found.valid[0, 1]
    assert beyond.any()
    assert not beyond[:, CELLS // 2 :].any()
    within = found.light[0, 1, :, -1:]
    np.testing.assert_allclose(found.light[0, 1], np.repeat(within, CELLS, 1))
