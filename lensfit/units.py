"""The only places where a unit changes.

Inside lensfit lengths are millimetres, angles radians and image positions either
pixels or sensor millimetres; the name of every quantity ends with its unit.
"""

import math

MILLIMETRES_PER_METRE = 1000.0
MILLIMETRES_PER_INCH = 25.4


def m_from_mm(distance_mm: float) -> float:
    """Metres from millimetres; infinity stays infinity."""
    return distance_mm / MILLIMETRES_PER_METRE


def dioptres_from_mm(distance_mm: float) -> float:
    """Inverse distance in 1/m; infinity maps to 0 exactly."""
    return 0.0 if math.isinf(distance_mm) else MILLIMETRES_PER_METRE / distance_mm


def mm_from_dioptres(dioptres: float) -> float:
    """Distance in mm from its inverse in 1/m; 0 maps to infinity."""
    return math.inf if dioptres == 0 else MILLIMETRES_PER_METRE / dioptres
