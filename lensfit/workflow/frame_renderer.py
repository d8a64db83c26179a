"""One plate through a lens: which channels change, where, and what the header says.

Colour layers (R, G, B, with A where there is one) are rendered; every other channel,
and Cryptomatte whatever its channels are called, keeps its bits: ids and depths must
not be mixed, so they still describe the *undistorted* plate. A plate may have overscan
(a data window larger than the display window); what is written is the display
window, or the plate's own data window when overscan is kept.
"""

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import final

import msgspec
import numpy as np
from jaxtyping import Float32

from lensfit import __version__
from lensfit.coords import Window
from lensfit.errors import ImageError
from lensfit.io.exr import ExrImage, ExrPart, read_exr
from lensfit.io.exr_layers import with_channels
from lensfit.io.stmap import Stmap, read_stmap
from lensfit.preset.schema import Preset
from lensfit.render.buffers import aligned_empty
from lensfit.render.filters import Filter
from lensfit.render.frame import render_stages
from lensfit.render.stages import (
    DEFAULT_TOLERANCE,
    Stages,
    Switches,
    prepare_stages,
)
from lensfit.render.uv import SourceMap
from lensfit.workflow.plate import ColourLayer, colour_layers, resized_channels
from lensfit.workflow.plate_notes import border_note, number_note
from lensfit.workflow.plate_state import PlateState, StateOverrides, plate_state

SAID = "lensfit/applied"
"""Header entry that tells what was done to a frame."""
OVERSCAN = "lens/overscan"
"""Header entry of the CG renderer, percent; none is left in a cropped frame."""


@dataclass(frozen=True)
class ApplyOptions:
    """How plates are rendered.

    Attributes
    ----------
    overrides : Camera state that counts in place of the headers.
    switches : Effects of the lens that are wanted.
    keep_overscan : Write the plate's data window rather than the display window.
    layers : Layers to render; every colour layer if None ("" is the unnamed one).
    stmap : A redistort map to use in place of the lens' own distortion.
    tolerance : Accepted error of the picture, display-referred.
    method : Interpolating filter.
    overwrite : Render frames again that are finished.
    """

    overrides: StateOverrides = field(default_factory=StateOverrides)
    switches: Switches = field(default_factory=Switches)
    keep_overscan: bool = False
    layers: Sequence[str] | None = None
    stmap: Path | None = None
    tolerance: float = DEFAULT_TOLERANCE
    method: Filter = "catmull-rom"
    overwrite: bool = False


@final
class FrameRenderer:
    """Renders frames; keeps what it knows about the lens while the camera stays."""

    def __init__(self, preset: Preset, options: ApplyOptions):
        self.preset = preset
        self.options = options
        self.notes: list[str] = []
        self.stmap = None if options.stmap is None else _redistort_map(options.stmap)
        self._key: object = None
        self._stages_noted: Stages | None = None
        self._digest = hashlib.sha256(msgspec.json.encode(preset)).hexdigest()[:8]
        self._stages: Stages | None = None

    def render(self, path: Path) -> ExrImage:
        """One finished frame."""
        image = read_exr(path)
        state = self._state_of(image)
        for note in state.notes:
            self._note(note)
        layers = [colour_layers(part, self.options.layers) for part in image.parts]
        if not any(layers):
            raise _no_colour(image, self.options.layers)
        return ExrImage(
            tuple(
                self._render_part(part, found, state)
                for part, found in zip(image.parts, layers, strict=True)
            )
        )

    def note_if_made_otherwise(self, plate: Path, target: Path) -> None:
        """Say so when a finished frame is not what would be rendered now."""
        wanted = self._said(self._state_of(read_exr(plate, header_only=True)))
        parts = read_exr(target, header_only=True).parts
        made = next((p.attributes[SAID] for p in parts if SAID in p.attributes), None)
        if made != wanted:
            self._note(
                "some frames were finished before with other settings or by an older "
                "preset, and were kept (--overwrite renders them again)"
            )

    def _note(self, note: str | None) -> None:
        if note and note not in self.notes:
            self.notes.append(note)

    def _state_of(self, image: ExrImage) -> PlateState:
        attributes = {
            k: v for p in reversed(image.parts) for k, v in p.attributes.items()
        }
        display = image.parts[0].display_window
        return plate_state(
            self.preset,
            attributes,
            (display.width, display.height),
            self.options.overrides,
            falloff=self.options.switches.falloff,
        )

    def _render_part(
        self, part: ExrPart, layers: list[ColourLayer], state: PlateState
    ) -> ExrPart:
        keep = self.options.keep_overscan
        window = part.data_window if keep else part.display_window
        result = resized_channels(part, window)
        if not layers:
            return result
        stages = self._stages_for(state, part.display_window, window)
        if self._stages_noted is not stages:
            self._note(border_note(stages, part.data_window))
            self._stages_noted = stages
        for layer in layers:
            pixels = _stacked(part, layer.names)
            self._note(number_note(pixels))
            rendered = render_stages(
                pixels, part.data_window, stages, window, method=self.options.method
            )
            result = with_channels(result, layer.names, rendered)
        said = {**result.attributes, SAID: self._said(state)}
        if OVERSCAN in said and window == part.display_window:
            said[OVERSCAN] = "0" if isinstance(said[OVERSCAN], str) else 0.0
        return replace(result, attributes=said)

    def _stages_for(self, state: PlateState, display: Window, window: Window) -> Stages:
        """Maps and gains; made anew only when the camera or the windows change."""
        key = (state.lens_key, state.sensor_width_mm, display, window)
        if self._stages is None or key != self._key:
            self._stages = None  # two sets need not be held in memory at once
            self._stages = prepare_stages(
                self.preset.at(*state.lens_key),
                display,
                window,
                tolerance=self.options.tolerance,
                switches=self.options.switches,
                sensor_width_mm=state.sensor_width_mm,
                external=self._external(display, window),
            )
            self._key = key
        return self._stages

    def _external(self, display: Window, window: Window) -> SourceMap | None:
        """The map of the file, in the plate's own pixel space."""
        if self.stmap is None:
            return None
        made = self.stmap.display_window
        size, wanted = (made.width, made.height), (display.width, display.height)
        if size != wanted:
            raise ImageError(
                f"is a map for {size[0]} x {size[1]}, the plate is "
                f"{wanted[0]} x {wanted[1]}",
                where=self.options.stmap,
                remedy="write the map at the size of the plate",
            )
        dx, dy = display.x_min - made.x_min, display.y_min - made.y_min
        own = self.stmap.data_window
        moved = Window(own.x_min + dx, own.y_min + dy, own.x_max + dx, own.y_max + dy)
        source_map = SourceMap.from_uv(self.stmap.uv, moved, display)
        try:
            return source_map.cropped(window)
        except ValueError as error:
            raise ImageError(
                "does not cover the pixels to render",
                where=self.options.stmap,
                remedy="write the map with the overscan of the plate",
            ) from error

    def _said(self, state: PlateState) -> str:
        """What was done, for whoever opens the file."""
        focal, f_number, focus = state.lens_key
        at = [
            f"{value:g} {unit}"
            for value, unit in ((focal, "mm"), (focus, "mm focus"))
            if value is not None
        ]
        at += [] if f_number is None else [f"f/{f_number:g}"]
        switches = self.options.switches
        effects = [
            name
            for name, on in (
                ("distortion", switches.distortion),
                ("lateral colour", switches.lateral_colour),
                ("fall-off", switches.falloff),
            )
            if on
        ]
        if self.options.stmap is not None:
            effects.append(f"map {self.options.stmap.name}")
        lens = ", ".join([f"{self.preset.lens.name} ({self._digest})", *at])
        return f"lensfit {__version__}: {lens}; {', '.join(effects) or 'nothing'}"


def _redistort_map(path: Path) -> Stmap:
    """An external map, which must not be one that takes distortion off."""
    found = read_stmap(path)
    if found.attributes.get("lensfit/map") == "undistort":
        raise ImageError(
            "is an undistort map, and a plate needs the redistort map",
            where=path,
            remedy="give the file of the same name that ends in redistort.exr",
        )
    return found


def _stacked(
    part: ExrPart, names: tuple[str, ...]
) -> Float32[np.ndarray, "height width channels"]:
    """Channels side by side, where JAX can use them without a copy."""
    window = part.data_window
    pixels = aligned_empty((window.height, window.width, len(names)))
    for index, name in enumerate(names):
        pixels[..., index] = part.channels[name]
    return pixels


def _no_colour(image: ExrImage, layers: Sequence[str] | None) -> ImageError:
    names = ", ".join(name for part in image.parts for name in part.channels)
    wanted = "" if layers is None else f" in {', '.join(map(repr, layers))}"
    return ImageError(
        f"holds no R, G, B to render{wanted}", remedy=f"its channels are {names}"
    )
