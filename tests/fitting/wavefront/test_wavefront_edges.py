"""The squares that meet in a checker corner, against a chart drawn on sixteenths."""

import cv2
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from drawn_squares import CELLS, FLAT, units_of, whole_chart
from scipy.ndimage import (
    distance_transform_edt,
    gaussian_filter,
    map_coordinates,
)

from lensfit.detect.corner_fit import WINDOW_PER_SQUARE, fit_corners, half_width_px
from lensfit.detect.marker_board import marker_board
from lensfit.fitting.wavefront.detected_edges import detected_corner
from lensfit.fitting.wavefront.edges import (
    is_square_ahead_bright,
    line_transfers,
    rim_transfers,
    square_transfers,
)

PERIOD, MOST, MARGIN_CELLS = 48, 40, 24
SIDES = {
    "almost square on": [[30.0, 3.0], [-2.0, 28.0]],
    "small, slanted": [[14.0, 6.0], [-5.0, 17.0]],
    "turned": [[60.0, -20.0], [25.0, 55.0]],
}
BEND = np.array([[[1.8, 0.4], [0.4, -1.0]], [[-0.6, 1.2], [1.2, 1.6]]])
"""Second derivatives of the image of squares of some 30 cells, in cells: edges bend by
a tenth of a cell within the patch."""


def chart(sides, blur_cells, wider=0.0, bend=FLAT):
    """Means over cells of the chart behind a Gaussian, its corner in the middle.

    Parameters
    ----------
    wider : Share by which bright squares are wider than dark ones would have it.
    """
    whole = whole_chart(sides, blur_cells, MARGIN_CELLS, wider=wider, bend=bend)
    return whole[MARGIN_CELLS:-MARGIN_CELLS, MARGIN_CELLS:-MARGIN_CELLS]


def from_waves(amplitudes, blur_cells):
    """Means over cells of waves behind a Gaussian."""
    down = 2 * np.pi / PERIOD * np.arange(-MOST, MOST + 1)[:, None]
    right = 2 * np.pi / PERIOD * np.arange(MOST + 1)
    seen = np.exp(-(blur_cells**2) * (down**2 + right**2) / 2)
    seen = seen * np.sinc(down / (2 * np.pi)) * np.sinc(right / (2 * np.pi))
    seen = seen * np.where(right > 0, 2, 1)
    middle = np.arange(CELLS) + 0.5 - CELLS / 2
    columns = np.exp(1j * np.outer(middle, right))
    return np.real(
        np.exp(1j * np.outer(middle, down)) @ (amplitudes * seen) @ columns.T
    )


@pytest.mark.parametrize("blur_cells", [0.5, 1.5, 3.0])
@pytest.mark.parametrize("sides", SIDES.values(), ids=SIDES.keys())
def test_a_corner_is_as_the_chart_drawn_finely(sides, blur_cells):
    drawn, _ = square_transfers(np.array([sides]), FLAT[None], [None], PERIOD, MOST)
    off = from_waves(drawn[0], blur_cells) - chart(np.array(sides), blur_cells)
    assert np.abs(off).max() < 3e-3
    assert np.sqrt(np.mean(off**2)) < 6e-4


def test_a_corner_of_bent_edges_is_as_the_chart_drawn_finely():
    sides = np.array(SIDES["almost square on"])
    drawn, _ = square_transfers(sides[None], BEND[None], [None], PERIOD, MOST)
    bent, straight = (chart(sides, 1.0, bend=bend) for bend in (BEND, FLAT))
    off = from_waves(drawn[0], 1.0) - bent
    assert np.sqrt(np.mean((bent - straight) ** 2)) > 5e-3
    assert np.abs(off).max() < 3e-3
    assert np.sqrt(np.mean(off**2)) < 6e-4


@pytest.mark.parametrize("sides", SIDES.values(), ids=SIDES.keys())
def test_larger_bright_squares_move_every_edge_alike(sides):
    _, change = square_transfers(np.array([sides]), FLAT[None], [None], PERIOD, MOST)
    larger, smaller = (chart(np.array(sides), 1.5, wider) for wider in (0.01, -0.01))
    slope = (larger - smaller) / 0.02
    off = from_waves(change[0], 1.5) - slope
    # Where edges cross, both move: to first order their lines add up.
    assert np.linalg.norm(off) < 0.05 * np.linalg.norm(slope)


def printed_board(sides, corner, blur_cells, wider=0.0, fine=16):
    """Means over cells of a ChArUco board of OpenCV's behind a Gaussian, about a
    corner; where bright areas are wider, by so much of a square."""
    per_square = 240
    size = BOARD.getChessboardSize()
    picture = BOARD.generateImage(tuple(n * per_square for n in size), marginSize=0)
    away = distance_transform_edt(picture < 128)
    picture = (away <= wider / 2 * per_square).astype(float)
    wide = CELLS + 2 * MARGIN_CELLS
    along = (np.arange(wide * fine) + 0.5) / fine - wide / 2
    places = np.stack(np.meshgrid(along, along), -1) @ np.linalg.inv(sides).T
    at = np.moveaxis((places + corner + 1) * per_square - 0.5, -1, 0)[::-1]
    seen = map_coordinates(picture, at, order=0, mode="nearest")
    blurred = gaussian_filter(seen, blur_cells * fine, truncate=6)
    cells = blurred.reshape(wide, fine, wide, fine).mean((1, 3))
    return cells[MARGIN_CELLS:-MARGIN_CELLS, MARGIN_CELLS:-MARGIN_CELLS]


BOARD = cv2.aruco.CharucoBoard(
    (9, 7), 1.0, 0.7, cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_5X5_250)
)
BOARD_SIDES = np.array([[17.0, 1.2], [-0.9, 15.0]])


@pytest.mark.parametrize("corner", [(3, 2), (4, 2)], ids=["bright ahead", "dark ahead"])
def test_a_corner_between_markers_is_as_the_board_drawn_finely(corner):
    markers = marker_board(BOARD)
    ahead = markers.is_bright_ahead(np.array([corner]))[0]
    sides = BOARD_SIDES * ([1, 1] if ahead else [-1, 1])
    drawn, change = square_transfers(
        np.array([sides]), FLAT[None], [markers.about(np.array(corner))], PERIOD, MOST
    )
    plain = printed_board(BOARD_SIDES, corner, 1.5)
    off = from_waves(drawn[0], 1.5) - plain
    assert np.abs(off).max() < 6e-3
    assert np.sqrt(np.mean(off**2)) < 2e-3
    slope = (printed_board(BOARD_SIDES, corner, 1.5, 0.05) - plain) / 0.05
    # Ends of edges, of which a marker has many, add up to first order.
    off = from_waves(change[0], 1.5) - slope
    assert np.linalg.norm(off) < 0.15 * np.linalg.norm(slope)


LINES = {
    "broad, near a crossing": ([4.0, 7.2], [0.2, 0.2]),
    "thin": ([3.0, 5.5], [0.06, 0.06]),
    "of oblong cells": ([2.0, 1.4], [0.1, 0.15]),
}


def lines(sides, place, width, blur_cells, fine=16, around=MARGIN_CELLS):
    """Means over cells of bright lines behind a Gaussian, about a place on the grid."""
    wide = CELLS + 2 * around
    along = (np.arange(wide * fine) + 0.5) / fine - wide / 2
    places = np.stack(np.meshgrid(along, along), -1) @ np.linalg.inv(sides).T + place
    off = np.abs(places - np.round(places))
    blurred = (off < np.asarray(width) / 2).any(-1).astype(float)
    blurred = gaussian_filter(blurred, blur_cells * fine, truncate=6)
    drawn = blurred.reshape(wide, fine, wide, fine).mean((1, 3))
    return drawn[around:-around, around:-around]


@pytest.mark.slow
@pytest.mark.parametrize("dark", [False, True], ids=["bright", "dark"])
@pytest.mark.parametrize("blur_cells", [0.5, 1.5, 3.0])
@pytest.mark.parametrize("name", LINES)
def test_lines_are_as_the_chart_drawn_finely(name, blur_cells, dark):
    place, width = LINES[name]
    sides = np.array(SIDES["almost square on"])
    known = np.array([sides]), FLAT[None], np.array([place])
    signed = (-1 if dark else 1) * np.array([width])
    drawn, _ = line_transfers(*known, signed, PERIOD, MOST)
    wanted = lines(sides, place, width, blur_cells)
    off = from_waves(drawn[0], blur_cells) - (1 - wanted if dark else wanted)
    assert np.abs(off).max() < 6e-3
    assert np.sqrt(np.mean(off**2)) < 1e-3


@pytest.mark.parametrize("name", LINES)
def test_wider_lines_move_both_edges_alike(name):
    place, width = LINES[name]
    sides = np.array(SIDES["almost square on"])
    known = np.array([sides]), FLAT[None], np.array([place]), np.array([width])
    _, change = line_transfers(*known, PERIOD, MOST)
    share = 0.1
    wider, thinner = (
        lines(sides, place, (1 + s * share) * np.array(width), 1.5) for s in (1, -1)
    )
    slope = (wider - thinner) / (2 * share)
    off = from_waves(change[0], 1.5) - slope
    assert np.linalg.norm(off) < 0.1 * np.linalg.norm(slope)


def test_the_bright_square_is_told_whichever_side_comes_first():
    sides = np.array(SIDES["turned"])
    flipped = sides * [-1.0, 1.0]
    picture = chart(sides, 1.0)[None].repeat(2, 0)
    middle = np.full((2, 2), CELLS / 2)
    use = np.ones(picture.shape, bool)
    found = is_square_ahead_bright(picture, use, middle, np.stack([sides, flipped]))
    np.testing.assert_array_equal(found, [True, False])
    np.testing.assert_array_equal(
        is_square_ahead_bright(1 - picture, use, middle, np.stack([sides, flipped])),
        ~found,
    )


LOPSIDED = ((0.5, 0.0, 0.0, 0.7), (0.3, 1.2, 0.4, 1.2), (0.2, 2.4, 0.8, 1.8))
"""Weight, place right and down, and deviation of Gaussians: a blur like coma."""


def lopsided(sides):
    """The chart behind that blur, beyond the patch too."""
    blurred = 0.0
    for weight, right, down, deviation in LOPSIDED:
        one = np.fft.fft2(whole_chart(sides, deviation, MARGIN_CELLS))
        ky, kx = (2 * np.pi * np.fft.fftfreq(n) for n in one.shape)
        moved = one * np.exp(-1j * (ky[:, None] * down + kx * right))
        blurred = blurred + weight * np.real(np.fft.ifft2(moved))
    return blurred


def places():
    """Of the cells from the middle."""
    along = np.arange(CELLS) + 0.5 - CELLS / 2
    return jnp.asarray(np.stack(np.meshgrid(along, along), -1))


@pytest.mark.slow
@pytest.mark.parametrize("sides", list(SIDES.values())[:2], ids=list(SIDES)[:2])
def test_the_modelled_corner_is_where_detection_finds_it(sides):
    """On a picture whose edges are blurred to one side, which moves corners."""
    sides = np.array(sides)
    wide = lopsided(sides)
    middle = np.array([wide.shape]) / 2
    found = fit_corners(wide, middle, sides.T[None].copy())
    off = (found.points_px - middle)[0]
    assert np.hypot(*off) > 0.3
    patch = jnp.asarray(wide[MARGIN_CELLS:-MARGIN_CELLS, MARGIN_CELLS:-MARGIN_CELLS])
    window = jnp.asarray(float(half_width_px(found.blur_px)))
    # In single precision, as the fit draws.
    seen = patch, places(), jnp.asarray(sides), window, jnp.asarray(WINDOW_PER_SQUARE)
    modelled = detected_corner(*(part.astype(jnp.float32) for part in seen))
    np.testing.assert_allclose(modelled, off, atol=2e-3)


@pytest.mark.slow
def test_a_modelled_corner_goes_with_its_image():
    sides, window = np.array(SIDES["almost square on"]), jnp.asarray(7.0)
    patch = jnp.asarray(chart(sides, 1.2))
    change = jnp.roll(jnp.asarray(chart(sides, 1.6)), 1, 1) - patch

    def at(share):
        seen = patch + share * change
        square = jnp.asarray(WINDOW_PER_SQUARE)
        return detected_corner(seen, places(), jnp.asarray(sides), window, square)

    slope = jax.jacfwd(at)(jnp.asarray(0.0))
    ends = [np.asarray(at(jnp.asarray(share))) for share in (0.02, -0.02)]
    np.testing.assert_allclose(slope, (ends[0] - ends[1]) / 0.04, atol=0.03)


def dots_drawn(disc, to_middle, beside, blur_cells, fine=16, bend=FLAT):
    """Means over cells of a dot and one beside it about a place on its rim."""
    count = (CELLS + 2 * MARGIN_CELLS) * fine
    along = (np.arange(count) + 0.5) / fine - (CELLS / 2 + MARGIN_CELLS)
    places = np.stack(np.meshgrid(along, along), -1)
    light = np.zeros((count, count))
    units = units_of(places, disc, bend)
    for middle in (to_middle, to_middle + beside):
        unit = units - units_of(middle, disc, bend)
        light += np.hypot(unit[..., 0], unit[..., 1]) < 1
    blurred = gaussian_filter(light, blur_cells * fine, truncate=6)
    wide = CELLS + 2 * MARGIN_CELLS
    cells = blurred.reshape(wide, fine, wide, fine).mean((1, 3))
    return cells[MARGIN_CELLS:-MARGIN_CELLS, MARGIN_CELLS:-MARGIN_CELLS]


@pytest.mark.slow
@pytest.mark.parametrize("blur_cells", [0.5, 1.5, 3.0])
@pytest.mark.parametrize("radius_cells", [10.0, 24.0, 60.0])
def test_a_rim_is_as_the_dots_drawn_finely(radius_cells, blur_cells):
    disc = radius_cells * np.array([[1.0, 0.1], [-0.05, 0.8]])
    towards = np.array([0.6, -0.8])
    to_middle, beside = -disc @ towards, disc @ np.array([2.3, -0.4])
    known = disc[None], FLAT[None], to_middle[None], beside[None, None]
    drawn = rim_transfers(*known, PERIOD, MOST)
    truth = dots_drawn(disc, to_middle, beside, blur_cells)
    off = from_waves(drawn[0], blur_cells) - truth
    # Less than .8 % of the contrast where half a cell of blur is all there is.
    assert np.abs(off).max() < (8e-3 if blur_cells < 1 else 3e-3)
    assert np.sqrt(np.mean(off**2)) < 1e-3


@pytest.mark.slow
def test_a_bent_rim_is_as_the_dots_drawn_finely():
    disc, bend = 24.0 * np.array([[1.0, 0.1], [-0.05, 0.8]]), BEND
    to_middle, beside = -disc @ np.array([0.6, -0.8]), disc @ np.array([2.3, -0.4])
    known = disc[None], bend[None], to_middle[None], beside[None, None]
    drawn = rim_transfers(*known, PERIOD, MOST)
    bent = dots_drawn(disc, to_middle, beside, 1.0, bend=bend)
    straight = dots_drawn(disc, to_middle, beside, 1.0)
    assert np.sqrt(np.mean((bent - straight) ** 2)) > 8e-3
    off = from_waves(drawn[0], 1.0) - bent
    assert np.sqrt(np.mean(off**2)) < 0.1 * np.sqrt(np.mean((bent - straight) ** 2))
