"""Convert the numbers of a preset entry to a lens, and back.

The file states a squeeze as ratio and azimuth, which is common usage; the optics keep
the logarithmic strain, which is smooth where there is no squeeze
(`lensfit.optics.distortion`). Nothing else is converted.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial

import jax.numpy as jnp
import msgspec
import numpy as np

from lensfit.lens import Lens
from lensfit.optics import field
from lensfit.optics.distortion import Distortion
from lensfit.optics.falloff import Illumination
from lensfit.optics.lateral import ChannelShift
from lensfit.optics.projection import PupilShift
from lensfit.preset import blocks
from lensfit.preset.adjusted_lens import adjusted_lens
from lensfit.preset.blocks import Camera
from lensfit.preset.blur_of_block import blur_block as blur_block
from lensfit.preset.blur_of_block import lens_blur, with_moves
from lensfit.preset.entry import Entry
from lensfit.preset.inactive_overrides import inactive_overrides
from lensfit.preset.knobs import NEUTRAL, Knobs
from lensfit.preset.map_covariances import map_covariances
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
            _padded(d.decentering, field.DECENTERING_TERMS),
            _padded(d.thin_prism, field.PRISM_TERMS),
            _padded(d.anamorphic, field.ANAMORPHIC_TERMS),
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
            _numbers(_padded(block.strain, 2)),
            _numbers(_padded(block.decentering, 2)),
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


def _padded(values: tuple[float, ...], length: int) -> np.ndarray:
    return np.concatenate([values, np.zeros(length - len(values))])


def _short(values: np.ndarray) -> tuple[float, ...]:
    """Without the zeros at its end."""
    used = np.flatnonzero(values)
    return tuple(values[: used[-1] + 1].tolist()) if len(used) else ()
