"""The overlay: marks where they were seen, colours that tell, counts that are right."""

from dataclasses import replace

import numpy as np
import pytest
from drawn_grids import View, checkerboard, draw, line_grid, photograph
from found_marks import found_marks
from PIL import Image

from lensfit.detect.find import observe
from lensfit.detect.overlay import draw_overlay, stripe_colours


def marks(points_px, size_px, lattice=None):
    """Observations of points without neighbours."""
    count = len(points_px)
    if lattice is None:
        lattice = [[3.0 * k + 1, 1.0] for k in range(count)]
    return found_marks(
        np.array(points_px, float),
        size_px,
        lattice=np.array(lattice),
        flux=np.ones((count, 1)),
        diameter_px=np.full(count, 8.0),
    )


def drawn(picture, found, folder):
    path = folder / "overlay.png"
    draw_overlay(photograph(picture), found, path)
    assert [entry.name for entry in folder.iterdir()] == ["overlay.png"]
    with Image.open(path) as image:
        return np.asarray(image.convert("RGB"), float)


@pytest.mark.parametrize(("width", "scale"), [(1200, 1.0), (300, 4.0), (6000, 0.5)])
def test_marks_sit_at_their_sub_pixel_positions(tmp_path, width, scale):
    place = np.array([0.4 * width + 0.3, 60.7])
    image = drawn(np.zeros((120, width)), marks([place], (width, 120)), tmp_path)
    assert image.shape[1] == width * scale
    light = image[: round(120 * scale)].sum(2)
    y, x = np.mgrid[: light.shape[0], : light.shape[1]] + 0.5
    centre = np.array([(light * x).sum(), (light * y).sum()]) / light.sum()
    assert np.abs(centre - place * scale).max() < 0.1


def test_neighbouring_rows_and_columns_differ_in_colour():
    rows = stripe_colours(np.arange(14.0), np.zeros(14)).astype(int)
    assert np.abs(np.diff(rows, axis=0)).max(1).min() > 60
    columns = stripe_colours(np.zeros(4), np.arange(4.0)).astype(int)
    assert np.abs(np.diff(columns, axis=0)).max(1).min() > 30
    assert (columns[0] == columns[2]).all()


def test_clipped_and_touching_marks_stand_out(tmp_path):
    plain = marks([[600.0, 60.0], [700.0, 60.0]], (1200, 120))
    flagged = replace(
        plain,
        saturated=np.array([True, False]),
        overlapping=np.array([False, True]),
    )
    before = drawn(np.zeros((120, 1200)), plain, tmp_path)
    after = drawn(np.zeros((120, 1200)), flagged, tmp_path)
    changed = np.abs(after - before).max(2)[:120] > 30
    assert changed[:, 585:615].any()
    assert changed[:, 685:715].any()
    assert not changed[:, :580].any()
    red, green, _ = after[45:75, 585:615].reshape(-1, 3)[
        (after - before)[45:75, 585:615].max(2).argmax()
    ]
    assert red > green


def test_the_veil_around_a_few_small_bright_dots_does_not_glare(tmp_path):
    places = [[100.5 + 150 * k, 60.5] for k in range(8)]
    found = marks(places, (1200, 120))
    picture = np.full((120, 1200), 0.01)
    for x, y in places:
        picture[int(y), int(x)] = 1.0
    image = drawn(picture, found, tmp_path)
    assert image[:20, :20].max() < 64


@pytest.mark.parametrize(("spacing", "apart"), [(60, 5), (14, 10), (8, 20)])
def test_labels_are_rarer_where_marks_are_dense(tmp_path, spacing, apart):
    i, j = np.meshgrid(np.arange(21), [0])
    lattice = np.stack([i.ravel(), j.ravel()], 1).astype(float)
    places = lattice * [spacing, 0] + [8.0, 60.0]
    found = marks(places, (1300, 120), lattice)
    image = drawn(np.zeros((120, 1300)), found, tmp_path)
    above = (image[40:54, :].min(2) > 150).any(0)  # only letters reach up there
    columns = np.flatnonzero(above)
    labels = 1 + np.count_nonzero(np.diff(columns) > 25)
    assert labels == 20 // apart + 1


def test_real_detections_of_every_family_are_drawn(tmp_path):
    for name, paint, kind in (
        ("lines.png", line_grid(0.1), "line-grid"),
        ("board.png", checkerboard(7, 5), "checkerboard"),
    ):
        picture = photograph(draw(View(), paint, blur_px=0.7))
        found = observe(picture, kind)
        draw_overlay(picture, found, tmp_path / name)
        with Image.open(tmp_path / name) as image:
            pixels = np.asarray(image.convert("RGB"), int)
        coloured = np.ptp(pixels, axis=2) > 40
        assert coloured.sum() > 20 * len(found)
