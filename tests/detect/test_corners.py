"""Checkerboards drawn from a formula, and a ChArUco board seen in perspective."""

import cv2
import numpy as np
import pytest
from drawn_grids import View, checkerboard, draw, photograph

from lensfit.detect.corners import find_charuco, find_checkerboard
from lensfit.errors import DetectionError

VIEW = View(pitch_px=26.0)
COLUMNS, ROWS = 9, 6


def errors(found, view=VIEW, columns=COLUMNS, rows=ROWS):
    """Found minus true positions, pixels, after matching the whole-number origin."""
    half = (np.array([columns, rows]) - 1) / 2
    place = view.lattice(found.points_px) + half
    origin = np.round(np.median(place - found.lattice, axis=0))
    truth = view.pixels(found.lattice + origin - half, found.points_px)
    return found.points_px - truth


@pytest.mark.parametrize("blur_px", [0.5, 1.0, 2.0])
def test_corners_of_a_noiseless_board_are_unbiased(blur_px):
    image = draw(VIEW, checkerboard(COLUMNS, ROWS), blur_px=blur_px)
    found = find_checkerboard(photograph(image))
    assert len(found) == COLUMNS * ROWS
    assert found.lattice.max(0).tolist() == [COLUMNS - 1, ROWS - 1]
    error = errors(found)
    assert np.abs(error.mean(0)).max() < 0.005
    assert np.sqrt((error**2).mean()) < 0.01


def test_indices_run_right_and_down_and_survive_fish_eye_distortion():
    view = View(pitch_px=32.0, rotation_rad=-0.5, radial=0.8, perspective=(0.1, 0.1))
    found = find_checkerboard(photograph(draw(view, checkerboard(7, 5), blur_px=0.7)))
    assert len(found) >= 20
    assert np.abs(errors(found, view, 7, 5)).max() < 0.1


def test_a_board_cut_by_the_frame_gives_every_corner_that_is_seen():
    view = View(pitch_px=40.0, offset_px=(-60.0, 35.0))
    found = find_checkerboard(photograph(draw(view, checkerboard(8, 8), blur_px=0.7)))
    i, j = np.meshgrid(np.arange(8) - 3.5, np.arange(8) - 3.5)
    lattice = np.stack([i.ravel(), j.ravel()], -1)
    start = lattice * 40 + np.array(view.size_px) / 2 + view.offset_px
    corners = view.pixels(lattice, start)
    seen = ((corners > 6) & (corners < np.array(view.size_px) - 6)).all(1)
    assert len(found) >= seen.sum() - 1
    assert np.abs(errors(found, view, 8, 8)).max() < 0.05


def test_scatter_matches_the_stated_covariance():
    chi = []
    for seed in range(3):
        image = draw(VIEW, checkerboard(9, 6), blur_px=1.0, noise=0.03, seed=seed)
        found = find_checkerboard(photograph(image))
        error = errors(found)
        weight = np.linalg.inv(found.covariance_px2)
        chi.append(np.einsum("ni,nij,nj->n", error, weight, error))
    assert 0.85 < np.sqrt(np.concatenate(chi).mean() / 2) < 1.2


def test_uneven_light_moves_no_corner():
    def shade(place):
        return 0.15 + 0.85 * place[..., 0]

    board = checkerboard(COLUMNS, ROWS)
    found = find_checkerboard(photograph(draw(VIEW, board, blur_px=1, shade=shade)))
    assert len(found) == COLUMNS * ROWS
    assert np.sqrt((errors(found) ** 2).mean()) < 0.01
    expected = 0.8 * shade(found.points_px / VIEW.size_px)
    assert np.abs(found.flux[:, 0] / expected - 1).max() < 0.05


def test_colours_are_measured_apart():
    board = checkerboard(COLUMNS, ROWS)
    shifts = np.array([[0.3, -0.1], [0.0, 0.0], [-0.25, 0.2]])
    channels = [draw(VIEW.shifted(*shift), board, blur_px=0.8) for shift in shifts]
    found = find_checkerboard(photograph(*channels))
    moved = found.channel_points_px - found.points_px
    assert np.abs(moved - shifts[:, None]).max() < 0.03


def test_texture_is_refused_in_one_sentence():
    noise = np.random.default_rng(2).normal(0.5, 0.1, (240, 300))
    for image in (noise, np.full((240, 300), 0.3)):
        with pytest.raises(DetectionError, match="no checkerboard found"):
            find_checkerboard(photograph(image))


def test_charuco_corners_have_the_boards_own_indices():
    squares, ratio, dictionary = (7, 5), 0.7, "DICT_4X4_50"
    names = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
    pattern = cv2.aruco.CharucoBoard(squares, 1.0, ratio, names)
    flat = pattern.generateImage((1400, 1000)) / 255.0
    onto = np.array([[0.33, 0.04, 40.3], [-0.02, 0.36, 30.6], [1e-5, 5e-5, 1.0]])
    supersampled = cv2.warpPerspective(
        flat.astype(np.float32), np.diag([3, 3, 1]) @ onto, (1800, 1350), borderValue=1
    )
    image = cv2.GaussianBlur(supersampled, (0, 0), 2.4)
    image = image.reshape(450, 3, 600, 3).mean((1, 3))
    hidden = image.copy()
    hidden[:, :120] = 0.5
    board = {"squares": squares, "dictionary": dictionary, "marker_ratio": ratio}
    for picture, least in ((image, 24), (hidden, 12)):
        found = find_charuco(photograph(picture), board)
        assert len(found) >= least
        corner = np.c_[(found.lattice + 1) * 200, np.ones(len(found))] @ onto.T
        truth = corner[:, :2] / corner[:, 2:]
        error = found.points_px - truth
        assert np.abs(error - error.mean(0)).max() < 0.05
        assert np.abs(error.mean(0)).max() < 0.2
    with pytest.raises(DetectionError, match="not an ArUco dictionary"):
        find_charuco(photograph(image), {**board, "dictionary": "DICT_NONE"})
    with pytest.raises(DetectionError, match="no ChArUco board of 7 x 5"):
        find_charuco(photograph(np.full((200, 300), 0.5)), board)
