"""A chart's code says exactly what the chart is, and says nothing if it is damaged."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lensfit.chart.pattern import (
    BASE,
    KINDS,
    MARKERS,
    ORIENTATION_CELLS,
    POLARITIES,
    Pattern,
    make_pattern,
    marker_cells,
    marker_ids,
    pattern_of,
)
from lensfit.errors import ChartError

patterns = st.builds(
    Pattern,
    kind=st.sampled_from(KINDS),
    polarity=st.sampled_from(POLARITIES),
    pitch_mm=st.integers(1, 4_000_000).map(lambda n: round(n * 1e-4, 4)),
    mark_mm=st.integers(0, 4_000_000).map(lambda n: round(n * 1e-4, 4)),
    columns=st.integers(5, 255),
    rows=st.integers(5, 255),
    oriented=st.booleans(),
)


@settings(max_examples=60, deadline=None)
@given(patterns)
def test_the_code_gives_back_the_pattern(pattern: Pattern):
    ids = marker_ids(pattern)
    assert len(ids) == MARKERS
    assert [marker // BASE for marker in ids] == list(range(MARKERS))
    assert pattern_of(ids) == pattern


@settings(max_examples=60, deadline=None)
@given(patterns, st.integers(0, MARKERS - 1), st.integers(1, BASE - 1))
def test_a_wrong_marker_is_noticed(pattern: Pattern, place: int, step: int):
    ids = list(marker_ids(pattern))
    ids[place] = BASE * place + (ids[place] - BASE * place + step) % BASE
    assert pattern_of(tuple(ids)) is None


def test_markers_are_framed_in_black():
    cells = marker_cells(123)
    assert cells.shape == (7, 7)
    assert cells[[0, -1]].all()
    assert cells[:, [0, -1]].all()


def test_no_turn_and_no_mirror_moves_the_orientation_figure_onto_itself():
    figure = {tuple(cell) for cell in ORIENTATION_CELLS.tolist()}
    quarter = np.array([[0, -1], [1, 0]])
    for flip in (np.eye(2, dtype=int), np.diag([-1, 1])):
        for turns in range(4):
            move = np.linalg.matrix_power(quarter, turns) @ flip
            if np.array_equal(move, np.eye(2)):
                continue
            moved = ORIENTATION_CELLS @ move.T
            for site in figure:
                shifted = {tuple(c) for c in (moved - moved[0] + site).tolist()}
                assert shifted != figure


def test_small_patterns_have_no_orientation_marks():
    assert make_pattern("dot-grid", "bright", 10, 2, 8, 6).oriented
    small = make_pattern("dot-grid", "bright", 10, 2, 7, 6)
    assert not small.oriented
    assert len(small.orientation_marks) == 0


@pytest.mark.parametrize(
    ("columns", "rows", "mark"), [(4, 9, 2.0), (9, 4, 2.0), (256, 9, 2.0), (9, 9, 9.5)]
)
def test_what_no_chart_can_be_is_refused(columns: int, rows: int, mark: float):
    with pytest.raises(ChartError):
        make_pattern("dot-grid", "bright", 10.0, mark, columns, rows)
