"""Select the entry of a preset for a lens state, interpolating between measured ones.

Focus is interpolated in dioptres (1/m), in which lens mechanics and distortion are
nearly linear, among the entries of one focal length. Then the focal length is
interpolated linearly. Piecewise linear interpolation keeps every parameter between its
neighbours, so that maps that do not fold at the measured states do not fold between
them either. Fall-off is interpolated in the logarithm of the f-number.

Beyond the measured focus distances the nearest measured state is used, with a note: a
prime measured at one focus serves all of them, its blur refocused by first-order optics
(`lensfit.preset.blur_of_block`). Nearer than its front focal point it has no image,
which is an error. Beyond the measured focal lengths the nearest is used within 5 %, as
metadata of a prime scatter; further away it is an error.

A preset is selected by the focal length that the lens shows on its barrel or zoom ring
(nominal). The pinhole with the picture's angle of view has another: it differs by the
tolerance of the barrel's number and grows with focusing. Each measured entry knows
both, so that the ring follows from the pinhole at a focus distance.

Focusing a lens as a whole, 1/c (c the principal distance) is exactly linear in the
vergence of the focus distance as seen from the entrance pupil; lenses with inner or
front focusing bend that line little. The weight of two neighbours is linear in that
vergence, and so is everything else that changes with focus.

Zooming, the ratio c/f is constant where the front group focuses and linear in f where
the whole lens does; it is interpolated linearly in f, like nearly all the rest.
Distortion that is the same function of the field angle at every focal length has
coefficients a_k of r^2k proportional to f^-2k (r on the sensor); the radial ones are
interpolated linearly in that.

All of this is exact at the measured states, continuous there, and keeps every number
between those of its neighbours.
"""

import math
from itertools import zip_longest
from typing import TYPE_CHECKING, NamedTuple

import msgspec

from lensfit.errors import PresetError
from lensfit.preset.blend import blend, interpolated_number
from lensfit.preset.entry import Entry
from lensfit.preset.scaled_look import SCALING_REMEDY
from lensfit.units import dioptres_from_mm, m_from_mm

if TYPE_CHECKING:
    from lensfit.preset.schema import Preset


def interpolated_in_focus(
    first: Entry, second: Entry, focus_distance_mm: float
) -> Entry:
    """The entry focused between two of one focal length.

    Raises
    ------
    PresetError : The two are of different models.
    """
    weight = focus_weight(first, second, focus_distance_mm)
    mixed = blend(first, second, weight)
    inverse = interpolated_number(
        1 / first.projection.principal_distance_mm,
        1 / second.projection.principal_distance_mm,
        weight,
    )
    mixed = _with_principal_distance(mixed, 1 / inverse)
    return msgspec.structs.replace(mixed, focus_distance_mm=focus_distance_mm)


def interpolated_in_focal_length(
    first: Entry, second: Entry, focal_length_mm: float
) -> Entry:
    """The entry zoomed between two.

    Raises
    ------
    PresetError : The two are of different models.
    """
    span_mm = second.focal_length_mm - first.focal_length_mm
    weight = (focal_length_mm - first.focal_length_mm) / span_mm
    mixed = blend(first, second, weight)
    ratio = interpolated_number(
        first.projection.principal_distance_mm / first.focal_length_mm,
        second.projection.principal_distance_mm / second.focal_length_mm,
        weight,
    )
    mixed = _with_principal_distance(mixed, ratio * focal_length_mm)
    slopes = (one.distortion.radial_log_slope for one in (first, second))
    radial = tuple(
        interpolated_number(
            a, b, _angular_weight(first, second, focal_length_mm, 2 * order)
        )
        for order, (a, b) in enumerate(zip_longest(*slopes, fillvalue=0.0), 1)
    )
    distortion = msgspec.structs.replace(mixed.distortion, radial_log_slope=radial)
    return msgspec.structs.replace(mixed, distortion=distortion)


def _angular_weight(
    first: Entry, second: Entry, focal_length_mm: float, power: int
) -> float:
    """Share of `second` of what goes as the focal length to minus `power`."""
    high = (second.focal_length_mm / first.focal_length_mm) ** -power
    requested = (focal_length_mm / first.focal_length_mm) ** -power
    return (1 - requested) / (1 - high)


def focus_weight(first: Entry, second: Entry, focus_distance_mm: float) -> float:
    """Share of `second` at a focus distance between both, 0 to 1.

    Both state theirs. Linear in the vergence from the entrance pupil; from the sensor,
    where a stated pupil lies beyond the nearest focus and cannot be meant.
    """
    assert first.focus_distance_mm is not None
    assert second.focus_distance_mm is not None
    low = dioptres_from_mm(first.focus_distance_mm)
    high = dioptres_from_mm(second.focus_distance_mm)
    requested = dioptres_from_mm(focus_distance_mm)
    from_sensor = (requested - low) / (high - low)
    pupil_m = [
        m_from_mm(one.projection.entrance_pupil_offset_mm) for one in (first, second)
    ]
    pupil_m.append(interpolated_number(pupil_m[0], pupil_m[1], from_sensor))
    seen = [
        v / (1 - v * offset)
        for v, offset in zip((low, high, requested), pupil_m, strict=True)
        if v * offset < 0.9
    ]
    if len(seen) < 3 or not math.copysign(1, high - low) * (seen[1] - seen[0]) > 0:
        return from_sensor
    return min(max((seen[2] - seen[0]) / (seen[1] - seen[0]), 0.0), 1.0)


def _with_principal_distance(entry: Entry, principal_distance_mm: float) -> Entry:
    projection = msgspec.structs.replace(
        entry.projection, principal_distance_mm=principal_distance_mm
    )
    return msgspec.structs.replace(entry, projection=projection)


FOCAL_LENGTH_SLACK = 0.05
_LARGEST_F_NUMBER = 1000
"""A pinhole's; what is beyond spreads over the whole frame by diffraction."""


class Selection(NamedTuple):
    """An entry at a lens state.

    Attributes
    ----------
    entry : At the state requested; its `fall_off` has at most one member.
    f_number : The one requested, or the widest measured; None when neither is known.
    measured_focus_mm : Focus distance that the entry's numbers hold for; None when
        nobody said.
    notes : One sentence for each way in which the preset was stretched.
    """

    entry: Entry
    f_number: float | None
    notes: tuple[str, ...]
    measured_focus_mm: float | None = None


def select(
    entries: tuple[Entry, ...],
    *,
    focal_length_mm: float | None = None,
    f_number: float | None = None,
    focus_distance_mm: float | None = None,
) -> Selection:
    """The entry at a lens state; see the module docstring for the rules.

    Raises
    ------
    PresetError : A value is missing that the preset needs, out of reach, or its
        neighbours are of different models and cannot be interpolated.
    """
    _check_positive("focal_length_mm", focal_length_mm)
    _check_positive("f_number", f_number)
    _check_positive("focus_distance_mm", focus_distance_mm)
    # Numbers of numpy and JAX are welcome; what is kept and compared are plain ones.
    focal_length_mm, f_number, focus_distance_mm = (
        None if value is None else float(value)
        for value in (focal_length_mm, f_number, focus_distance_mm)
    )
    notes: list[str] = []
    focal_lengths = sorted({entry.focal_length_mm for entry in entries})
    focal = _focal_length(focal_length_mm, focal_lengths, notes)
    low, high = _neighbours(focal, focal_lengths)
    at_focal = [
        _entry_of_focus_distances(
            [e for e in entries if e.focal_length_mm == measured],
            focus_distance_mm,
            f_number,
            notes,
        )
        for measured in dict.fromkeys((low, high))
    ]
    entry = at_focal[0]
    if len(at_focal) == 2:
        entry = interpolated_in_focal_length(at_focal[0], at_focal[1], focal)
    if f_number is None:
        f_number = _widest(entry)
    held_mm = entry.focus_distance_mm
    if focus_distance_mm is not None:
        entry = msgspec.structs.replace(entry, focus_distance_mm=focus_distance_mm)
    return Selection(entry, f_number, tuple(dict.fromkeys(notes)), held_mm)


def _widest(entry: Entry) -> float | None:
    """The f-number of the fall-off, or else the widest at which blur was measured."""
    if entry.fall_off:
        return entry.fall_off[0].f_number
    stops = entry.blur.stops if entry.blur else ()
    return min((stop.f_number for stop in stops), default=None)


def _check_positive(name: str, value: float | None) -> None:
    if value is not None and not value > 0:
        raise PresetError(
            f"{name} = {value:g} is not positive",
            remedy="give a positive number, in the unit of its name",
        )
    if name == "f_number" and value is not None and value > _LARGEST_F_NUMBER:
        raise PresetError(
            f"f_number = {value:g} is not one of a lens",
            remedy=f"give a number up to {_LARGEST_F_NUMBER}",
        )


def _focal_length(
    requested: float | None, measured: list[float], notes: list[str]
) -> float:
    span = f"{measured[0]:g} to {measured[-1]:g} mm"
    if requested is None:
        if len(measured) > 1:
            raise PresetError(
                f"the preset holds focal lengths {span}",
                remedy="say which is meant with focal_length_mm (--focal-length-mm)",
            )
        return measured[0]
    nearest = min(max(requested, measured[0]), measured[-1])
    if abs(requested - nearest) > FOCAL_LENGTH_SLACK * nearest:
        raise PresetError(
            f"focal length {requested:g} mm is not in the preset, which holds "
            + (span if len(measured) > 1 else f"{nearest:g} mm"),
            remedy="use the preset of that lens, photograph a grid at that setting, or "
            f"put this look there {SCALING_REMEDY}",
        )
    if nearest != requested:
        notes.append(
            f"focal length {requested:g} mm taken as the measured {nearest:g} mm"
        )
    return nearest


def _neighbours(value: float, measured: list[float]) -> tuple[float, float]:
    """The measured values on either side; the same twice where one is met."""
    low = max(m for m in measured if m <= value)
    high = min(m for m in measured if m >= value)
    return low, high


def _entry_of_focus_distances(
    entries: list[Entry],
    focus_distance_mm: float | None,
    f_number: float | None,
    notes: list[str],
) -> Entry:
    """One entry, from those of one focal length."""
    if len(entries) == 1:
        only = _entry_at_f_number(entries[0], f_number, notes)
        return _entry_at_focus(only, focus_distance_mm, notes)
    if focus_distance_mm is None:
        known = sorted(e.focus_distance_mm for e in entries if e.focus_distance_mm)
        raise PresetError(
            f"the preset holds several focus distances at "
            f"{entries[0].focal_length_mm:g} mm "
            f"({', '.join(f'{mm:.6g}' for mm in known)} mm)",
            remedy="say which is meant with focus_distance_mm (--focus-distance-mm); "
            "others lie between",
        )
    by_focus = {_dioptres(entry): entry for entry in entries}
    measured = sorted(by_focus)
    requested = dioptres_from_mm(focus_distance_mm)
    nearest = min(max(requested, measured[0]), measured[-1])
    low, high = _neighbours(nearest, measured)
    # Only what is used has anything to note.
    beside = [
        _entry_at_f_number(by_focus[d], f_number, notes)
        for d in dict.fromkeys((low, high))
    ]
    if low == high:
        return _entry_at_focus(beside[0], focus_distance_mm, notes)
    return interpolated_in_focus(beside[0], beside[1], focus_distance_mm)


def _entry_at_focus(
    entry: Entry, requested_mm: float | None, notes: list[str]
) -> Entry:
    """`entry`, with a note where it was measured at another focus."""
    measured_mm = entry.focus_distance_mm
    if requested_mm is None or requested_mm == measured_mm:
        return entry
    if requested_mm < (measured_mm or math.inf):
        _check_image(entry, requested_mm)
    if measured_mm is not None:
        note = (
            f"focus distance {requested_mm:g} mm is outside what was measured; "
            f"distortion, lateral colour and fall-off are those of {measured_mm:g} mm, "
            "depth of field follows the stated distance"
        )
        if entry.blur:
            note += ", as if the whole lens moved (unit focusing)"
        notes.append(note)
    return entry


def _check_image(entry: Entry, focus_distance_mm: float) -> None:
    """Refuse to focus nearer than the front focal point (`optics.paraxial`)."""
    magnification = entry.blur.pupil_magnification if entry.blur else 1.0
    to_pupil_mm = max(0.0, entry.projection.entrance_pupil_offset_mm)
    nearest_mm = to_pupil_mm + entry.focal_length_mm / magnification
    if focus_distance_mm <= nearest_mm:
        raise PresetError(
            f"a lens of {entry.focal_length_mm:g} mm has no image of what is "
            f"{focus_distance_mm:g} mm from the sensor, only beyond {nearest_mm:.0f} "
            "mm",
            remedy="focus distances are from the sensor, in mm (--focus-distance-mm)",
        )


def _dioptres(entry: Entry) -> float:
    if entry.focus_distance_mm is None:
        raise PresetError(
            f"an entry at {entry.focal_length_mm:g} mm lacks its focus distance, and "
            "the preset holds several",
            remedy="add focus_distance_mm to every entry",
        )
    return dioptres_from_mm(entry.focus_distance_mm)


def _entry_at_f_number(entry: Entry, f_number: float | None, notes: list[str]) -> Entry:
    """`entry` with one fall-off, at that f-number; the widest if none is requested."""
    by_stop = {one.f_number: one for one in entry.fall_off if one.f_number is not None}
    measured = sorted(by_stop)
    if not measured:
        if f_number is not None and entry.fall_off:
            notes.append("fall-off was measured at an f-number that nobody stated")
        return entry
    if f_number is None:
        return msgspec.structs.replace(entry, fall_off=(by_stop[measured[0]],))
    nearest = min(max(f_number, measured[0]), measured[-1])
    if nearest != f_number:
        notes.append(
            f"fall-off at f/{f_number:g} was not measured; f/{nearest:g} is used"
        )
    low, high = _neighbours(nearest, measured)
    chosen = by_stop[low]
    if low != high:
        weight = math.log(nearest / low) / math.log(high / low)
        chosen = blend(by_stop[low], by_stop[high], weight)
    if chosen.predicted:
        notes.append(
            f"fall-off at f/{f_number:g} is predicted from the pupil's shape, measured "
            "at other f-numbers"
        )
    chosen = msgspec.structs.replace(chosen, f_number=f_number)
    return msgspec.structs.replace(entry, fall_off=(chosen,))


_ROUNDS = 20
_SAME = 1e-9


def ring_focal_length_mm(
    preset: "Preset",
    pinhole_mm: float,
    focus_mm: float | None,
    *,
    from_pupil: bool = False,
) -> float:
    """The nominal focal length at which the lens images like a pinhole of this one.

    Beyond the measured focal lengths the ratio of both is that of the nearest. A
    prime's is its own within the slack that metadata of primes have.

    Parameters
    ----------
    pinhole_mm : Principal distance of the pinhole.
    focus_mm : Focus distance; None for a preset with one at each focal length.
    from_pupil : It counts from the entrance pupil rather than from the sensor.

    Raises
    ------
    PresetError : The preset does not reach the focus distance.
    """
    measured = sorted({entry.focal_length_mm for entry in preset.entries})
    ring, focus = pinhole_mm, focus_mm
    for _ in range(_ROUNDS):
        at = min(max(ring, measured[0]), measured[-1])
        projection = preset.select(at, None, focus).entry.projection
        before, ring = ring, pinhole_mm * at / projection.principal_distance_mm
        if focus_mm is not None and from_pupil:
            focus = focus_mm + projection.entrance_pupil_offset_mm
        if abs(ring - before) <= _SAME * ring:
            break
    if len(measured) == 1:
        near = (abs(one / measured[0] - 1) for one in (ring, pinhole_mm))
        return measured[0] if min(near) <= FOCAL_LENGTH_SLACK else ring
    # Headers hold single precision.
    nearest = min(measured, key=lambda one: abs(one - ring))
    return nearest if abs(ring / nearest - 1) < 1e-6 else float(f"{ring:.7g}")
