"""A stop that no dot shows keeps the radius that its f-number states."""

from types import SimpleNamespace
from typing import Any

import numpy as np
from drawn_lens import LAYOUT, Seidel, Shot, photographed

from lensfit.fitting.wavefront.term_groups import (
    candidate_term_groups,
    determined_stops,
)
from lensfit.fitting.wavefront.uncertainty import fixed_stop_ratios

DEFOCUS_MM = np.array([0.3, -0.25, 0.0])
LENS = Seidel(12.0, -9.0, 14.0, 8.0, defocus_mm=tuple(DEFOCUS_MM))
WIDE_OPEN = [Shot(0, 0, 1700.0), Shot(1, 0, 2500.0), Shot(2, 0, 2000.0)]


def gathered_of(*stopped_down: Shot):
    return photographed(LENS, [*WIDE_OPEN, *stopped_down], noise=0.02)


IN_FOCUS = gathered_of(Shot(2, 1, 2000.0))
OUT_OF_FOCUS = gathered_of(Shot(0, 1, 1700.0), Shot(2, 1, 2000.0))


def names_of(dot_data) -> set[str]:
    return {one.name for one in candidate_term_groups(dot_data, LAYOUT, DEFOCUS_MM)}


def test_only_a_disc_wider_than_the_hole_shows_the_stop():
    assert not determined_stops(IN_FOCUS, DEFOCUS_MM).any()
    assert determined_stops(OUT_OF_FOCUS, DEFOCUS_MM).all()


def test_a_stop_photographed_in_focus_alone_is_not_fitted():
    assert "stop_ratios" not in names_of(IN_FOCUS)
    assert "stop_ratios" in names_of(OUT_OF_FOCUS)
    # Its blades are out of the way of nothing: their shape stays with the others.
    assert "blades" in names_of(IN_FOCUS)


def test_its_doubt_is_that_of_the_f_number():
    term_groups = candidate_term_groups(OUT_OF_FOCUS, LAYOUT, DEFOCUS_MM)
    (ratios,) = (one for one in term_groups if one.name == "stop_ratios")
    assert ratios.deviation == (OUT_OF_FOCUS.widths.f_number,) == (0.05,)
    stage: Any = SimpleNamespace(layout=LAYOUT, dot_data=IN_FOCUS)
    first = LAYOUT.blocks["stop_ratio"].start
    np.testing.assert_array_equal(fixed_stop_ratios(stage, np.arange(first)), [first])
    assert not len(fixed_stop_ratios(stage, np.array([first])))
