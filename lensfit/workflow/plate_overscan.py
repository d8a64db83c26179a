"""The overscan that a plate has, and the overscan that it needs.

Both are read from its own header, as `apply` reads its camera.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from lensfit.coords import Window
from lensfit.plate.apply_options import ApplyOptions
from lensfit.plate.camera.plate_camera import SPELT
from lensfit.plate.camera.plate_state import BLUR, SCALED
from lensfit.plate.camera.sources import StateOverrides
from lensfit.plate.frame.plate_lens import PlateLens
from lensfit.plate.frame.plate_views import plate_views
from lensfit.plate.frame.tight_window import known_window
from lensfit.plate.notes import topic_of
from lensfit.plate.pixel_shape import SQUARE
from lensfit.plate.plate_file import plate_header
from lensfit.preset.schema import Preset
from lensfit.rendering.overscan import Margins
from lensfit.rendering.render_stages import Switches
from lensfit.workflow.overscan_plan import OverscanQuestion


@dataclass(frozen=True)
class PlateOverscan:
    """What a plate has beyond its frame.

    Attributes
    ----------
    question : What it needs, at its own camera state.
    margins : Pixels that its data window has beyond its display window.
    empty : Whether it ends inside the frame on the left, top, right and bottom, and so
        is empty beyond and needs nothing there.
    stated_percent : `lens/overscan` of its header; None if it states none.
    notes : What was assumed of its camera state.
    """

    question: OverscanQuestion
    margins: Margins
    empty: tuple[bool, ...]
    stated_percent: float | None
    notes: tuple[str, ...]

    def suffices(self, needed: Margins) -> bool:
        """Whether the plate holds every pixel that is read."""
        sides = zip(self.empty, self.margins[:4], needed[:4], strict=True)
        return all(empty or has >= needs for empty, has, needs in sides)


def _empty_sides(data: Window, frame: Window) -> tuple[bool, ...]:
    """Whether a plate ends inside the frame: left, top, right and bottom."""
    known = known_window(data, frame)
    return tuple(a != b for a, b in zip(known, data, strict=True))


def _margins_of(data: Window, frame: Window) -> Margins:
    """Pixels of a data window beyond the frame."""
    return Margins(
        max(0, frame.x_min - data.x_min),
        max(0, frame.y_min - data.y_min),
        max(0, data.x_max - frame.x_max),
        max(0, data.y_max - frame.y_max),
    )


def _stated_aspect(header_aspect: float) -> float | None:
    """A header that says 1 may not have been asked (`plate.pixel_shape`)."""
    return None if header_aspect == SQUARE else header_aspect


def _no_blur_note(path: Path, lacking: list[str]) -> str:
    return (
        f"{path.name}: no {' and no '.join(lacking)} is known, so what depth of field "
        "reads is not counted (--f-number, --focus-distance-mm)"
    )


def overscan_of_plate(
    preset: Preset,
    path: Path,
    overrides: StateOverrides | None = None,
    knobs: Mapping[str, object] | None = None,
    *,
    scale_to_sensor: bool = False,
) -> PlateOverscan:
    """The overscan that a plate needs by its own header, and the one it has.

    Parameters
    ----------
    overrides : Camera state that counts in place of the header's.
    knobs : Knobs that the user set, by name.
    scale_to_sensor : Put the look on a camera that it was not measured on; the answer
        to the question says how.

    Raises
    ------
    ImageError : The plate cannot be read, or nobody states what the preset needs; or
        the f-number was overridden and nobody states a focus distance.
    """
    overrides = overrides or StateOverrides()
    first, *others = plate_views(plate_header(path), path)
    part = first.view.image.parts[0]
    frame, data = part.display_window, part.data_window
    # Fall-off and its f-number read no pixel.
    options = ApplyOptions(
        overrides=overrides,
        switches=Switches(falloff=False),
        knobs=knobs or {},
        again=True,  # a finished frame has the windows of its plate
        scale_to_sensor=scale_to_sensor,
    )
    lens = PlateLens(preset, options)
    if others:
        lens.notes.add(f"the overscan is that of view {first.view.name!r}")
    state = lens.noted_state(first.header, path)
    focal, f_number, focus = state.lens_key
    focal, focus = state.scaled.plate_state(focal, focus)
    if overrides.f_number is not None:
        state.require("focus_distance_mm", use="depth of field")
    elif lacking := [SPELT[name] for name in BLUR if name not in state.camera.known]:
        lens.notes.add(_no_blur_note(path, lacking))
        f_number = None
    size = frame.width, frame.height
    question = OverscanQuestion(
        size,
        state.sensor_width_mm * state.scaled.lengths,
        None if focal is None else (focal, focal),
        None if focus is None else (focus, focus),
        f_number,
        knobs=state.knobs,
        pixel_aspect=_stated_aspect(part.pixel_aspect),
        scale_to_sensor=scale_to_sensor,
    )
    beyond = _margins_of(data, frame)
    stated = state.camera.number("overscan_percent")
    notes = [note for note in lens.notes.said if topic_of(note) != SCALED]
    if stated and not any(beyond[:4]):
        notes.append(
            f"the header states {stated:g} % overscan, but no pixel lies beyond the "
            "display window: the whole picture is taken as the frame"
        )
    empty = _empty_sides(data, frame)
    return PlateOverscan(question, beyond, empty, stated, tuple(notes))
