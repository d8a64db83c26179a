"""Start poses: exact where there is no distortion, and refusals in words."""

from dataclasses import replace

import numpy as np
import pytest
from pinhole_shoot import FRONTAL, LATTICE, PITCH_MM, Camera, shoot
from scipy.spatial.transform import Rotation

from lensfit.errors import FitError
from lensfit.fitting.chart_view import View
from lensfit.fitting.geometric_start import start_of
from lensfit.fitting.start_poses import (
    focal_length_from_homographies,
    pose_from_homography,
)

BOARD_MM = LATTICE * PITCH_MM
CENTRED = Camera(centre_mm=(0.0, 0.0))


@pytest.mark.parametrize("view", range(3))
def test_pose_of_an_undistorted_view_is_exact(view):
    pose = pose_from_homography(
        BOARD_MM, CENTRED.marks_mm(view), CENTRED.focal_length_mm, "here"
    )
    truth = Rotation.from_rotvec(CENTRED.rotations[view]).as_matrix()
    np.testing.assert_allclose(pose.rotation, truth, atol=1e-6)
    in_camera = BOARD_MM @ pose.rotation[:, :2].T + pose.translation_mm
    np.testing.assert_allclose(
        in_camera, CENTRED.camera_axes(view, BOARD_MM), atol=2e-3
    )


def test_pose_of_a_distorted_view_is_near():
    camera = Camera(k=(-0.15, 0.05), p=(1e-3, -1e-3))
    pose = pose_from_homography(BOARD_MM, camera.marks_mm(0), 30.0, "here")
    truth = Rotation.from_rotvec(camera.rotations[0])
    off = (Rotation.from_matrix(pose.rotation) * truth.inv()).magnitude()
    assert off < 0.06
    assert abs(pose.translation_mm[2] / 900 - 1) < 0.05


def test_rotation_is_a_rotation_however_wrong_the_focal_length():
    pose = pose_from_homography(BOARD_MM, CENTRED.marks_mm(1), 12.0, "here")
    np.testing.assert_allclose(pose.rotation @ pose.rotation.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(pose.rotation) > 0


@pytest.mark.parametrize("axis", [[1.0, 0.0], [0.6, 0.8]])
def test_marks_on_one_line_are_refused(axis):
    board = np.linspace(-200, 200, 30)[:, None] * axis
    image = CENTRED.image_mm(CENTRED.camera_axes(0, board))
    with pytest.raises(FitError, match="row 3: the points lie on one line"):
        pose_from_homography(board, image, 30.0, "row 3")


def test_a_mirrored_lattice_is_refused():
    with pytest.raises(FitError, match="numbered as on the target"):
        pose_from_homography(BOARD_MM * [-1, 1], CENTRED.marks_mm(0), 30.0, "here")


@pytest.mark.parametrize("focal_length_mm", [12.0, 30.6, 85.0])
def test_focal_length_of_tilted_views_is_exact(focal_length_mm):
    camera = Camera(focal_length_mm=focal_length_mm, centre_mm=(0.0, 0.0))
    images = [camera.marks_mm(k) for k in range(3)]
    found = focal_length_from_homographies([BOARD_MM] * 3, images)
    assert found is not None
    assert abs(found / focal_length_mm - 1) < 1e-6


@pytest.mark.parametrize("rotations", [FRONTAL, ((0.0, 0.0, 0.0),) * 3])
def test_frontal_views_are_silent_about_the_focal_length(rotations):
    camera = Camera(k=(-0.12, 0.06), rotations=rotations)
    noise = np.random.default_rng(0).normal(0, 5e-4, (3, *BOARD_MM.shape))
    images = [camera.marks_mm(k) + noise[k] for k in range(3)]
    assert focal_length_from_homographies([BOARD_MM] * 3, images) is None


def test_a_tilt_that_the_stated_focal_length_makes_small_proves_no_long_lens():
    """Distortion and a tilt of five degrees look like a long lens tilted much."""
    tilted = ((0.0, 0.0, 0.0), (0.0, 0.09, 0.0), (0.15, 0.0, 0.0))
    camera = Camera(focal_length_mm=60.0, centre_mm=(0.0, 0.0), rotations=tilted)
    images = [camera.marks_mm(k) for k in range(3)]
    boards = [BOARD_MM] * 3
    alone = focal_length_from_homographies(boards, images)
    assert alone == pytest.approx(60.0, rel=1e-5)
    assert focal_length_from_homographies(boards, images, 50.0) == alone
    assert focal_length_from_homographies(boards, images, 20.0) is None


SQUEEZE = 1.8


def squeezed_shoot(camera: Camera, **changes) -> list[View]:
    """What a lens of the camera's focal length, its geometric mean, makes of it."""
    takes = []
    for take in shoot(camera):
        seen = take.observations
        middle = np.asarray(seen.image_size_px) / 2
        squeezed = (seen.points_px - middle) * [SQUEEZE**-0.5, SQUEEZE**0.5] + middle
        seen = replace(seen, points_px=squeezed)
        takes.append(replace(take, observations=seen, squeeze=SQUEEZE, **changes))
    return takes


@pytest.mark.parametrize("engraved_mm", [50.0, 50.0 * SQUEEZE**0.5])
def test_a_squeezed_shoot_starts_from_its_own_focal_length(engraved_mm):
    """An anamorphic lens halves one axis; that is no shorter focal length."""
    camera = Camera(focal_length_mm=50.0, centre_mm=(0.0, 0.0))
    takes = squeezed_shoot(camera, focal_length_mm=engraved_mm)
    start = start_of(takes, takes)
    np.testing.assert_allclose(start.frame.stated_focal_length_mm, 50.0, rtol=0.02)
    assert not start.notes


@pytest.mark.parametrize("engraved_mm", [50.0, 50.0 * SQUEEZE**0.5])
def test_a_measured_distance_tells_what_an_engraved_focal_length_means(engraved_mm):
    """To the few percent by which a lens that is focused near draws larger."""
    camera = Camera(focal_length_mm=50.0, centre_mm=(0.0, 0.0), rotations=FRONTAL)
    distances = {"target_distance_mm": 50.0 + camera.distance_mm}
    takes = squeezed_shoot(camera, focal_length_mm=engraved_mm, **distances)[:1]
    start = start_of(takes, takes)
    np.testing.assert_allclose(start.frame.stated_focal_length_mm, 50.0, rtol=0.06)
    assert not start.notes


def test_the_focal_length_of_the_squeezed_axis_is_told_from_the_engraved_one():
    camera = Camera(focal_length_mm=50.0, centre_mm=(0.0, 0.0), rotations=FRONTAL)
    takes = squeezed_shoot(
        camera,
        focal_length_mm=50.0 / SQUEEZE**0.5,
        target_distance_mm=50.0 + camera.distance_mm,
    )[:1]
    start = start_of(takes, takes)
    np.testing.assert_allclose(start.frame.stated_focal_length_mm, 50.0, rtol=0.06)
    (note,) = start.notes
    assert "state 67.08" in note


def test_an_engraved_focal_length_is_that_of_the_axis_that_is_not_squeezed():
    camera = Camera(focal_length_mm=50.0, centre_mm=(0.0, 0.0), rotations=FRONTAL)
    takes = squeezed_shoot(camera, focal_length_mm=50.0 * SQUEEZE**0.5)
    start = start_of(takes, takes)
    np.testing.assert_allclose(start.frame.stated_focal_length_mm, 50.0, rtol=1e-9)


def test_states_of_one_lens_share_a_layout_and_keep_their_own_largest_model():
    few, many = shoot(Camera())[:1], shoot(Camera())
    many = [replace(take, focus_distance_mm=900.0, f_number=2.0) for take in many]
    many[0] = replace(many[0], f_number=8.0)
    few = [replace(take, focus_distance_mm=2000.0) for take in few]
    starts = [start_of(state, few + many) for state in (few, many)]
    assert starts[0].layout == starts[1].layout == starts[1].largest
    assert starts[0].largest.free_degree < starts[0].layout.free_degree
    assert starts[0].largest.apertures == 0 < starts[0].layout.apertures


def test_chief_rays_have_the_layout_of_centroids_and_no_shifts_of_their_own():
    """One program fits both; only the largest model knows that nothing shifts."""
    centroids = [
        replace(view, f_number=f_number)
        for view, f_number in zip(shoot(CENTRED), (2.0, 4.0, 8.0), strict=True)
    ]
    chief_rays = [replace(view, chief_rays=True) for view in centroids]
    before, after = (start_of(views, views) for views in (centroids, chief_rays))
    assert after.layout == before.layout
    assert (before.largest.apertures, after.largest.apertures) == (2, 0)
    assert before.stack.view.aperture.tolist() == [2, 1, 0]
    assert after.stack.view.aperture.tolist() == [0, 0, 0]
