"""Two charts whose lattices join are told apart; one chart, however bent, is one."""

import numpy as np
import pytest
from dots_scene import coverage, discs, grid, noisy, photograph, shaded, view

from lensfit.detect.find import observe
from lensfit.detect.lattice import index_lattice
from lensfit.detect.second_chart import larger_chart

PITCH_PX = 24.0


def side_by_side(gap, shift=0.0, turn_deg=0.0, scale=1.0):
    """A chart of 12 columns, and to its right one of 7: pixels, and whether of the
    first. The gap between them and the second's shift are in pitches."""
    first = view(grid(12, 11), (200.0, 180.0), PITCH_PX)
    second = view(grid(7, 11), (0.0, 0.0), scale * PITCH_PX, angle_deg=turn_deg)
    second = second - second.min(0) + first.min(0)
    second[:, 0] += 11 * PITCH_PX + gap * PITCH_PX
    second[:, 1] += shift * PITCH_PX
    points = np.concatenate([first, second])
    points = points + np.random.default_rng(1).normal(scale=0.03, size=points.shape)
    return points, np.arange(len(points)) < len(first)


def indexed(points):
    indices, valid = index_lattice(points)
    return indices[valid], valid


@pytest.mark.parametrize(
    ("gap", "shift", "turn_deg", "scale"),
    [(1.15, 0.0, 0, 1), (1.0, 0.12, 0, 1), (0.9, 0.1, 0, 1), (1.05, 0.05, 1.0, 1),
     (1.1, 0.0, 0, 1.05)],
)  # fmt: skip
def test_two_charts_side_by_side(gap, shift, turn_deg, scale):
    points, is_first = side_by_side(gap, shift, turn_deg, scale)
    cells, valid = indexed(points)
    assert (valid & ~is_first).sum() > 40  # joined
    larger = larger_chart(cells, points[valid])
    assert larger is not None
    assert (larger == is_first[valid]).mean() > 0.97
    assert not (larger & ~is_first[valid]).any()


def test_a_chart_behind_the_corner_of_another():
    """It shows all about it: the seam is a ring of four corners."""
    behind = view(grid(18, 16), (250.0, 160.0), PITCH_PX)
    behind += np.array([0.08, 0.08]) * PITCH_PX
    front = view(grid(12, 11), (200.0, 200.0), PITCH_PX)
    shown = ((behind < front.min(0) - 12) | (behind > front.max(0) + 12)).any(1)
    points = np.concatenate([front, behind[shown]])
    is_front = np.arange(len(points)) < len(front)
    cells, valid = indexed(points)
    larger = larger_chart(cells, points[valid])
    assert larger is not None
    named = is_front[valid]
    assert (larger == named).mean() > 0.95 or (larger == ~named).mean() > 0.95


@pytest.mark.parametrize("barrel", [0.0, 0.1, 0.25, -0.2])
@pytest.mark.parametrize("tilt_deg", [0, 35])
@pytest.mark.parametrize("columns", [9, 21])
def test_one_chart_is_one_however_bent(barrel, tilt_deg, columns):
    lattice = grid(columns, columns - 2)
    points = view(
        lattice, (300.0, 300.0), 500 / columns, angle_deg=11, tilt_deg=tilt_deg,
        barrel=barrel,
    )  # fmt: skip
    rng = np.random.default_rng(3)
    points = points + rng.normal(scale=0.1, size=points.shape)
    i, j = lattice.T
    hole = (np.abs(i - columns // 2) < 2) & (np.abs(j - columns // 2) < 3)
    kept = ~hole & (rng.uniform(size=len(points)) > 0.08)
    assert larger_chart(lattice[kept], points[kept]) is None


def test_the_larger_chart_is_used_and_the_other_named():
    points, is_first = side_by_side(1.12, 0.06)
    size = tuple(np.ceil(points.max(0) + 30).astype(int))
    cover = coverage(size, points, discs(4.0, len(points)), blur_px=0.8)
    picture = photograph(noisy(shaded(cover, "bright"), 0, read=1e-4))
    found = observe(picture, "dot-grid")
    assert len(found) == pytest.approx(is_first.sum(), abs=12)
    assert found.points_px[:, 0].max() < points[is_first][:, 0].max() + 1
    assert found.lattice.max(0)[0] <= 11
    (note,) = (one for one in found.notes if "Two charts" in one)
    assert "left out" in note
    only_first = (0.0, 0.0, float(points[is_first][:, 0].max()) + 8, float(size[1]))
    assert not observe(picture, "dot-grid", roi=only_first).notes
