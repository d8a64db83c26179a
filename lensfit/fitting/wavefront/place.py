"""Where chief rays land: every dot's centroid, less what blur does to it.

A centroid is not where the chief ray lands: coma and clipping move it, differently at
every f-number, focus and colour. The wavefront gives that bias (`centroid_biases`), and
geometry and lateral colour can be fitted to chief rays.

(The place at which the modelled image suits the photograph best is the same in theory;
in practice it carries the noise of the rays that the image is made of.)
"""

from dataclasses import replace

import numpy as np
from jaxtyping import Float

from lensfit.fitting.take import Take
from lensfit.fitting.wavefront.aliasing import Aliasing, aliasing_of
from lensfit.fitting.wavefront.centroid_biases import smooth_centroid_biases_mm
from lensfit.fitting.wavefront.dot_patches import Shown
from lensfit.fitting.wavefront.gather import Gathered
from lensfit.fitting.wavefront.stages import Stage

_UNSURE = 0.05
"""Share of a bias that the model may get wrong: where it is small, a photograph counts
for more."""


def placed(stage: Stage, gathered: Gathered) -> list[Take]:
    """The takes with marks where the chief rays land, in the order of `gathered.shown`.

    Marks whose size is unknown stay where they are.
    """
    bias_mm = smooth_centroid_biases_mm(stage, gathered)
    aliasing = aliasing_of(stage, gathered)
    takes = []
    for k, shown in enumerate(gathered.shown):
        mine = gathered.take == k
        of_take = Aliasing(*(part[mine] for part in aliasing))
        takes.append(_moved(shown, bias_mm[mine], of_take))
    return takes


def moving_together(
    takes: list[Take],
    stage: Stage,
    gathered: Gathered,
    moves_mm: Float[np.ndarray, "dots moves 3 2"],
) -> list[Take]:
    """Placed takes that say how their marks move together (`shared_moves_mm`): as
    given, and by the share of the bias that the model may get wrong, alike in all takes
    of one f-number and focus.

    Parameters
    ----------
    takes : As `placed` has them.
    moves_mm : How independent errors of the wavefront move every dot's mark
        (`centroid_biases`).
    """
    bias_mm = smooth_centroid_biases_mm(stage, gathered)
    settings = [(take.f_number, take.focus_distance_mm) for take in takes]
    distinct = list(dict.fromkeys(settings))
    moves = moves_mm.shape[1]
    found = []
    for k, take in enumerate(takes):
        mine = gathered.take == k
        shared = np.zeros((moves + len(distinct), 3, len(take.observations), 2))
        rows = gathered.shown[k].cutouts.marks
        shared[:moves, :, rows] = moves_mm[mine].transpose(1, 2, 0, 3)
        alike = moves + distinct.index(settings[k])
        shared[alike, :, rows] = _UNSURE * bias_mm[mine]
        found.append(replace(take, shared_moves_mm=shared))
    return found


def _moved(
    shown: Shown,
    bias_mm: Float[np.ndarray, "dots 3 2"],
    aliasing: Aliasing,
) -> Take:
    """The take with its marks at the chief rays, and the light that dots sent."""
    take, rows = shown.take, shown.cutouts.marks
    observations = take.observations
    bias_px = bias_mm / take.pixel_mm
    apart = bias_px + aliasing.moved_mm / take.pixel_mm
    points = observations.points_px.copy()
    points[rows] -= apart[:, 1]
    channels = observations.channel_points_px.copy()
    channels[:, rows] -= apart.transpose(1, 0, 2)
    flux = observations.flux.copy()
    green = flux[rows, flux.shape[1] // 2, None] / aliasing.brightened[:, None]
    flux[rows] = np.where(aliasing.green_alone[:, None], green, flux[rows])
    unsure = _UNSURE**2 * np.einsum("kci,kcj->ckij", bias_px, bias_px)
    covariance = observations.covariance_px2.copy()
    covariance[rows] += unsure[1]
    of_channels = observations.channel_covariance_px2.copy()
    of_channels[:, rows] += unsure
    corrected = replace(
        observations,
        points_px=points,
        channel_points_px=channels,
        covariance_px2=covariance,
        channel_covariance_px2=of_channels,
        flux=flux,
    )
    return replace(take, chief_rays=True, observations=corrected)
