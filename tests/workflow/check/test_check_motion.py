"""Motion: a smear of known length and direction; the blur of a lens is none."""

import numpy as np
import pytest
from drawn_views import (
    PITCH_PX,
    SIZE_PX,
    dot_centres,
    dots,
    gaussian,
    moved,
    photograph,
)

from lensfit.detect.directional_blur import DirectionalBlur, directional_blur
from lensfit.detect.find import observe
from lensfit.detect.lattice_map import lattice_map
from lensfit.workflow.check.motion import motion_of

FINE = 4


def motion_seen(length_px: float, angle_deg: float):
    kernel = gaussian(np.eye(2) * FINE**2)
    if length_px:
        kernel = moved(kernel, length_px * FINE, angle_deg)
    picture = dots(dot_centres(), 3.0, np.eye(2), kernel=kernel)
    found = observe(photograph(picture), "dot-grid")
    mapped = lattice_map(found)
    assert mapped is not None
    blur = directional_blur(
        photograph(picture), found, mapped, "dot-grid", 3.0 / PITCH_PX
    )
    assert blur is not None
    motion = motion_of(blur, SIZE_PX)
    assert motion is not None
    return motion


@pytest.mark.parametrize(
    ("length_px", "angle_deg"), [(3.0, 0.0), (5.0, 30.0), (8.0, 115.0)]
)
def test_a_smear_is_found_with_its_length_and_direction(length_px, angle_deg):
    motion = motion_seen(length_px, angle_deg)
    assert motion.moved
    assert motion.length_px == pytest.approx(length_px, rel=0.12)
    away = (motion.direction_deg - angle_deg + 90) % 180 - 90
    assert abs(away) < 4


def test_a_still_camera_has_not_moved():
    motion = motion_seen(0.0, 0.0)
    assert not motion.moved
    assert motion.length_px < 2.0


def test_astigmatism_and_a_tilted_field_are_no_motion():
    """Blur along the radius four times that across it at the corner, and twice the
    defocus on one side as on the other."""
    rng = np.random.default_rng(3)
    points = rng.uniform(0, 1, (300, 2)) * SIZE_PX
    place = (points - np.array(SIZE_PX) / 2) / 500
    ways = np.array([[1, 0], [np.sqrt(0.5)] * 2, [0, 1]])
    isotropic = 0.5 + (0.6 + 0.3 * place[:, :1]) ** 2
    variance = isotropic + 2.0 * (place @ ways.T) ** 2
    variance += rng.normal(0, 0.03, variance.shape)
    blur = DirectionalBlur(
        np.repeat(points, 3, 0), np.tile(ways, (300, 1)), variance.ravel()
    )
    motion = motion_of(blur, SIZE_PX)
    assert motion is not None
    assert not motion.moved


def test_too_few_samples_say_nothing():
    blur = DirectionalBlur(np.zeros((9, 2)), np.tile([1.0, 0.0], (9, 1)), np.ones(9))
    assert motion_of(blur, SIZE_PX) is None
