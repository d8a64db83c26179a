"""The camera state of a plate, from its sources and the preset.

`lensfit.plate.camera.sources` lists the sources and their priority.

A missing value is an error where the result depends on it. Where the preset leaves no
choice, as of a prime's focal length, its value is used, with a note. Depth of field
does leave a choice: a lens that was measured at one focus distance and f-number can be
refocused and stopped down, so both must be stated (`lensfit.plate.frame.plate_lens`).

The standard attribute ``aperture`` is the f-number, but renderers write the width of
the film back under that name. A photographic lens closes to f/22 or f/32 at most, and
none in air is faster than f/0.5, the limit that the sine condition sets.

Depth and some focus distances are measured from the pinhole of the CG camera, which is
the lens' entrance pupil; focus distances on the barrel from the sensor. The difference
is the pupil's offset, which may itself change with focus.

Presets go by the focal length on the zoom ring. Some sources state that of a pinhole
instead: CG cameras, and the standard attribute ``pinholeFocalLength``. The preset turns
it into that of the ring, with a note where the two differ.
"""

import math
from collections.abc import Callable, Iterator, Mapping
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from lensfit.errors import ImageError
from lensfit.plate.camera.plate_camera import (
    SPELT,
    PlateCamera,
    SourcedValue,
    knobs_of_plate,
    option_of,
)
from lensfit.plate.notes import FrameNote
from lensfit.preset.knobs import NEUTRAL, Knobs, misspelt_knob_notes
from lensfit.preset.scaled_look import (
    UNSCALED,
    ScaledLook,
    scaled_look,
    spanned_width_note,
)
from lensfit.preset.schema import Preset
from lensfit.preset.select_entry import Selection, ring_focal_length_mm
from lensfit.rendering.look.white_balance import REC709, Chromaticities
from lensfit.rendering.uv import SpannedWidth

if TYPE_CHECKING:
    from lensfit.lens import Lens


class AssumedValue(NamedTuple):
    """A value that the preset alone decides.

    Attributes
    ----------
    name : Of the quantity.
    value : In its unit.
    whose : In words, such as "the preset's only one".
    """

    name: str
    value: float
    whose: str

    def note(self, camera: PlateCamera) -> FrameNote:
        """A sentence for whoever should have stated it."""
        shown = f"{self.value:g} mm" if self.name.endswith("_mm") else f"{self.value:g}"
        option = option_of(self.name)
        places = ", ".join(("the header", *camera.searched))
        return FrameNote(
            f"{camera.plate.name}: no {SPELT[self.name]} in {places}; {self.whose}, "
            f"{shown}, is used ({option} states another)",
            f"assumed {self.name}",
        )


def assumed_values(
    preset: Preset, camera: PlateCamera, chosen: Selection, *, falloff: bool
) -> Iterator[AssumedValue]:
    """What no source states and the preset has one of.

    Parameters
    ----------
    chosen : The state of the lens.
    falloff : Whether the fall-off, and so its f-number, matters.
    """
    only = "the preset's only one"
    if "focal_length_mm" not in camera.known:
        yield AssumedValue("focal_length_mm", preset.entries[0].focal_length_mm, only)
    fall_off = chosen.entry.fall_off
    if "f_number" not in camera.known and falloff and fall_off:
        stop = fall_off[0].f_number
        if stop is not None:
            yield AssumedValue("f_number", stop, "that of the preset's only fall-off")
    focus_mm = chosen.measured_focus_mm
    if "focus_distance_mm" not in camera.known and focus_mm is not None:
        yield AssumedValue("focus_distance_mm", focus_mm, only)
    if "sensor_width_mm" not in camera.known:
        width_mm = preset.camera.sensor_width_mm
        yield AssumedValue("sensor_width_mm", width_mm, "the preset's")


_ROUNDS = 4
_NOTED = 1e-4
"""Relative; the fourth digit of a ring is nobody's."""


def focus_distance_from_sensor_mm(
    depth_mm: float, lens_focused_at: Callable[[float | None], "Lens"]
) -> float:
    """Focus distance from the sensor of what is `depth_mm` from the entrance pupil.

    Parameters
    ----------
    lens_focused_at : The lens at a focus distance.
    """
    if math.isinf(depth_mm):
        return depth_mm
    focus_mm = depth_mm
    for _ in range(_ROUNDS):
        lens = lens_focused_at(focus_mm)
        closer = depth_mm + float(lens.entrance_pupil_offset_mm)
        if abs(closer - focus_mm) < 1e-6:
            break
        focus_mm = closer
    return float(f"{focus_mm:.7g}")


def ring_camera(preset: Preset, camera: PlateCamera) -> PlateCamera:
    """The camera, with the focal length of the ring in place of the pinhole's.

    A focal length of which nothing is known but the pinhole's stays where the focus
    distance is missing that its ring depends on.

    Raises
    ------
    PresetError : The preset does not reach the focus distance.
    """
    known = camera.known.get("focal_length_mm")
    if known is None or not known.of_pinhole:
        return camera
    focus = camera.known.get("focus_distance_mm")
    if focus is None and _has_many_focuses(preset):
        return camera
    pinhole_mm = float(known.value)
    ring_mm = ring_focal_length_mm(
        preset,
        pinhole_mm,
        None if focus is None else float(focus.value),
        from_pupil=focus is not None and focus.from_pupil,
    )
    source = f"{known.source}, {pinhole_mm:g} mm of the pinhole"
    ring = SourcedValue(ring_mm, source, rank=known.rank)
    note = None
    if _is_zoom(preset) and abs(ring_mm - pinhole_mm) > _NOTED * pinhole_mm:
        note = FrameNote(
            f"{camera.plate.name}: {known.source} states the focal length of a pinhole "
            f"({pinhole_mm:g} mm), which this lens has at {ring_mm:g} mm on its ring "
            "(--focal-length-mm states another)",
            "focal length of a pinhole",
        )
    return camera.with_known("focal_length_mm", ring, note)


LARGEST = 22.7
"""f/22 is f/22.63; cinema lenses end there."""
FASTEST = 0.5


def f_number_doubt(camera: PlateCamera) -> str | None:
    """A note on a doubtful f-number; None if it is plausible or the user stated it."""
    known = camera.known.get("f_number")
    if known is None or known.source.startswith("--"):
        return None
    value = float(known.value)
    if FASTEST <= value <= LARGEST:
        return None
    looks = "a film back in mm" if value > LARGEST else "another quantity"
    return (
        f"{camera.plate.name}: the f-number is {value:g} ({known.source}), which looks "
        f"like {looks} (--f-number states another)"
    )


BLUR = ("f_number", "focus_distance_mm")
"""What blur depends on."""
SCALED = "scaled look"
"""Topic of a note."""


class PlateState(NamedTuple):
    """The state a plate is rendered at.

    Attributes
    ----------
    lens_key : focal_length_mm, f_number and focus_distance_mm, as `Preset.at` takes
        them; None where the preset decides.
    sensor_width_mm : Width that the display window spans.
    scaled : How the plate's camera was scaled to that.
    notes : One sentence for each thing that was assumed.
    knobs : From the user, the header and the preset, in this order of priority.
    chromaticities : x and y of red, green, blue and white of the plate; None where its
        header does not state it.
    camera : What the sources of the plate know.
    assumed : What none of them knows, and the preset has one of.
    pixel_shape : Width of a pixel over its height, on the sensor
        (`lensfit.plate.pixel_shape`).
    """

    lens_key: tuple[float | None, float | None, float | None]
    sensor_width_mm: float
    notes: tuple[str, ...]
    knobs: Knobs = NEUTRAL
    chromaticities: Chromaticities | None = None
    camera: PlateCamera = PlateCamera({})
    assumed: tuple[AssumedValue, ...] = ()
    pixel_shape: float = 1.0
    scaled: ScaledLook = UNSCALED

    @property
    def spanned_width_mm(self) -> SpannedWidth:
        """Width that the display window spans, with the shape of its pixels."""
        return SpannedWidth(self.sensor_width_mm, self.pixel_shape)

    def applied(self, name: str) -> float | None:
        """A quantity of `lens_key` as it counts: known, or taken from the preset; None
        where nothing depends on it."""
        known = self.lens_key[list(_ENTRIES).index(name)]
        taken = (one.value for one in self.assumed if one.name == name)
        return next(taken, None) if known is None else known

    def of_plate(self, name: str) -> float | None:
        """The same as the plate's own camera has it, where the look is scaled."""
        focal, focus = self.scaled.plate_state(
            self.applied("focal_length_mm"), self.applied("focus_distance_mm")
        )
        scaled = {"focal_length_mm": focal, "focus_distance_mm": focus}
        return scaled[name] if name in scaled else self.applied(name)

    def require_blur(self) -> None:
        """Refuse a plate without the f-number and focus of its depth of field.

        Raises
        ------
        ImageError : As `require` says.
        """
        remedy = "leave depth of field out with --no-defocus"
        self.require(*BLUR, use="depth of field", remedy=remedy)

    def require(self, *names: str, use: str, remedy: str | None = None) -> None:
        """Refuse a plate of which some source should know more.

        Parameters
        ----------
        names : Quantities among those of `lens_key`.
        use : What they are for, such as "depth of field".
        remedy : What else could be done.

        Raises
        ------
        ImageError : One of them is not known; the line names it, the plate, where it
            was looked for and the option that gives it.
        """
        values = dict(zip(_ENTRIES, self.lens_key, strict=True))
        missing = [name for name in names if values[name] is None]
        if missing:
            raise _missing(missing, self.camera, f", which {use} needs", remedy)


_ENTRIES = {
    "focal_length_mm": "nominalFocalLength or lens/focal",
    "f_number": "aperture or lens/fstop",
    "focus_distance_mm": "focus or lens/focus",
}
"""Quantities of a lens' state, and where the header might have them."""


def plate_state(
    preset: Preset,
    camera: PlateCamera,
    attributes: Mapping[str, object],
    *,
    falloff: bool = True,
    knobs: Mapping[str, object] | None = None,
    scale_to_sensor: bool = False,
) -> PlateState:
    """The state of one plate.

    Parameters
    ----------
    preset : The lens, which decides what must be known.
    camera : What is known of the plate's camera.
    attributes : Header of the plate.
    falloff : Whether the fall-off, and so the f-number, matters.
    knobs : Knobs that the user set, by name.
    scale_to_sensor : Take the look as it is for a camera that it was not measured on.

    Raises
    ------
    ImageError : The sensor has no width or one that the lens is not known over, or a
        value is missing that the preset cannot do without; the line names it, where it
        was looked for and the option that gives it.
    PresetError : The preset does not reach the state.
    """
    scaled = UNSCALED
    camera = ring_camera(preset, camera)
    if scale_to_sensor:
        known = (camera.number(name) for name in ("focal_length_mm", "sensor_width_mm"))
        scaled = scaled_look(preset, *known)
    key = _lens_key(preset, camera, scaled)
    needed = _needed_quantities(preset, falloff)
    lacking = [n for n, v in zip(_ENTRIES, key, strict=True) if v is None]
    if missing := [name for name in lacking if name in needed]:
        raise _missing(missing, camera)
    chosen = preset.select(*key)
    taken = tuple(assumed_values(preset, camera, chosen, falloff=falloff))
    width, note = _width_mm(preset, camera, scaled)
    plate_knobs = knobs_of_plate(preset.knobs, attributes, camera.settings, knobs or {})
    notes = [*camera.notes, *chosen.notes, *(one.note(camera) for one in taken)]
    notes += [*([note] if note else []), *misspelt_knob_notes(attributes)]
    if (doubt := f_number_doubt(camera)) is not None:
        notes.append(FrameNote(doubt, "doubtful f-number"))
    for name, said in plate_knobs.notes:
        notes.append(FrameNote(f"{camera.plate.name}: {said}", f"contradiction {name}"))
    colours = _chromaticities(attributes)
    return PlateState(
        key,
        width,
        tuple(notes),
        plate_knobs.checked(),
        colours,
        camera,
        taken,
        scaled=scaled,
    )


def _chromaticities(attributes: Mapping[str, object]) -> Chromaticities | None:
    """The standard attribute; one that is not eight numbers says nothing."""
    try:
        numbers = np.asarray(attributes.get("chromaticities"), float).ravel()
    except (TypeError, ValueError):
        return None
    if numbers.size != len(REC709) or not np.isfinite(numbers).all():
        return None
    return tuple(numbers.tolist())


def _lens_key(
    preset: Preset, camera: PlateCamera, scaled: ScaledLook
) -> tuple[float | None, float | None, float | None]:
    focal, stop, focus = map(camera.number, _ENTRIES)
    focal, focus = scaled.measured_state(focal, focus)
    if focus is not None and camera.known["focus_distance_mm"].from_pupil:
        focus = focus_distance_from_sensor_mm(
            focus, lambda guess: preset.at(focal, stop, guess)
        )
    return focal, stop, focus


def _width_mm(
    preset: Preset, camera: PlateCamera, scaled: ScaledLook
) -> tuple[float, str | None]:
    """The width that the display window spans, and a note on it."""
    if scaled != UNSCALED:
        note = FrameNote(f"{camera.plate.name}: {scaled.note}", SCALED)
        return scaled.measured_width_mm, note
    width, measured = camera.number("sensor_width_mm"), preset.camera.sensor_width_mm
    if width is None:
        return measured, None  # as `assumed_values` has it
    return width, spanned_width_note(width, measured)


def _needed_quantities(preset: Preset, falloff: bool) -> list[str]:
    """What the preset cannot decide by itself."""
    needed = []
    if _is_zoom(preset):
        needed.append("focal_length_mm")
    if _has_many_focuses(preset):
        needed.append("focus_distance_mm")
    if falloff and any(len(entry.fall_off) > 1 for entry in preset.entries):
        needed.append("f_number")
    return needed


def _is_zoom(preset: Preset) -> bool:
    return len({entry.focal_length_mm for entry in preset.entries}) > 1


def _has_many_focuses(preset: Preset) -> bool:
    """Whether any focal length was measured at several focus distances."""
    focal_lengths = [entry.focal_length_mm for entry in preset.entries]
    return len(set(focal_lengths)) < len(focal_lengths)


def _missing(
    names: list[str], camera: PlateCamera, use: str = "", remedy: str | None = None
) -> ImageError:
    words = " and no ".join(SPELT[name] for name in names)
    entries = ", ".join(_ENTRIES[name] for name in names)
    places = ", ".join([f"{entries} in the header", *camera.searched])
    options = " and ".join(map(option_of, names))
    return ImageError(
        f"states no {words}{use} (looked for {places})",
        where=camera.plate,
        remedy=f"give it with {options}" + (f", or {remedy}" if remedy else ""),
    )
