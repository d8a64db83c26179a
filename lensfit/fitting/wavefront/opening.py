"""How wide the lens opens, against what its f-number says.

Dots do not tell a wide pupil from a large defocus, so the fit takes the f-number for
the pupil's unit. An f-number is rounded and counts at infinity, and how much a lens
opens at a near focus depends on its pupils. Distances tell: from the entrance pupil at
1 / z, a point at another vergence than the lens is focused at draws rays that land

    c^2 p (1 / z_focus - 1 / z_object)

off, p the direction cosine at the sensor and c the principal distance, by the
conservation of etendue and whatever moves for focusing. If all defocus of a shoot is
larger or smaller than distances have it by one share, the pupil is so much narrower or
wider. The same blur is then drawn by other defocus and aberrations: of a pupil wider by
k, defocus is smaller by k and the path of every ray larger by k.

Reference: W. T. Welford and R. Winston, High Collection Nonimaging Optics (1989), on
etendue.
"""

from dataclasses import replace

import numpy as np
from jaxtyping import Float

from lensfit.fitting.wavefront.gather import DotData, opened
from lensfit.fitting.wavefront.parameters import Layout
from lensfit.fitting.wavefront.stages import Stage, recentre_patches
from lensfit.fitting.wavefront.start import defocus_deviation_mm

_BOUNDS = 0.8, 1.25
"""Beyond these a statement is mistaken, not inaccurate."""
_LEAST = 0.002
"""Standard deviation of defocus, at least, in units of the largest: the fit's own."""
_TOGETHER = 0.5
"""Standard deviation of a shift that all defocus has in common, in units of the
largest: field curvature and the focus scale make one."""
_PATHS = ("coefficients", "colour", "focus_change")
"""Parameters that are paths of rays."""


def opening_ratio(stage: Stage) -> float:
    """Pupil of the lens over that of its f-number, by distances; 1 where nothing was
    stated. The f-number counts with its own width."""
    dot_data = stage.dot_data
    stated_mm = _defocus_by_distances_mm(dot_data)
    known = np.flatnonzero(np.isfinite(stated_mm))
    if not len(known):
        return 1.0
    fitted_mm = stage.parameters[stage.layout.blocks["defocus"]][known]
    deviation_mm = np.maximum(
        defocus_deviation_mm(dot_data)[known], _LEAST * np.nanmax(np.abs(stated_mm))
    )
    return ratio_of(fitted_mm, stated_mm[known], deviation_mm, dot_data.widths.f_number)


def ratio_of(
    fitted_mm: Float[np.ndarray, " groups"],
    stated_mm: Float[np.ndarray, " groups"],
    deviation_mm: Float[np.ndarray, " groups"],
    width: float,
) -> float:
    """By least squares of fitted = common shift + stated / ratio.

    Parameters
    ----------
    deviation_mm : Of every stated defocus.
    width : Standard deviation of the ratio before anything is fitted.
    """
    largest_mm = np.abs(stated_mm).max()
    if not largest_mm:
        return 1.0
    design = np.stack([stated_mm, np.full_like(stated_mm, largest_mm)], -1)
    weighted = design / deviation_mm[:, None] ** 2
    prior = np.diag([width**-2.0, _TOGETHER**-2.0])
    inverse, _ = np.linalg.solve(
        design.T @ weighted + prior, weighted.T @ (fitted_mm - stated_mm)
    )
    return float(np.clip(1 / (1 + inverse), *_BOUNDS))


def with_opening(stage: Stage, ratio: float) -> Stage:
    """The same blur by a pupil wider by this ratio."""
    found = replace(
        stage,
        dot_data=opened(stage.dot_data, ratio),
        parameters=of_opening(stage.parameters, stage.layout, ratio),
        mean=of_opening(stage.mean, stage.layout, ratio),
    )
    return recentre_patches(found)


def of_opening(
    parameters: Float[np.ndarray, " parameters"], layout: Layout, ratio: float
) -> Float[np.ndarray, " parameters"]:
    """Parameters that draw the same spots by a pupil wider by this ratio."""
    found = parameters.copy()
    found[layout.blocks["defocus"]] /= ratio
    for name in _PATHS:
        found[layout.blocks[name]] *= ratio
    return found


def _defocus_by_distances_mm(dot_data: DotData) -> Float[np.ndarray, " groups"]:
    """Of every group whose focus distance was stated; NaN of others."""
    found = np.full(len(dot_data.groups), np.nan)
    for one in dot_data.photographs:
        focus_mm = one.take.focus_distance_mm
        if focus_mm is None or one.take.anamorphic:
            continue
        c_mm, pupil_mm = one.distortion.principal_distance_mm, one.pupil_offset_mm
        from_object = 1 / (dot_data.reference_distance_mm - pupil_mm)
        moved_mm = float(c_mm) ** 2 * (1 / (focus_mm - pupil_mm) - from_object)
        same = [group.focus_distance_mm == focus_mm for group in dot_data.groups]
        found[same] = moved_mm
    return found
