"""Photographs without their target: exchanged ones beside those that show nothing."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from found_marks import found_marks

from lensfit.workflow.calibration.observe import Observed
from lensfit.workflow.shoot.shoot_records import Target
from lensfit.workflow.statements.contradictions import gravest_first
from lensfit.workflow.statements.targets_seen import (
    MissedTarget,
    contradicted_counts,
    contradicted_targets,
)


def observed(*targets: str) -> list[Observed]:
    return [Observed(f"view_{k}.png", name, {}) for k, name in enumerate(targets)]


def missed(k: int, target: str, shown: str | None) -> MissedTarget:
    kind = {"dots": "dot grid", "lines": "line grid"}[target]
    return MissedTarget(f"view_{k}.png", target, kind, shown)


def test_photographs_that_show_each_others_targets_are_exchanged():
    views = observed("dots", "dots", "lines")
    found = [missed(1, "dots", "lines"), missed(2, "lines", "dots")]
    (one,) = contradicted_targets(found, views)
    assert one.kind == "exchanged"
    assert "view_1 shows “lines” and view_2 shows “dots”" in one.text
    assert one.images == ("view_1.png", "view_2.png")
    assert gravest_first([one]) == [one]


def test_one_photograph_of_another_target_is_no_exchange():
    views = observed("dots", "dots", "lines")
    (one,) = contradicted_targets([missed(1, "dots", "lines")], views)
    assert one.kind == "target"
    assert one.limit == "undistortion"
    assert "no dot grid is found on view_1.png" in one.text
    assert "“lines” is seen there" in one.text


def test_nothing_is_seen_on_most_photographs():
    views = observed("dots", "dots", "lines")
    found = [missed(0, "dots", None), missed(1, "dots", None)]
    (one,) = contradicted_targets(found, views)
    assert one.limit == "look"
    assert "on view_0.png, nor on 1 more, though target “dots” is stated" in one.text
    assert contradicted_targets([], views) == []


def chart_seen(columns: int, rows: int, pitch_px: float, turn_deg: float = 0.0):
    """All points of a chart that lie on a picture of 900 x 700 px."""
    cells = np.stack(np.meshgrid(np.arange(columns), np.arange(rows)), -1)
    cells = cells.reshape(-1, 2)
    turn = np.deg2rad(turn_deg)
    rotation = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    points = (cells - cells.mean(0)) * pitch_px @ rotation.T + [450, 350]
    there = ((points > 5) & (points < np.array([895, 695]))).all(1)
    return found_marks(points[there], (900, 700), lattice=cells[there].astype(float))


def counted(target: Target, *seen) -> list[str]:
    shoot: Any = SimpleNamespace(targets={"chart": target}, takes=())
    views: list[Any] = [
        Observed(f"{k}.png", "chart", {}, take=SimpleNamespace(observations=one))  # type: ignore
        for k, one in enumerate(seen)
    ]
    return [one.text for one in contradicted_counts(shoot, views)]


DOTS = Target("chart", "dot-grid", 20.0, marks=(21, 16))
BOARD = Target("chart", "checkerboard", 20.0, squares=(9, 6))


@pytest.mark.parametrize("columns", [20, 22])
def test_a_column_too_many_or_too_few_is_counted_where_the_whole_chart_is_seen(columns):
    seen = [chart_seen(columns, 16, 34.0), chart_seen(columns, 16, 30.0, 7.0)]
    (text,) = counted(DOTS, *seen, chart_seen(columns, 16, 60.0))
    assert "marks = [21, 16] is stated of target “chart”" in text
    assert f"2 photographs show {columns} columns and 16 rows" in text


def test_corners_stated_for_squares_contradict_the_squares_seen():
    (text,) = counted(BOARD, *[chart_seen(9, 6, pitch) for pitch in (40.0, 60.0)])
    assert "squares = [9, 6] is stated" in text
    assert "show 10 columns and 7 rows" in text


def test_a_chart_as_stated_in_part_or_turned_is_no_contradiction():
    turned = chart_seen(16, 21, 30.0)
    assert counted(DOTS, chart_seen(21, 16, 34.0), turned, turned) == []
    assert counted(DOTS, *[chart_seen(21, 16, 60.0)] * 3) == []
    assert counted(BOARD, chart_seen(8, 5, 60.0), chart_seen(8, 5, 50.0, 12.0)) == []
    # A row that is too dim to be found on some photographs.
    dim = chart_seen(21, 15, 34.0)
    assert counted(DOTS, chart_seen(21, 16, 34.0), dim, dim) == []
    unstated = Target("chart", "dot-grid", 20.0)
    assert counted(unstated, *[chart_seen(9, 9, 30.0)] * 3) == []
