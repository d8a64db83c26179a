"""Convert the numbers of a preset entry to a lens with its covariances, and back.

The file states a squeeze as ratio and azimuth, which is common usage; the optics keep
the logarithmic strain, which is smooth where there is no squeeze
(`lensfit.optics.distortion`). Nothing else is converted.

The covariance of an entry is in the fit's parameters (`lensfit.fitting.parameters`):
the principal distance by its logarithm, the principal point in reference radii, all
else as in the file. Of the free field, numbers along x come first, then as many along
y. A number that is not named was fixed and has no variance. Other parameters (errors of
the chart, shifts of wide apertures) change no chief ray.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial

import jax.numpy as jnp
import msgspec
import numpy as np
from jaxtyping import Float

from lensfit.lens import Lens
from lensfit.optics import field
from lensfit.optics.distortion import Distortion
from lensfit.optics.falloff import Illumination
from lensfit.optics.field import ANAMORPHIC_TERMS, DECENTERING_TERMS, PRISM_TERMS
from lensfit.optics.lateral import ChannelShift
from lensfit.optics.map_deviations import MapCovariances
from lensfit.optics.projection import PupilShift
from lensfit.preset import blocks
from lensfit.preset.adjusted_lens import adjusted_lens
from lensfit.preset.blocks import (
    Camera,
    Covariance,
    fall_off_names,
    lateral_names,
    member_names,
)
from lensfit.preset.blur_of_block import lens_blur, with_moves
from lensfit.preset.entry import Entry
from lensfit.preset.inactive_overrides import inactive_overrides
from lensfit.preset.knobs import NEUTRAL, Knobs
from lensfit.preset.photographed_stops import unphotographed_f_number_note
from lensfit.preset.select_entry import Selection
from lensfit.psf.lens_blur import LensBlur
from lensfit.psf.lens_psf import STEP, MovedBlur, fewer_moves

NO_BLUR = "blur was not measured; a perfect lens stands in for it"
"""Note of a preset without a measured blur."""
_MOST_HALVINGS = 20


def lens_of_selection(
    chosen: Selection, camera: Camera, knobs: Knobs = NEUTRAL
) -> Lens:
    """The adjusted lens at a state that may lie beyond what was measured.

    Raises
    ------
    ImageError : The filter image of the knobs cannot be read, or lets no light through.
    """
    lens, block = _measured_lens(chosen, camera), chosen.entry.blur
    inactive = inactive_overrides(
        lens,
        knobs.aberration,
        knobs.bokeh,
        blur_is_known=lens.blur is not None or block is None,
    )
    if inactive:
        lens = replace(lens, notes=(*lens.notes, *map(str, inactive)))
    adjusted = adjusted_lens(lens, knobs.aberration, knobs.bokeh)
    if lens.blur is None or block is None or block.uncertainty is None:
        return adjusted
    return replace(adjusted, moved_blurs=partial(_perturbed_blurs, chosen, lens, knobs))


def _measured_lens(chosen: Selection, camera: Camera) -> Lens:
    """The lens as it was measured."""
    entry, f_number, blur = chosen.entry, chosen.f_number, None
    notes = chosen.notes + (NO_BLUR,) * (entry.blur is None)
    distortion = _optics_of(entry.projection, entry.distortion)
    if entry.blur is not None and f_number is not None:
        blur = lens_blur(entry, f_number, chosen.measured_focus_mm)
        notes += unphotographed_f_number_note(entry.blur.stops, f_number)
    return Lens(
        distortion=distortion,
        lateral_colour=_lateral_of(entry.lateral_colour),
        illumination=_illumination_of(entry.fall_off),
        entrance_pupil_offset_mm=_number(entry.projection.entrance_pupil_offset_mm),
        pupil_shift=_pupil_shift_of(entry.projection),
        sensor_size_mm=(camera.sensor_width_mm, camera.sensor_height_mm),
        focal_length_mm=entry.focal_length_mm,
        f_number=f_number,
        focus_distance_mm=entry.focus_distance_mm,
        notes=notes,
        blur=blur,
        covariances=map_covariances(entry, distortion),
    )


def _perturbed_blurs(
    chosen: Selection, lens: Lens, knobs: Knobs, draws: int | None
) -> Iterator[MovedBlur]:
    """The blur at that state for every move of the block's uncertainty, or for so many
    that stand for all, adjusted alike; see `lensfit.psf.lens_psf`. `lens` is
    not adjusted yet."""
    block, f_number = chosen.entry.blur, chosen.f_number
    assert block is not None
    assert block.uncertainty is not None
    assert f_number is not None
    known = block.uncertainty

    def blur_of(move: Sequence[float], share: float) -> LensBlur:
        steps = dict(zip(known.numbers, (share * v for v in move), strict=True))
        moved = msgspec.structs.replace(with_moves(block, steps), uncertainty=None)
        entry = msgspec.structs.replace(chosen.entry, blur=moved)
        blur = lens_blur(entry, f_number, chosen.measured_focus_mm)
        adjusted = adjusted_lens(
            replace(lens, blur=blur), knobs.aberration, knobs.bokeh
        )
        assert adjusted.blur is not None
        return adjusted.blur

    moves = known.moves if draws is None else fewer_moves(known.moves, draws)
    for move in moves:
        yield _moved_blur(partial(blur_of, move))


def _moved_blur(blur_of: Callable[[float], LensBlur]) -> MovedBlur:
    """By `STEP`, or by a quarter of what a blur can take, where it is linear: wide
    deviations reach beyond what it can be, a pupil behind the sensor."""
    for halvings in range(_MOST_HALVINGS):
        step = STEP / 2**halvings
        with suppress(ValueError):
            moved = MovedBlur(blur_of(step), blur_of(-step), step)
            if not halvings:
                return moved
            return MovedBlur(blur_of(step / 4), blur_of(-step / 4), step / 4)
    raise ValueError("a standard deviation of the blur is no number")


def lens_of_entry(
    entry: Entry,
    camera: Camera,
    f_number: float | None = None,
) -> Lens:
    """The lens at the state of `entry`, whose `fall_off` has at most one member."""
    chosen = Selection(entry, f_number, (), entry.focus_distance_mm)
    return lens_of_selection(chosen, camera)


def distortion_block(distortion: Distortion) -> blocks.Distortion:
    """The block that describes `distortion` in a file; all-zero terms are left out, but
    for radial ones, which a covariance may name."""
    decentering, prism, anamorphic = np.split(
        np.asarray(distortion.named),
        [field.DECENTERING_TERMS, field.DECENTERING_TERMS + field.PRISM_TERMS],
    )
    e1, e2 = (float(e) for e in distortion.squeeze)
    free = np.asarray(distortion.free)
    return blocks.Distortion(
        base=distortion.base,
        reference_radius_mm=float(distortion.reference_radius_mm),
        valid_radius=float(distortion.valid_radius),
        valid_box=tuple(np.asarray(distortion.box).ravel().tolist()),
        radial_log_slope=tuple(np.asarray(distortion.radial).tolist()),
        decentering=_short(decentering),
        thin_prism=_short(prism),
        anamorphic=_short(anamorphic),
        squeeze=math.exp(math.hypot(e1, e2)),
        squeeze_axis_rad=math.atan2(e2, e1) / 2,
        field=blocks.FreeField(
            distortion.degree, tuple(free[0].tolist()), tuple(free[1].tolist())
        )
        if np.any(free)
        else None,
    )


def _optics_of(p: blocks.Projection, d: blocks.Distortion) -> Distortion:
    strain = math.log(d.squeeze)
    angle = 2 * d.squeeze_axis_rad
    degree = d.field.degree if d.field else 0
    free = [d.field.x, d.field.y] if d.field else [(), ()]
    named = np.concatenate(
        [
            _padded_with_zeros(d.decentering, field.DECENTERING_TERMS),
            _padded_with_zeros(d.thin_prism, field.PRISM_TERMS),
            _padded_with_zeros(d.anamorphic, field.ANAMORPHIC_TERMS),
        ]
    )
    return Distortion(
        principal_distance_mm=_number(p.principal_distance_mm),
        principal_point_mm=_numbers(p.principal_point_mm),
        radial=_numbers(d.radial_log_slope),
        valid_radius=_number(d.valid_radius),
        squeeze=_numbers((strain * math.cos(angle), strain * math.sin(angle))),
        named=_numbers(named),
        free=jnp.asarray(np.array(free, float).reshape(2, -1)),
        box=_numbers(d.valid_box).reshape(2, 2),
        reference_radius_mm=_number(d.reference_radius_mm),
        base=d.base,
        degree=degree,
    )


def _pupil_shift_of(projection: blocks.Projection) -> PupilShift | None:
    """As the optics count: from the entrance pupil."""
    pupil_shift = projection.pupil_shift
    if pupil_shift is None:
        return None
    ahead_mm = pupil_shift.chart_distance_mm - projection.entrance_pupil_offset_mm
    return PupilShift(_number(pupil_shift.shift_mm), _number(ahead_mm))


def _lateral_of(
    colour: blocks.LateralColour | None,
) -> tuple[ChannelShift, ChannelShift] | None:
    if colour is None:
        return None

    def shift(block: blocks.ChannelShift) -> ChannelShift:
        return ChannelShift(
            _numbers(block.radial),
            _numbers(block.shift_mm),
            _number(block.valid_radius),
            _numbers(_padded_with_zeros(block.strain, 2)),
            _numbers(_padded_with_zeros(block.decentering, 2)),
        )

    return shift(colour.r), shift(colour.b)


def _illumination_of(fall_off: tuple[blocks.FallOff, ...]) -> Illumination | None:
    if not fall_off:
        return None
    block = fall_off[0]
    control = np.array([block.r, block.g, block.b], float)
    return Illumination(jnp.asarray(control), _number(block.valid_radius_mm))


def _number(value: float):
    return jnp.asarray(value, jnp.float64)


def _numbers(values):
    return jnp.asarray(np.asarray(values, float))


def _padded_with_zeros(values: tuple[float, ...], length: int) -> np.ndarray:
    return np.concatenate([values, np.zeros(length - len(values))])


def _short(values: np.ndarray) -> tuple[float, ...]:
    """Without the zeros at its end."""
    used = np.flatnonzero(values)
    return tuple(values[: used[-1] + 1].tolist()) if len(used) else ()


_FREE = "free_field"
_PERSPECTIVE = ("entrance_pupil_offset_mm", "pupil_shift_mm")
_ELSEWHERE = (
    *_PERSPECTIVE,
    "pupil_gap",
    "pupil_shift",
    "board_stretch",
    "aperture_shift",
)


def map_covariances(entry: Entry, distortion: Distortion) -> MapCovariances:
    """Of an entry at one f-number.

    Parameters
    ----------
    entry : Its `fall_off` has at most one member.
    distortion : Of the entry.
    """
    lateral, light = entry.lateral_colour, entry.fall_off[:1]
    red = blue = fall_off = None
    if lateral is not None and lateral.covariance is not None:
        radius_mm = entry.distortion.reference_radius_mm
        red = _channel_covariance(lateral.r, lateral.covariance.r, radius_mm)
        blue = _channel_covariance(lateral.b, lateral.covariance.b, radius_mm)
    if light and light[0].covariance is not None:
        fall_off = _fall_off_covariance(light[0], light[0].covariance)
    return MapCovariances(
        distortion=_distortion_covariance(entry.covariance, distortion),
        perspective=_perspective_covariance(entry.covariance, distortion),
        red=red,
        blue=blue,
        fall_off=fall_off,
    )


def _channel_covariance(
    channel: blocks.ChannelShift, covariance: Covariance, reference_radius_mm: float
) -> Float[np.ndarray, "terms terms"]:
    names = lateral_names(len(channel.radial))
    unit = np.ones(len(names))
    unit[:2] = 1 / reference_radius_mm
    return covariance.ordered_as(names) * np.outer(unit, unit)


def _fall_off_covariance(
    light: blocks.FallOff, covariance: blocks.FallOffCovariance
) -> Float[np.ndarray, "3 terms terms"]:
    return np.array(
        [
            getattr(covariance, channel).ordered_as(
                fall_off_names(channel, len(light.g))
            )
            for channel in ("r", "g", "b")
        ]
    )


def _distortion_covariance(
    covariance: Covariance | None, distortion: Distortion
) -> Float[np.ndarray, "numbers numbers"] | None:
    """Of the numbers of `lensfit.optics.map_deviations.changed_distortion`.

    None if the file does not state what one of them multiplies.
    """
    return _covariance_of_numbers(covariance, distortion, {})


def _perspective_covariance(
    covariance: Covariance | None, distortion: Distortion
) -> Float[np.ndarray, "numbers numbers"] | None:
    """Of those, then of entrance-pupil offset and shift; None where the file does not
    say how well the pupil is known."""
    offset, _ = member_names(dict.fromkeys(_PERSPECTIVE, 1))
    if covariance is None or offset not in covariance.parameters:
        return None
    return _covariance_of_numbers(
        covariance, distortion, dict.fromkeys(_PERSPECTIVE, 1)
    )


def _covariance_of_numbers(
    covariance: Covariance | None, distortion: Distortion, more: dict[str, int]
) -> Float[np.ndarray, "numbers numbers"] | None:
    if covariance is None:
        return None
    sizes = {
        "focal_length": 1,
        "principal_point": 2,
        "radial": distortion.radial.size,
        "squeeze": 2,
        "decentering": DECENTERING_TERMS,
        "thin_prism": PRISM_TERMS,
        "anamorphic": ANAMORPHIC_TERMS,
        _FREE: distortion.free.size,
        **more,
    }
    names = member_names(sizes)
    parameters = _with_free_field_counted(covariance.parameters, sizes[_FREE])
    if any(name not in names and _block(name) not in _ELSEWHERE for name in parameters):
        return None
    return Covariance(
        parameters, covariance.standard_deviation, covariance.correlation
    ).ordered_as(names)


def _with_free_field_counted(
    parameters: tuple[str, ...], count: int
) -> tuple[str, ...]:
    """Older presets count the field's numbers with gaps, but in the same order."""
    known = [name for name in parameters if _block(name) == _FREE]
    if len(known) != count:
        return parameters
    counted = iter(member_names({_FREE: count}))
    return tuple(next(counted) if name in known else name for name in parameters)


def _block(name: str) -> str:
    return name.partition("[")[0]
