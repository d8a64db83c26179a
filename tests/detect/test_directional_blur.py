"""Blur along directions against the covariance that pictures were drawn with."""

import cv2
import numpy as np
import pytest
from drawn_views import PITCH_PX, SIZE_PX, dot_centres, dots, finished, photograph

from lensfit.detect.directional_blur import DirectionalBlur, directional_blur
from lensfit.detect.find import observe
from lensfit.detect.lattice_map import lattice_map

PIXEL = np.eye(2) / 12


def measured(picture: np.ndarray, kind: str, feature_px: float | None):
    found = observe(photograph(picture), kind)
    mapped = lattice_map(found)
    assert mapped is not None
    pitches = None if feature_px is None else feature_px / PITCH_PX
    blur = directional_blur(photograph(picture), found, mapped, kind, pitches)
    assert blur is not None
    return blur


def along(blur: DirectionalBlur, way: tuple[float, float]) -> float:
    """Median variance of the samples along a direction."""
    same = np.abs(blur.direction @ np.array(way)) > 0.999
    assert same.sum() > 9
    return float(np.median(blur.variance_px2[same]))


@pytest.mark.parametrize("covariance", [np.diag([0.8, 0.8]), np.diag([2.5, 0.9])])
def test_small_dots_show_the_second_moments(covariance):
    blur = measured(dots(dot_centres(), 3.0, covariance), "dot-grid", 3.0)
    true = covariance + PIXEL
    assert along(blur, (1, 0)) == pytest.approx(true[0, 0], rel=0.06)
    assert along(blur, (0, 1)) == pytest.approx(true[1, 1], rel=0.06)


@pytest.mark.parametrize("variance", [0.5, 2.0])
def test_rims_of_large_dots_show_the_blur_across_them(variance):
    covariance = np.diag([2 * variance, variance])
    picture = dots(dot_centres(), 18.0, covariance, dark=True)
    blur = measured(picture, "dot-grid", 18.0)
    assert along(blur, (1, 0)) == pytest.approx(2 * variance + 1 / 12, rel=0.15)
    assert along(blur, (0, 1)) == pytest.approx(variance + 1 / 12, rel=0.15)


@pytest.mark.parametrize("kind", ["checkerboard", "line-grid"])
def test_edges_and_lines_show_the_blur_across_them(kind):
    fine, width_px, covariance = 4, 3.0, np.diag([1.8, 0.7])
    x = (np.arange(SIZE_PX[0] * fine) + 0.5) / fine - 0.31
    y = (np.arange(SIZE_PX[1] * fine) + 0.5) / fine - 0.17
    if kind == "checkerboard":
        rows = np.floor(y / PITCH_PX)[:, None] + np.floor(x / PITCH_PX)
        sharp = np.mod(rows, 2)
    else:
        on = [np.abs(np.mod(t, PITCH_PX) - PITCH_PX / 2) < width_px / 2 for t in (x, y)]
        sharp = on[1][:, None] | on[0][None]
    picture = finished(sharp.astype(np.float32), fine, covariance)
    blur = measured(picture, kind, width_px if kind == "line-grid" else None)
    assert along(blur, (1, 0)) == pytest.approx(1.8 + 1 / 12, rel=0.2)
    assert along(blur, (0, 1)) == pytest.approx(0.7 + 1 / 12, rel=0.2)


def test_a_lattice_seen_through_a_shear_has_its_matrix_everywhere():
    shear = np.array([[1.02, 0.05], [-0.03, 0.97]])
    centres = (dot_centres() - 400) @ shear.T + 400
    inside = ((centres > 10) & (centres < np.array(SIZE_PX) - 10)).all(1)
    picture = cv2.GaussianBlur(dots(centres[inside], 4.0, np.eye(2)), (0, 0), 0.5)
    found = observe(photograph(picture), "dot-grid")
    mapped = lattice_map(found)
    assert mapped is not None
    cells = mapped.jacobians_px(found.lattice)
    assert np.allclose(cells, PITCH_PX * shear, atol=0.05)
    middle = np.array([400.0, 300.0])
    there = mapped.points_px(mapped.lattice_at(middle)[None])[0]
    assert np.allclose(there, middle, atol=1e-6)
