"""What nobody photographed is named: other stops, other sides of focus."""

import pytest
from drawn_lens import Seidel, Shot, photographed

from lensfit.fitting.wavefront.fit import extrapolation_notes

STATED_MM = {"in focus": 2000.0, "near": 1500.0, "far": 3500.0}
"""Of a chart at 2000 mm."""


def dot_data(*shots):
    lens = Seidel(defocus_mm=(0.1, 0.1, 0.1))
    return photographed(
        lens,
        [
            Shot(group, stop, focus_mm=STATED_MM.get(where))
            for group, (where, stop) in enumerate(shots)
        ],
        rays=2000,
    )


WHOLE = ("in focus", 0), ("near", 1), ("far", 0)


@pytest.mark.parametrize(
    ("shots", "words"),
    [
        (WHOLE, []),
        ([("in focus", 0)], ["at f/2 alone", "in focus alone"]),
        ([("in focus", 0), ("in focus", 1)], ["in focus alone"]),
        ([("near", 0), ("in focus", 1)], ["one side of focus alone"]),
        ([("far", 0), ("far", 1)], ["one side of focus alone"]),
        ([("near", 0), ("far", 0)], ["at f/2 alone"]),
        ([("unsaid", 0), ("unsaid", 1)], []),
    ],
)
def test_what_was_not_photographed_is_named(shots, words):
    found = extrapolation_notes(dot_data(*shots))
    assert len(found) == len(words)
    for one, said in zip(found, words, strict=True):
        assert said in one
        assert ":" in one  # and what to do about it
