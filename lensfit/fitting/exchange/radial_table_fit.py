"""A table of radii fitted to a lens: the mean over all azimuths, on what is seen.

The distorted radius is an odd polynomial of the true one, by least squares; the table
holds its values, beyond the frame too, as overscan reads on there.
"""

import numpy as np

from lensfit.fitting.exchange.samples import Samples
from lensfit.preset.exchange.syntheyes import RadialTable

_SAMPLES = 64
_TERMS = 6
_BEYOND = 1.15


def fit_radial_table(samples: Samples, centre_mm: tuple[float, float]) -> RadialTable:
    """Distorted radii at even steps of the true one."""
    centre = np.array(centre_mm)
    out = samples.undistorted_mm - centre
    true = np.linalg.norm(out, axis=-1)
    along = out / np.maximum(true, 1e-300)[:, None]
    wanted = np.sum(along * (samples.distorted_mm - centre), -1)
    unit = float(true.max())
    powers = 2 * np.arange(_TERMS) + 1
    found, *_ = np.linalg.lstsq((true / unit)[:, None] ** powers, wanted)
    radius = np.linspace(0, _BEYOND, _SAMPLES)
    return RadialTable(radius * unit, radius[:, None] ** powers @ found, centre_mm)
