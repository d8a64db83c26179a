"""The wavefront once marks have said how large its errors were.

Marks hardly speak of the shape of dots. So the wavefront goes along the errors that its
own fit left open, which change the photographs least, and keeps of its doubt what the
marks leave. One error is added to those that the scatter of dots shows, since what the
model misses is alike in all dots: that all its centroid biases are wrong (`undoing`).
Then the shape of dots is fitted anew as far as that leaves the biases where marks put
them.

Where chief rays land: every dot's centroid, less what blur does to it.

A centroid is not where the chief ray lands: coma and clipping move it, differently at
every f-number, focus and colour. The wavefront gives that bias (`centroid_biases`), and
geometry and lateral colour can be fitted to chief rays.

(The place at which the modelled image suits the photograph best is the same in theory;
in practice it carries the noise of the rays that the image is made of.)
"""

from dataclasses import replace

import numpy as np
from jaxtyping import Float

from lensfit.fitting.joint_adjustment import Amounts
from lensfit.fitting.take import Take
from lensfit.fitting.wavefront.aliasing import Aliasing, aliasing_of
from lensfit.fitting.wavefront.centroid_biases import (
    moves_of_marks_mm,
    slight_moves_of_marks_mm,
    smooth_centroid_biases_mm,
)
from lensfit.fitting.wavefront.constrained_refit import reshaped, undoing
from lensfit.fitting.wavefront.dot_patches import Shown
from lensfit.fitting.wavefront.fit import WavefrontFit
from lensfit.fitting.wavefront.gather import Gathered
from lensfit.fitting.wavefront.misfit import misfit_of
from lensfit.fitting.wavefront.stages import Stage, settled
from lensfit.fitting.wavefront.uncertainty import parameter_moves

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


_AS_GOOD = 1.1
"""How much worse the shape of dots may be explained."""


def at_chief_rays(found: WavefrontFit) -> list[Take]:
    """The takes with marks where chief rays land, and how its errors move them."""
    stage, gathered = found.stage, found.gathered
    moves = parameter_moves(stage, found.stated_covariance)
    moves_mm = slight_moves_of_marks_mm(stage, gathered, moves)
    return moving_together(placed(stage, gathered), stage, gathered, moves_mm)


def moved_by(
    takes: list[Take],
    found: WavefrontFit,
    errors: Float[np.ndarray, "errors parameters"],
) -> list[Take]:
    """The same (`takes`) with how these errors, of whatever size, move every mark."""
    stage, gathered = found.stage, found.gathered
    moves_mm = moves_of_marks_mm(stage, gathered, errors)
    return moving_together(takes, stage, gathered, moves_mm)


def errors_of(found: WavefrontFit) -> Float[np.ndarray, "errors parameters"]:
    """That all centroid biases are wrong, and then its independent errors."""
    whole = undoing(found.stage, found.gathered)
    return np.concatenate([whole[None], parameter_moves(found.stage, found.covariance)])


def keeping_centroids(found: WavefrontFit) -> WavefrontFit:
    """The wavefront of one setting with centroids where chief rays land, where dots are
    explained as well so.

    Marks of other settings would show how far coma moves a centroid: those of one lie
    on a smooth map wherever it moves them. The map without it is what was measured.
    """
    whole = undoing(found.stage, found.gathered)[None]
    kept = told_by_marks(found, whole, Amounts(np.ones(1), np.zeros((1, 1))))
    return found if kept is None else kept


def told_by_marks(
    found: WavefrontFit,
    errors: Float[np.ndarray, "errors parameters"],
    said: Amounts,
) -> WavefrontFit | None:
    """The wavefront with so much of each error in it; None where that spoils how well
    it explains the shape of dots.

    Parameters
    ----------
    errors : As `errors_of` has them.
    said : How much of each.
    """
    stage = found.stage
    told = replace(stage, parameters=stage.parameters + said.value @ errors)
    stage = reshaped(settled(told), found.gathered)
    # A move too far leads where rays miss the patches, and nothing is defined.
    numbers = (stage.parameters, *stage.equations)
    if not all(np.isfinite(part).all() for part in numbers):
        return None
    misfit = misfit_of(stage, found.families)
    worse = misfit.median / found.misfit.median
    if not worse <= _AS_GOOD:
        return None
    # In retrospect the halves of a fit go to minima of their own, which fixed biases
    # forbid: what dots that it did not see cost it is what it was.
    misfit = misfit._replace(held_out_dots=worse * found.misfit.held_out_dots)
    before = np.diag([0.0, *np.ones(len(errors) - 1)])
    return replace(
        found,
        stage=stage,
        covariance=found.covariance + errors.T @ (said.covariance - before) @ errors,
        misfit=misfit,
    )
