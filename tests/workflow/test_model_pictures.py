"""The model's picture of a photograph: areas, places and levels that can be told."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import cv2
import numpy as np
import pytest

from lensfit.fitting.wavefront.green_landings import RINGS, SPOKES, Landings
from lensfit.photograph import Photograph
from lensfit.workflow.calibration.small_photograph import small_of
from lensfit.workflow.pictures.chart_drawing import Drawing, modelled_light
from lensfit.workflow.pictures.chart_shapes import discs, lines, squares
from lensfit.workflow.pictures.model_pictures import pictures_of
from lensfit.workflow.pictures.predicted_points import DotLight, drawn_light

SHAPE = (60, 80)


def centroid(picture: np.ndarray) -> np.ndarray:
    y, x = np.mgrid[: picture.shape[0], : picture.shape[1]] + 0.5
    return np.array([(picture * x).sum(), (picture * y).sum()]) / picture.sum()


@pytest.mark.parametrize("radii", [(0.4, 0.4), (3.0, 3.0), (7.0, 2.5)])
def test_a_dot_has_its_area_and_its_place(radii):
    """A dot within a pixel tells its place no better than by a share of that pixel."""
    turn = np.array([[0.8, -0.6], [0.6, 0.8]])
    matrix = turn @ np.diag(radii)
    drawn = discs(np.array([[41.3, 28.7]]), matrix[None], SHAPE)
    assert drawn.sum() == pytest.approx(np.pi * np.prod(radii), rel=0.03)
    atol = 0.03 if min(radii) > 1 else 0.2
    np.testing.assert_allclose(centroid(drawn), (41.3, 28.7), atol=atol)
    assert drawn.max() <= 1.0


def test_a_dot_half_beyond_the_edge_is_half_there():
    whole = discs(np.array([[40.0, 30.0]]), 5 * np.eye(2)[None], SHAPE)
    half = discs(np.array([[0.0, 30.0]]), 5 * np.eye(2)[None], SHAPE)
    assert half.sum() == pytest.approx(whole.sum() / 2, rel=1e-3)


@pytest.mark.parametrize("width", [1.0, 3.4])
def test_a_line_has_its_width_wherever_it_lies_between_pixels(width):
    """A slanted line: every column holds its width over the cosine of the slant."""
    x = np.linspace(-2.0, 82.0, 12)
    points = np.stack([x, 20.3 + 0.1 * x], -1)
    slant = np.array([-0.1, 1.0]) / np.hypot(0.1, 1.0)
    seen = SimpleNamespace(
        family=np.ones(12, int),
        lattice=np.stack([x, np.zeros(12)], -1),
        normal=slant * np.where(np.arange(12) % 2, 1.0, -1.0)[:, None],
    )
    drawn = lines(points, seen, width, SHAPE)  # pyright: ignore[reportArgumentType]
    columns = drawn[:, 2:-2].sum(0)
    np.testing.assert_allclose(columns, width * np.hypot(0.1, 1.0), rtol=0.12)
    assert columns.mean() == pytest.approx(width * np.hypot(0.1, 1.0), rel=0.02)


def test_every_other_square_is_filled():
    i, j = np.meshgrid(np.arange(4), np.arange(3))
    lattice = np.stack([i.ravel(), j.ravel()], -1).astype(float)
    drawn = squares(lattice * 15 + (6.5, 8.25), lattice, SHAPE)
    assert drawn.sum() == pytest.approx(3 * 15**2, rel=0.01)
    assert drawn[15, 14] == pytest.approx(1.0, abs=0.05)
    assert drawn[15, 29] == 0.0


def light_of(radius_px: float, chief_px: tuple[float, float], sigma_px: float):
    """One dot whose rays fill an even disc: landing proportional to the reach."""
    square, _ = np.polynomial.legendre.leggauss(RINGS)
    azimuth = np.arange(SPOKES) * 2 * np.pi / SPOKES
    reach = np.sqrt((square + 1) / 2)
    outward = np.stack([np.cos(azimuth), np.sin(azimuth)], -1)[:, None]
    landed = radius_px * 0.01 * outward * reach[None, :, None]
    landings = Landings(
        np.tile(landed, (1, 3, 1, 1, 1)).astype(np.float32),
        np.full((1, SPOKES), 1 / SPOKES, np.float32),
    )
    return DotLight(
        landings, np.array([chief_px]), np.array([2.5]), np.full(2, 0.01), sigma_px
    )


def test_light_of_a_dot_is_kept_and_fills_its_disc():
    drawn = drawn_light(light_of(12.0, (40.2, 29.6), 0.3), (SHAPE[1], SHAPE[0]))
    assert drawn.sum() == pytest.approx(2.5, rel=1e-5)
    np.testing.assert_allclose(centroid(drawn), (40.2, 29.6), atol=0.05)
    y, x = np.mgrid[: SHAPE[0], : SHAPE[1]] + 0.5
    away = np.hypot(x - 40.2, y - 29.6)
    inner = drawn[away < 9]
    assert inner.mean() == pytest.approx(2.5 / (np.pi * 144), rel=0.02)
    assert inner.std() < 0.12 * inner.mean()
    assert drawn[away > 15].max() < 1e-3 * inner.mean()


def test_a_large_photograph_is_drawn_on_fewer_pixels():
    """Light of a pixel of the coarse picture is that of the fine ones it covers."""
    fine = drawn_light(light_of(14.0, (40.2, 29.6), 0.3), (80, 60))
    coarse = drawn_light(light_of(14.0, (40.2, 29.6), 0.3), (80, 60), 4)
    assert coarse.shape == (15, 20)
    summed = fine.reshape(15, 4, 20, 4).sum((1, 3))
    assert np.abs(coarse - summed).max() < 0.15 * summed.max()
    np.testing.assert_allclose(centroid(coarse) * 4, (40.2, 29.6), atol=0.3)


def test_light_beside_the_frame_is_lost_and_hurts_nothing():
    drawn = drawn_light(light_of(12.0, (-40.0, 300.0), 0.3), (SHAPE[1], SHAPE[0]))
    assert drawn.sum() == 0.0


@pytest.mark.parametrize("contrast", [3.0, -0.7])
def test_levels_of_bright_and_of_dark_marks_are_found(contrast):
    """What the model itself would photograph leaves nothing, dirt or no dirt."""
    points = np.stack(np.meshgrid(np.arange(8, 80, 9.5), np.arange(8, 60, 9.5)), -1)
    points = points.reshape(-1, 2)
    marks = discs(points, np.tile(2 * np.eye(2), (len(points), 1, 1)), SHAPE)
    fall_off = np.linspace(1, 0.6, SHAPE[1])[None] * np.ones(SHAPE)
    photograph = 0.1 + 0.8 * fall_off + contrast * fall_off * marks
    dirty = photograph.copy()
    dirty[24:30, 32:40] += 5 * abs(contrast)
    drawing = Drawing(marks, np.ones(SHAPE, bool), True)
    clean = modelled_light(photograph, drawing, fall_off)
    assert clean.explained > 1 - 1e-6
    np.testing.assert_allclose(clean.light, photograph, atol=1e-4)
    again = modelled_light(dirty, drawing, fall_off)
    np.testing.assert_allclose(again.light, photograph, atol=0.02)
    assert again.explained < 0.9


def test_uneven_light_is_the_charts_own_where_its_field_is_bright():
    """A lamp at the side: dark marks on paper show it, bright ones on black do not."""
    points = np.stack(np.meshgrid(np.arange(8, 80, 9.5), np.arange(8, 60, 9.5)), -1)
    points = points.reshape(-1, 2)
    marks = discs(points, np.tile(2 * np.eye(2), (len(points), 1, 1)), SHAPE)
    lamp = np.linspace(1, 0.5, SHAPE[1])[None] * np.linspace(0.8, 1, SHAPE[0])[:, None]
    photograph = lamp * (0.9 - 0.8 * marks)
    drawing, even = Drawing(marks, np.ones(SHAPE, bool), True), np.ones(SHAPE)
    assert modelled_light(photograph, drawing, even, dark=True).explained > 0.9999
    assert modelled_light(photograph, drawing, even).explained < 0.95


def test_a_drawing_is_softened_only_where_blur_was_not_measured():
    marks = discs(np.array([[40.0, 30.0]]), 6 * np.eye(2)[None], SHAPE)
    soft = modelled_light(marks, Drawing(marks, marks >= 0, True), np.ones(SHAPE)).light
    blurred = cv2.GaussianBlur(marks, (0, 0), 1.8)
    drawing = Drawing(marks, marks >= 0, False)
    found = modelled_light(blurred, drawing, np.ones(SHAPE))
    assert found.explained > 0.9999
    np.testing.assert_allclose(soft, marks, atol=1e-5)
    rigid = modelled_light(blurred, drawing._replace(blurred=True), np.ones(SHAPE))
    assert rigid.explained < found.explained


def test_colours_say_which_is_brighter_and_by_how_much():
    photograph = np.full(SHAPE, 1.0)
    model = photograph.copy()
    model[:30, :40] -= 0.04
    model[30:, 40:] += 0.04
    inside = np.ones(SHAPE, bool)
    inside[:, -5:] = False
    made = pictures_of(photograph, model, inside)
    assert made.left_share == 0.05
    blue, _, red = np.moveaxis(made.left.astype(int), -1, 0)
    assert (red - blue)[:30, :40].min() > 100
    assert (blue - red)[30:, 40:-5].min() > 100
    assert np.abs(red - blue)[:30, 45:].max() < 10
    assert np.abs(red - blue)[:, -5:].max() < 10


def test_a_photograph_is_reduced_by_area_whatever_it_holds():
    pixels = np.zeros((300, 2000, 3), np.float32)
    pixels[..., 1] = 0.25
    pixels[100:120, 500:520, 1] = 4000.0
    pixels[0, 0] = np.nan
    pixels[5, 5] = np.inf
    small = small_of(Photograph(pixels, Path("a.exr"), ""))
    assert small.light.shape == (210, 1400)
    assert small.scale == (0.7, 0.7)
    assert np.isfinite(small.light).all()
    black = small_of(Photograph(np.zeros((8, 6, 1), np.float32), Path("b.exr"), ""))
    assert black.light.shape == (8, 6)
    assert not black.light.any()


def test_a_broad_dot_has_a_rim_and_keeps_its_light():
    """A point of light through an oval: even inside, nothing outside."""
    oval = np.array([[9.0, 1.0], [0.5, 6.0]])
    dot = replace(light_of(0.0, (40.2, 29.6), 0.1), disc_px=oval)
    drawn = drawn_light(dot, (SHAPE[1], SHAPE[0]))
    assert drawn.sum() == pytest.approx(2.5, rel=1e-5)
    np.testing.assert_allclose(centroid(drawn), (40.2, 29.6), atol=0.5)
    y, x = np.mgrid[: SHAPE[0], : SHAPE[1]] + 0.5
    away = np.stack([x - 40.2, y - 29.6], -1) @ np.linalg.inv(oval).T
    reach = np.hypot(*np.moveaxis(away, -1, 0))
    even = 2.5 / (np.pi * np.linalg.det(oval))
    np.testing.assert_allclose(drawn[reach < 0.8], even, rtol=0.03)
    assert drawn[reach > 1.25].max() < 0.01 * even
    coarse = drawn_light(dot, (SHAPE[1], SHAPE[0]), 2)
    assert np.abs(coarse - drawn.reshape(30, 2, 40, 2).sum((1, 3))).max() < 4 * even
