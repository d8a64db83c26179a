"""The print of ChArUco boards against OpenCV's own picture of them."""

import cv2
import numpy as np
import pytest

from data_synth.chart import DICTIONARY, MARKER_RATIO, Chart, pattern_coverage
from lensfit.detect.marker_board import dark_share, marker_board

SQUARE_PX = 40


def board_of(size, legacy=False, ratio=0.7):
    markers = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, DICTIONARY))
    board = cv2.aruco.CharucoBoard(size, 1.0, ratio, markers)
    board.setLegacyPattern(legacy)
    return board


def white(board, places, box):
    """Means over boxes of bright squares without their dark modules."""
    column, row = np.moveaxis(np.floor(places).astype(int), -1, 0)
    bright = board.dark.any((2, 3))[row, column]
    return bright - dark_share(board.dark, board.ratio, places, box)


@pytest.mark.parametrize("legacy", [False, True])
@pytest.mark.parametrize("size", [(7, 6), (8, 5)])
def test_every_pixel_is_opencvs(size, legacy):
    board = board_of(size, legacy)
    picture = board.generateImage(tuple(SQUARE_PX * n for n in size), marginSize=0)
    rows, columns = picture.shape
    places = np.stack(np.meshgrid(np.arange(columns), np.arange(rows)), -1)
    found = white(
        marker_board(board), (places + 0.5) / SQUARE_PX, np.full(2, 1 / SQUARE_PX)
    )
    np.testing.assert_allclose(found, picture / 255, atol=1e-5)


@pytest.mark.parametrize("corner", [(0, 0), (1, 0), (5, 4)])
def test_the_squares_about_a_corner_are_those_of_the_board(corner):
    whole = marker_board(board_of((7, 6)))
    ahead = whole.is_bright_ahead(np.array([corner]))[0]
    assert ahead == bool((sum(corner)) % 2)
    some = np.random.default_rng(1).uniform(-0.99, 0.99, (200, 2))
    box = np.full(2, 0.01)
    of_whole = dark_share(whole.dark, whole.ratio, some + corner + 1, box)
    about = whole.about(np.array(corner))
    mirrored = some if ahead else some * [-1, 1]
    of_part = dark_share(about.dark, about.ratio, mirrored + 2, box)
    np.testing.assert_allclose(of_part, of_whole, atol=1e-9)


def test_photographs_are_made_of_the_same_board():
    """`data_synth` averages OpenCV's picture, and knows no modules."""
    chart = Chart("charuco", 10.0, squares=(9, 7))
    rng = np.random.default_rng(0)
    places_mm = rng.uniform([-39, -29], [49, 39], (4000, 2))
    box_mm = np.array([0.37, 0.3])
    board = marker_board(board_of((9, 7), ratio=MARKER_RATIO))
    places = places_mm / 10 + [4, 3]
    inside = np.abs(places - np.round(places)).min(1) > 0.02  # not across two squares
    assert inside.mean() > 0.8
    seen = pattern_coverage(chart, places_mm, np.broadcast_to(box_mm, (4000, 2)))
    expected = white(board, places, box_mm / 10)
    np.testing.assert_allclose(seen[inside], expected[inside], atol=1e-5)
