"""The wavefront after the joint adjustment, and takes whose points are chief rays.

Detected points constrain the shape of dots only weakly. So the joint adjustment moves
the wavefront along the errors that its own fit left undetermined, which change the
photographs least, and reduces its covariance to what the detected points leave. One
error is added to those that the scatter over dots shows, since what the model misses is
alike in all dots: that all centroid biases are wrong (`bias_cancelling_move`).

Then the shape of dots is fitted again with the centroid biases fixed where the joint
adjustment put them: a constrained refit. Where blur is a pixel wide, orders of coma
that cancel each other but for a shift barely change the image, and the photographs
alone would determine the bias with an error due to what the model misses. The biases
are fixed to a thousandth of a pixel, as observations in the normal equations.

A centroid is not where the chief ray lands: coma and clipping move it, differently at
every f-number, focus and colour. The wavefront gives that bias (`centroid_biases`). The
position of the chief ray is the centroid minus the bias, and geometry and lateral
colour are fitted to these positions. Photographs of one setting do not tell the bias:
there the centroids stand for the chief rays.

(The place at which the modelled image suits the photograph best is the same in theory;
in practice it carries the noise of the rays that the image is made of.)
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from jaxtyping import Float, Int
from scipy.interpolate import RBFInterpolator

from lensfit.detect.observations import CHANNELS
from lensfit.fitting.chart_view import View
from lensfit.fitting.joint_adjustment import ErrorAmplitudes
from lensfit.fitting.wavefront.aliasing import Aliasing, aliasing_of
from lensfit.fitting.wavefront.centroid_biases import (
    centroid_bias_slopes_mm,
    centroid_biases_mm,
    detected_point_moves_mm,
    linear_detected_point_moves_mm,
    sampled_dots,
    smooth_centroid_biases_mm,
    smooth_line_light_shares,
)
from lensfit.fitting.wavefront.dot_data import DotData
from lensfit.fitting.wavefront.dot_patches import DotPhotograph
from lensfit.fitting.wavefront.fit import WavefrontFit
from lensfit.fitting.wavefront.misfit import misfit_of
from lensfit.fitting.wavefront.stages import Stage, chi_squared, recentre_patches
from lensfit.fitting.wavefront.term_groups import (
    LAST,
    colour_term_groups,
    deviation_of,
)
from lensfit.fitting.wavefront.uncertainty import parameter_moves

_BIAS_TOLERANCE_PX = 0.001
_LARGEST_SHARE_LEFT = 0.25
"""Largest share of the sum of squared biases that may remain."""
_ROUNDS = 3
_GREEN_ALONE, _ALL_CHANNELS = slice(1, 2), slice(None)


def bias_cancelling_move(
    stage: Stage, dot_data: DotData
) -> Float[np.ndarray, " parameters"]:
    """The move of the parameters that cancels green's biases, to first order, and
    changes the photographs least. Zero where they are too large for that.
    """
    few = sampled_dots(dot_data)
    slopes, value = _slopes(stage, few, _GREEN_ALONE), _value(stage, few, _GREEN_ALONE)
    move = _least_move(stage, slopes, slopes.T @ value)
    undone = replace(stage, parameters=stage.parameters + move)
    left = _value(undone, few, _GREEN_ALONE)
    fully = np.sum(left**2) < _LARGEST_SHARE_LEFT * np.sum(value**2)
    return move if fully else np.zeros_like(move)


def refit_with_fixed_biases(stage: Stage, dot_data: DotData) -> Stage:
    """The shape of dots fitted again while the cost falls, with the centroid biases of
    all channels fixed at their present values."""
    few = sampled_dots(dot_data)
    held = _value(stage, few, _ALL_CHANNELS)
    off, cost = np.zeros_like(held), _cost(stage)
    for _ in range(_ROUNDS):
        slopes = _slopes(stage, few, _ALL_CHANNELS)
        move = _least_move(stage, slopes, stage.slope + slopes.T @ off)
        after = recentre_patches(replace(stage, parameters=stage.parameters + move))
        off = _value(after, few, _ALL_CHANNELS) - held
        cost_after = _cost(after) + float(np.sum(off**2))
        if not cost_after < cost:
            break
        stage, cost = after, cost_after
    return stage


def _value(stage: Stage, few: DotData, channels: slice) -> Float[np.ndarray, " biases"]:
    """Biases in units of `_BIAS_TOLERANCE_PX`."""
    return (centroid_biases_mm(stage, few)[:, channels] / _unit_mm(few)).ravel()


def _slopes(
    stage: Stage, few: DotData, channels: slice
) -> Float[np.ndarray, "biases parameters"]:
    """d `_value` / d parameter."""
    slopes = centroid_bias_slopes_mm(stage, few)[:, channels] / _unit_mm(few)[..., None]
    return slopes.reshape(-1, slopes.shape[-1])


def _unit_mm(few: DotData) -> Float[np.ndarray, "dots 1 2"]:
    pixel_mm = np.array([photograph.take.pixel_mm for photograph in few.photographs])
    return _BIAS_TOLERANCE_PX * pixel_mm[few.take][:, None]


def _least_move(
    stage: Stage,
    held: Float[np.ndarray, "biases parameters"],
    slope: Float[np.ndarray, " parameters"],
) -> Float[np.ndarray, " parameters"]:
    """A Gauss-Newton step with biases of these slopes as further observations.

    Parameters
    ----------
    slope : Half the gradient.
    """
    free = np.flatnonzero(stage.deviation > 0)
    matrix = stage.matrix_of_dots(free) + held[:, free].T @ held[:, free]
    matrix = matrix + stage.prior_matrix(free, stage.deviation[free])
    move = np.zeros(stage.layout.size)
    move[free] = -np.linalg.solve(matrix, slope[free])
    return move


def _cost(stage: Stage) -> float:
    off = stage.parameters - stage.mean
    stated = stage.stated_equations.sum_of_squares
    return chi_squared(stage) + stated + float(stage.precision @ off**2)


_GREEN = 1
_NEAREST = 24
"""Samples that a bias of a line is interpolated from."""
_BIAS_UNCERTAINTY = 0.05
"""Standard deviation of a bias, as a share of it: where biases are small, a photograph
counts for more."""


def chief_ray_takes(
    stage: Stage, dot_data: DotData, *, keep_centroids: bool = False
) -> list[View]:
    """The takes with points where the chief rays land, ordered as `photographs`.

    Detected points whose size is unknown stay where they are.

    Parameters
    ----------
    keep_centroids : The wavefront is of one setting, and does not tell the biases.
    """
    if keep_centroids:
        bias_mm = np.zeros((len(dot_data.take), len(CHANNELS), 2))
    else:
        bias_mm = smooth_centroid_biases_mm(stage, dot_data)
    shares = smooth_line_light_shares(stage, dot_data)
    aliasing = aliasing_of(stage, dot_data)
    takes = []
    for k, photograph in enumerate(dot_data.photographs):
        mine = dot_data.take == k
        of_take = Aliasing(*(part[mine] for part in aliasing))
        take = _take_at_chief_rays(photograph, bias_mm[mine], of_take)
        if take.observations.are_lines:
            take = _with_whole_light(take, photograph, shares[mine])
        takes.append(take)
    return takes


def _with_whole_light(
    take: View, photograph: DotPhotograph, shares: Float[np.ndarray, "dots 3 2"]
) -> View:
    """The take with all the light of bright lines; the field beside dark ones is what
    it was measured as."""
    seen = take.observations
    if not seen.bright:
        return take
    _, every = _values_at_every_mark(photograph, shares)
    channels = seen.flux.shape[1]
    own = np.take_along_axis(every, seen.family[:, None, None], 2)[..., 0]
    own = own if channels == len(CHANNELS) else own[:, _GREEN : _GREEN + 1]
    return replace(take, observations=replace(seen, flux=seen.flux / own))


def takes_with_shared_moves(
    takes: list[View],
    found: WavefrontFit,
    moves_of: Callable[[DotData], Float[np.ndarray, "dots moves 3 2"]],
    colour_orders: tuple[int, ...] = (),
) -> list[View]:
    """Takes with `shared_moves_mm`, the common errors of their points: the given moves,
    and a share of the bias (the model's error), alike in all takes of one f-number and
    focus; of one setting, where no bias is subtracted, all of it.

    Parameters
    ----------
    takes : At chief rays, of all photographs of the fit and then of those not fitted.
    moves_of : How independent errors of the wavefront move every detected point
        (`centroid_biases`).
    colour_orders : Of the last moves, which are `colour_moves_mm`.
    """
    colours = len(colour_orders)
    settings = [(take.f_number, take.focus_distance_mm) for take in takes]
    distinct = list(dict.fromkeys(settings))
    left, moved = iter(zip(takes, settings, strict=True)), []
    unsure = 1.0 if found.dot_data.of_one_setting else _BIAS_UNCERTAINTY
    for dot_data in _dot_data_of_photographs(found):
        bias_mm = smooth_centroid_biases_mm(found.stage, dot_data)
        parts = [moves_of(dot_data), unsure * bias_mm[:, None]]
        each_mm = np.concatenate(parts, 1)
        for k, photograph in enumerate(dot_data.photographs):
            take, setting = next(left)
            every_mm = _moves_of_marks(photograph, each_mm[dot_data.take == k])
            own, by_colour, biased = np.split(every_mm, [-1 - colours, -1])
            alike = np.zeros((len(distinct), *biased.shape[1:]))
            alike[distinct.index(setting)] = biased[0]
            take = replace(take, shared_moves_mm=np.concatenate([own, alike]))
            if colours:
                known = {"colour_moves_mm": by_colour, "colour_orders": colour_orders}
                take = replace(take, **known)
            moved.append(take)
    return moved


def _moves_of_marks(
    photograph: DotPhotograph, moves_mm: Float[np.ndarray, "dots moves 3 2"]
) -> Float[np.ndarray, "moves 3 marks 2"]:
    """Moves of every mark; zero where they are not known."""
    rows, known_mm = _values_at_every_mark(photograph, moves_mm)
    marks = len(photograph.take.observations)
    found = np.zeros((moves_mm.shape[1], 3, marks, 2))
    found[:, :, rows] = known_mm.transpose(1, 2, 0, 3)
    return found


def _dot_data_of_photographs(found: WavefrontFit) -> list[DotData]:
    """Of the photographs of the fit, and then of those that were not fitted."""
    every = [found.dot_data, found.unfitted]
    return [dot_data for dot_data in every if dot_data is not None]


def _values_at_every_mark(
    photograph: DotPhotograph, values: Float[np.ndarray, "dots *shape"]
) -> tuple[Int[np.ndarray, " marks"], Float[np.ndarray, "marks *shape"]]:
    """Which marks values are known of, and the values: of dots of those with a dot
    image, of lines of every sample, between and beyond those with one."""
    observations, rows = photograph.take.observations, photograph.dot_images.marks
    if not observations.are_lines:
        return rows, values
    known_px, every_px = observations.points_px[rows], observations.points_px
    plate = RBFInterpolator(
        known_px, values.reshape(len(rows), -1), _NEAREST, kernel="thin_plate_spline"
    )
    found = plate(every_px).reshape(len(every_px), *values.shape[1:])
    return np.arange(len(every_px)), found


def _take_at_chief_rays(
    photograph: DotPhotograph,
    bias_mm: Float[np.ndarray, "dots 3 2"],
    aliasing: Aliasing,
) -> View:
    """The take with its points at the chief rays, and dots' light free of aliasing."""
    take = photograph.take
    observations = take.observations
    error_mm = np.stack([bias_mm, aliasing.centroid_error_mm], 1)
    rows, error_mm = _values_at_every_mark(photograph, error_mm)
    bias_px = error_mm[:, 0] / take.pixel_mm
    apart = bias_px + error_mm[:, 1] / take.pixel_mm
    points = observations.points_px.copy()
    points[rows] -= apart[:, 1]
    channels = observations.channel_points_px.copy()
    channels[:, rows] -= apart.transpose(1, 0, 2)
    flux, of_dots = observations.flux.copy(), photograph.dot_images.marks
    green = flux[of_dots, flux.shape[1] // 2, None] / aliasing.brightness_ratio[:, None]
    flux[of_dots] = np.where(aliasing.green_alone[:, None], green, flux[of_dots])
    unsure = _BIAS_UNCERTAINTY**2 * np.einsum("kci,kcj->ckij", bias_px, bias_px)
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


_LARGEST_MISFIT_RATIO = 1.1
"""Largest ratio of the misfit of dots' shape after the adjustment to that before."""


def chief_ray_takes_with_shared_moves(found: WavefrontFit) -> list[View]:
    """The takes with points where chief rays land, and how errors of the wavefront
    move them."""
    stage, of_one_setting = found.stage, found.dot_data.of_one_setting
    covariance = found.covariance + found.model_errors.of_points
    moves = parameter_moves(stage, covariance)
    orders, colours = _colour_moves(stage)
    moves = np.concatenate([moves, colours])
    takes = [
        take
        for dot_data in _dot_data_of_photographs(found)
        for take in chief_ray_takes(stage, dot_data, keep_centroids=of_one_setting)
    ]

    def moves_of(dot_data: DotData) -> np.ndarray:
        return linear_detected_point_moves_mm(stage, dot_data, moves)

    return takes_with_shared_moves(takes, found, moves_of, orders)


def _colour_moves(
    stage: Stage,
) -> tuple[tuple[int, ...], Float[np.ndarray, "terms parameters"]]:
    """Orders of the terms of colour, and each by one deviation of its prior; none of
    grey photographs. Red and blue are fitted apart, and neither tells a square of the
    chromatic coordinate from the coordinate: that alone is moved."""
    layout = stage.layout
    if not stage.dot_data.colour:
        return (), np.zeros((0, layout.size))
    groups = tuple(colour_term_groups(layout))
    deviation = deviation_of(groups, layout, LAST)
    first = layout.blocks["colour"].start
    rows = first + np.arange(len(layout.colour_terms))
    return tuple(t.order for t in layout.colour_terms), np.diag(deviation)[rows]


def takes_with_error_moves(
    takes: list[View],
    found: WavefrontFit,
    errors: Float[np.ndarray, "errors parameters"],
) -> list[View]:
    """The same takes with how these errors (`wavefront_errors`) move every point.

    The first one is large; the others, of one standard deviation, are linear.
    """

    def moves_of(dot_data: DotData) -> np.ndarray:
        large = detected_point_moves_mm(found.stage, dot_data, errors[:1])
        small = linear_detected_point_moves_mm(found.stage, dot_data, errors[1:])
        return np.concatenate([large, small], 1)

    return takes_with_shared_moves(takes, found, moves_of)


def wavefront_errors(found: WavefrontFit) -> Float[np.ndarray, "errors parameters"]:
    """Moves of the parameters: first the one that cancels all centroid biases, then the
    independent errors of one standard deviation each."""
    whole = bias_cancelling_move(found.stage, found.dot_data)
    return np.concatenate([whole[None], parameter_moves(found.stage, found.covariance)])


def refit_without_centroid_bias(found: WavefrontFit) -> WavefrontFit:
    """The wavefront of one setting with centroid biases cancelled, if that explains the
    dots as well.

    Detected points of other settings would determine how far coma moves a centroid.
    Those of one setting lie on a smooth map whatever the bias, and the map without bias
    is the one that was measured. The shape of the dots tells another bias: so the
    deviation of what is cancelled is all of it.
    """
    whole = bias_cancelling_move(found.stage, found.dot_data)[None]
    kept = adjust_wavefront(found, whole, ErrorAmplitudes(np.ones(1), np.ones((1, 1))))
    return found if kept is None else kept


def adjust_wavefront(
    found: WavefrontFit,
    errors: Float[np.ndarray, "errors parameters"],
    amounts: ErrorAmplitudes,
) -> WavefrontFit | None:
    """The wavefront with these amounts of the errors added and the dots' shape
    refitted; None where the misfit of dots grows by more than a tenth.

    Parameters
    ----------
    errors : From `wavefront_errors`.
    amounts : Amount of each error.
    """
    stage = found.stage
    adjusted = replace(stage, parameters=stage.parameters + amounts.value @ errors)
    stage = refit_with_fixed_biases(recentre_patches(adjusted), found.dot_data)
    # After too large a move rays miss the patches, and the solve is undefined.
    numbers = (stage.parameters, *stage.equations)
    if not all(np.isfinite(part).all() for part in numbers):
        return None
    misfit = misfit_of(stage, found.term_groups)
    worse = misfit.median / found.misfit.median
    if not worse <= _LARGEST_MISFIT_RATIO:
        return None
    # The held-out misfit is computed at the minima of both halves, which fixed biases
    # do not reach: so it is scaled from the value before.
    misfit = misfit._replace(held_out_dots=worse * found.misfit.held_out_dots)
    before = np.diag([0.0, *np.ones(len(errors) - 1)])
    return replace(
        found,
        stage=stage,
        covariance=found.covariance + errors.T @ (amounts.covariance - before) @ errors,
        misfit=misfit,
    )
