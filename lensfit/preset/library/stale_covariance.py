"""Deviations that an edit makes untrue: a number set by hand was not measured."""

from lensfit.preset.library.key_path import MISSING, Step, Tables, value_at, with_value

_DEPTH = {"distortion": 2, "lateral_colour": 3, "fall_off": 4}
"""Steps down to the table whose covariance speaks of a block's numbers."""
_PROJECTION = ("principal_distance_mm", "principal_point_mm")


def without_stale_covariance(tables: Tables, steps: tuple[Step, ...]) -> Tables:
    """The tables without the covariance of numbers among which one was changed.

    Parameters
    ----------
    steps : To the number. A block that was put in whole keeps what it says of itself.
    """
    if steps[0] != "entries" or len(steps) < 3:
        return tables
    block, below = str(steps[2]), steps[3:]
    depth = _DEPTH.get(block, 0)
    if block == "projection" and (not below or below[0] in _PROJECTION):
        depth = 2
    if not depth or len(steps) <= depth:
        return tables
    place = (*steps[:depth], "covariance")
    if value_at(tables, place) in (None, MISSING):
        return tables
    return with_value(tables, place, None)
