"""Centroid biases of charts that show several kinds of targets."""

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from lensfit.fitting.wavefront import centroid_biases
from lensfit.fitting.wavefront.centroid_biases import centroid_biases_mm
from lensfit.fitting.wavefront.dot_arrays import Broad, rows_of_kinds, undrawn

LINES, CORNERS, DISCS = [1, 4], [2], [0, 3, 5]


@pytest.fixture
def mixed() -> Broad:
    broad = undrawn(6)
    broad.line_width[LINES] = 0.1, 0.0
    broad.window_cells[CORNERS] = 8.0
    return broad


def test_every_target_is_of_one_kind(mixed):
    found = {kind: rows.tolist() for kind, rows in rows_of_kinds(mixed).items()}
    assert found == {"disc": DISCS, "corner": CORNERS, "line": LINES}


def test_a_kind_that_no_chart_shows_is_left_out():
    assert list(rows_of_kinds(undrawn(3))) == ["disc"]


def test_biases_are_in_the_order_of_the_targets(mixed, monkeypatch):
    """Each kind goes through a program of its own, which is told which one it is."""
    value_of = {"disc": 10.0, "corner": 20.0, "line": 30.0}

    def evaluated(function, stage, rows, batch, kind):
        return np.add.outer(value_of[kind] + rows, np.zeros((3, 2)))

    monkeypatch.setattr(centroid_biases, "_evaluate_on_dots", evaluated)
    monkeypatch.setattr(centroid_biases, "select_dots", lambda _, rows: rows)
    dot_data = cast(Any, SimpleNamespace(dots=SimpleNamespace(broad=mixed)))
    found = centroid_biases_mm(cast(Any, None), dot_data)
    assert found[:, 0, 0].tolist() == [10.0, 31.0, 22.0, 13.0, 34.0, 15.0]
    assert found.shape == (6, 3, 2)
