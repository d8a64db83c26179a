"""Means of numbers on the scale in which lenses move evenly."""

import math

from lensfit.units import MILLIMETRES_PER_METRE, dioptres_from_mm


def blended(first: float, second: float, weight: float) -> float:
    """`first` at weight 0, `second` at weight 1, linear between."""
    return (1 - weight) * first + weight * second


def blended_ratio(first: float, second: float, weight: float) -> float:
    """Linear in the logarithm."""
    return math.exp(blended(math.log(first), math.log(second), weight))


def blended_distance_mm(first: float, second: float, weight: float) -> float:
    """Linear in dioptres; either may be infinite."""
    dioptres = blended(dioptres_from_mm(first), dioptres_from_mm(second), weight)
    return MILLIMETRES_PER_METRE / dioptres if dioptres else math.inf
