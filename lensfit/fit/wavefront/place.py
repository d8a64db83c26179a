"""Where chief rays land: every dot's centroid, less what blur does to it.

A centroid is not where the chief ray lands: coma and clipping drag it, differently at
every f-number, focus and colour. With the wavefront known the distance between the two
is known, and geometry and lateral colour can be fitted to chief rays.

(The place at which the modelled image suits the photograph best is the same in theory;
in practice it carries the noise of the rays that the image is made of.)
"""

from collections.abc import Callable
from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from scipy.interpolate import RBFInterpolator

from lensfit.batches import in_batches
from lensfit.fit.take import Take
from lensfit.fit.wavefront.aliasing import Aliasing, aliasing_of
from lensfit.fit.wavefront.dots import Dots
from lensfit.fit.wavefront.drag import centroid_slopes_mm, centroids_mm
from lensfit.fit.wavefront.gather import Gathered, chosen, spread_over_takes
from lensfit.fit.wavefront.parameters import Layout, Scale
from lensfit.fit.wavefront.shown import Shown
from lensfit.fit.wavefront.stages import Stage, with_iris
from lensfit.programs import kept_program

_BATCH = 512
_TELLING, _FEW = 12, 32
"""Dots of a take that tell how errors of the wavefront move its marks, and how many go
through a program at a time."""
_GREEN = 1
_UNDONE_PX = 0.001
"""To this drags are undone, at whatever cost to the shape of dots."""
_UNSURE = 0.05
"""Share of a drag that the model may get wrong: a photograph in which blur drags little
tells where chief rays land, and one in which it drags much follows."""


def placed(
    stage: Stage,
    gathered: Gathered,
    moves: Float[np.ndarray, "moves parameters"] | None = None,
    *,
    exactly: bool = False,
) -> list[Take]:
    """The takes with marks where the chief rays land, in the order of `gathered.shown`.

    Marks whose size is unknown stay where they are.

    Parameters
    ----------
    moves : Independent errors of the wavefront (`uncertainty.parameter_moves`); the
        takes then say how their marks move together: by each of these, and by the share
        of the drag that the model may get wrong, alike in all takes of one f-number and
        focus.
    exactly : Whether each mark is asked how moves move it, as it takes to tell moves
        of many deviations; by default a few tell it for all, to a tenth.
    """
    dragged = _dragged_mm(stage, gathered)
    aliasing = aliasing_of(stage, gathered)
    takes = []
    for k, shown in enumerate(gathered.shown):
        mine = gathered.take == k
        of_take = Aliasing(*(part[mine] for part in aliasing))
        takes.append(_moved(shown, dragged[mine], of_take))
    if moves is None:
        return takes
    how = _each_moved_by if exactly else _moved_by
    by_moves = how(moves, stage, gathered)
    settings = [(take.f_number, take.focus_distance_mm) for take in takes]
    distinct = list(dict.fromkeys(settings))
    count = len(moves) + len(distinct)
    found = []
    for k, take in enumerate(takes):
        mine = gathered.take == k
        shared = np.zeros((count, 3, len(take.observations), 2))
        rows = gathered.shown[k].cutouts.marks
        shared[: len(moves), :, rows] = by_moves[mine].transpose(1, 2, 0, 3)
        alike = len(moves) + distinct.index(settings[k])
        shared[alike, :, rows] = _UNSURE * dragged[mine]
        found.append(replace(take, shared_moves_mm=shared))
    return found


def _each_moved_by(
    moves: np.ndarray, stage: Stage, gathered: Gathered
) -> Float[np.ndarray, "dots moves 3 2"]:
    """How every mark goes against its drag."""
    still = _dragged_mm(stage, gathered)
    found = [
        still - _dragged_mm(replace(stage, parameters=stage.parameters + m), gathered)
        for m in moves
    ]
    return np.stack(found, 1)


def undoing(stage: Stage, gathered: Gathered) -> Float[np.ndarray, " parameters"]:
    """The move of the parameters that takes all drags away and changes the photographs
    least: where blur is a pixel wide, orders of coma that undo each other but for a
    shift look like nothing. No move where drags are too large to undo at one go.
    """
    few = chosen(gathered, spread_over_takes(gathered, _TELLING))
    free = np.flatnonzero(stage.deviation > 0)
    slopes = _of_dots(centroid_slopes_mm, stage, few, _FEW)[:, _GREEN][..., free]
    pixel_mm = np.array([shown.take.pixel_mm for shown in gathered.shown])
    one_mm = _UNDONE_PX * pixel_mm[few.take]
    slopes = (slopes / one_mm[..., None]).reshape(-1, len(free))
    drags = _dragged_mm(stage, few)[:, _GREEN] / one_mm
    seen = np.asarray(stage.equations.matrix.sum(0))[np.ix_(free, free)]
    seen = seen + np.diag(stage.deviation[free] ** -2.0)
    found = np.zeros(stage.layout.size)
    towards = slopes.T @ drags.ravel()
    found[free] = -np.linalg.solve(seen + slopes.T @ slopes, towards)
    undone = replace(stage, parameters=stage.parameters + found)
    left = _dragged_mm(undone, few)[:, _GREEN] / one_mm
    return found if np.sum(left**2) < 0.25 * np.sum(drags**2) else 0 * found


def _moved_by(
    moves: np.ndarray, stage: Stage, gathered: Gathered
) -> Float[np.ndarray, "dots moves 3 2"]:
    """How marks go against their drag. It varies slowly over the frame: a few dots of
    every take tell it for all, by a thin plate through them."""
    if not len(moves):
        return np.zeros((len(gathered.take), 0, 3, 2))
    rows = spread_over_takes(gathered, _TELLING)
    few = chosen(gathered, rows)
    slopes = _of_dots(centroid_slopes_mm, stage, few, _FEW)
    against = -np.einsum("dcip,mp->dmci", slopes, moves)
    field_mm, told_mm = (np.asarray(g.dots.field_mm) for g in (gathered, few))
    found = np.zeros((len(field_mm), *against.shape[1:]))
    for k in range(len(gathered.shown)):
        mine, told = gathered.take == k, few.take == k
        values = against[told].reshape(told.sum(), -1)
        plate = RBFInterpolator(told_mm[told], values, kernel="thin_plate_spline")
        found[mine] = plate(field_mm[mine]).reshape(mine.sum(), *against.shape[1:])
    return found


def _dragged_mm(stage: Stage, gathered: Gathered) -> Float[np.ndarray, "dots 3 2"]:
    """Centroid of every dot and channel from where its chief ray lands."""
    return _of_dots(centroids_mm, stage, gathered, _BATCH)


def _of_dots(
    function: Callable[..., Array], stage: Stage, gathered: Gathered, batch: int
) -> Float[np.ndarray, "dots 3 2 *shape"]:
    """What a function such as `centroids_mm` finds at the parameters of the fit."""
    return in_batches(
        lambda dots: _one_by_one(
            function,
            jnp.asarray(stage.parameters),
            jax.tree.map(jnp.asarray, dots),
            jnp.asarray(gathered.chromatic),
            stage.layout,
            gathered.scale,
        ),
        with_iris(gathered, stage.blades),
        batch,
    )


@kept_program(static_argnames=("function", "layout"))
def _one_by_one(
    function: Callable[..., Array],
    parameters: Array,
    dots: Dots,
    chromatic: Array,
    layout: Layout,
    scale: Scale,
) -> Array:
    return jax.lax.map(
        lambda dot: function(parameters, dot, chromatic, layout, scale), dots
    )


def _moved(
    shown: Shown,
    dragged_mm: Float[np.ndarray, "dots 3 2"],
    aliasing: Aliasing,
) -> Take:
    """The take with its marks at the chief rays, and the light that dots sent."""
    take, rows = shown.take, shown.cutouts.marks
    observations = take.observations
    dragged = dragged_mm / take.pixel_mm
    apart = dragged + aliasing.moved_mm / take.pixel_mm
    points = observations.points_px.copy()
    points[rows] -= apart[:, 1]
    channels = observations.channel_points_px.copy()
    channels[:, rows] -= apart.transpose(1, 0, 2)
    flux = observations.flux.copy()
    green = flux[rows, flux.shape[1] // 2, None] / aliasing.brightened[:, None]
    flux[rows] = np.where(aliasing.green_alone[:, None], green, flux[rows])
    unsure = _UNSURE**2 * np.einsum("kci,kcj->ckij", dragged, dragged)
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
