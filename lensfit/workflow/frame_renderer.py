"""One plate through a lens: which channels change, where, and what the header says.

Colour layers (R, G, B, with A where there is one) are rendered; every other channel,
and Cryptomatte whatever its channels are called, keeps its bits: ids and depths must
not be mixed, so they still describe the *undistorted* plate. A plate may have overscan
(a data window larger than the display window); what is written is the display
window, or the plate's own data window when overscan is kept. A plate with a depth
channel gets depth of field; a deep plate is returned flat.
"""

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal, final

import msgspec
import numpy as np
from jaxtyping import Float32

from lensfit import __version__
from lensfit.coords import Window
from lensfit.errors import ImageError
from lensfit.io.depth import FoundDepth, ray_slant
from lensfit.io.exr import ExrImage, ExrPart, read_exr
from lensfit.io.exr_deep import is_deep, read_deep
from lensfit.io.exr_layers import with_channels
from lensfit.io.stmap import Stmap, read_stmap
from lensfit.preset.schema import Preset
from lensfit.render.buffers import aligned_empty
from lensfit.render.filters import Filter, filter_for
from lensfit.render.frame import render_stages, window_with_margin
from lensfit.render.layer_stack import LayerStack, Mattes, flattened
from lensfit.render.stages import (
    DEFAULT_TOLERANCE,
    Stages,
    Switches,
    prepare_stages,
)
from lensfit.render.uv import PlateGeometry, SourceMap
from lensfit.workflow.deep_layers import deep_layers
from lensfit.workflow.frame_outputs import explaining_picture
from lensfit.workflow.plate import ColourLayer, colour_layers, resized_channels
from lensfit.workflow.plate_depth import DepthOptions, depth_meaning, plate_depth
from lensfit.workflow.plate_mattes import plate_mattes, with_edge_mask
from lensfit.workflow.plate_notes import border_note, number_note
from lensfit.workflow.plate_state import PlateState, StateOverrides, plate_state

Output = Literal["result", "circle-of-confusion", "aberration-dots", "filter"]
SAID = "lensfit/applied"
"""Header entry that tells what was done to a frame."""
NO_DEPTH = "plates hold no depth, so depth of field is left out"
DEEP_IS_FLAT = "deep plates are returned flat, as R, G, B, A"
_NEAREST_FOCAL_LENGTHS = 1.5
_DEEP_ATTRIBUTES = ("deepImageState", "maxSamplesPerPixel", "version", "chunkCount")
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
    method : Interpolating filter; chosen by the tolerance if None.
    overwrite : Render frames again that are finished.
    depth : What the user says about the depth channel.
    edge_mask : Objects of the Cryptomatte whose depth reaches over all they touch.
    output : The result, or a picture that explains it (see `frame_outputs`).
    """

    overrides: StateOverrides = field(default_factory=StateOverrides)
    switches: Switches = field(default_factory=Switches)
    keep_overscan: bool = False
    layers: Sequence[str] | None = None
    stmap: Path | None = None
    tolerance: float = DEFAULT_TOLERANCE
    method: Filter | None = None
    overwrite: bool = False
    depth: DepthOptions = field(default_factory=DepthOptions)
    edge_mask: Sequence[str] = ()
    output: Output = "result"

    @property
    def filter(self) -> Filter:
        """The interpolating filter."""
        return self.method or filter_for(self.tolerance)


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
        if self.options.output != "result":
            return explaining_picture(self, path)
        if is_deep(path):
            return self._render_deep(path)
        image = read_exr(path)
        state = self.noted_state(image)
        layers = [colour_layers(part, self.options.layers) for part in image.parts]
        if not any(layers):
            raise _no_colour(image, self.options.layers)
        return ExrImage(
            tuple(
                self._render_part(part, found, state, (image, path))
                for part, found in zip(image.parts, layers, strict=True)
            )
        )

    def noted_state(self, image: ExrImage) -> PlateState:
        """The camera state of a plate; what was assumed is noted."""
        state = self._state_of(image)
        for note in state.notes:
            self._note(note)
        return state

    def note_if_made_otherwise(self, plate: Path, target: Path) -> None:
        """Say so when a finished frame is not what would be rendered now."""
        wanted = self._said(self._state_of(self.header_of(plate)))
        parts = read_exr(target, header_only=True).parts
        made = next((p.attributes[SAID] for p in parts if SAID in p.attributes), None)
        if made != wanted:
            self._note(
                "some frames were finished before with other settings or by an older "
                "preset, and were kept (--overwrite renders them again)"
            )

    def header_of(self, plate: Path) -> ExrImage:
        """A plate without its pixels."""
        if is_deep(plate):
            return ExrImage((read_deep(plate).flat,))
        return read_exr(plate, header_only=True)

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
        self,
        part: ExrPart,
        layers: list[ColourLayer],
        state: PlateState,
        plate: tuple[ExrImage, Path],
    ) -> ExrPart:
        keep = self.options.keep_overscan
        window = part.data_window if keep else part.display_window
        result = resized_channels(part, window)
        if not layers:
            return result
        depth, mattes = self.depth_of(part, state, *plate)
        reach = window if depth is None else self._reach(part, window)
        stages = self.stages_for(state, part.display_window, reach)
        self._note_border(stages, window, part.data_window)
        for layer in layers:
            pixels = _stacked(part, layer.names)
            self._note(number_note(pixels))
            rendered = render_stages(
                pixels,
                part.data_window,
                stages,
                window,
                method=self.options.filter,
                depth_mm=depth,
                mattes=mattes,
            )
            result = with_channels(result, layer.names, rendered)
        return self.signed(result, state)

    def depth_of(
        self, part: ExrPart, state: PlateState, image: ExrImage, path: Path
    ) -> tuple[np.ndarray | None, Mattes | None]:
        """Depth and objects over the data window of a part with colours; none where
        depth of field is not wanted or cannot be had, which is noted."""
        if not self.options.switches.defocus:
            return None, None
        found = plate_depth(
            image,
            part,
            self.options.depth,
            self.geometry(state, part.display_window),
            self._cg_focal_length_mm(state),
        )
        if found is None:
            self._note(NO_DEPTH)
            return None, None
        depth = found.depth_mm
        names = self.options.edge_mask
        if names:
            depth = with_edge_mask(depth, image, path, part.data_window, names)
        for note in found.notes:
            self._note(note)
        if not self._knows_blur(state):
            return None, None
        depth = self._within_reach(depth, state)
        return depth, plate_mattes(image, path, part.data_window)

    def _within_reach(self, depth_mm: np.ndarray, state: PlateState) -> np.ndarray:
        """Distances of which the lens has an image at all."""
        lens = self.preset.at(*state.lens_key)
        nearest_mm = _NEAREST_FOCAL_LENGTHS * lens.focal_length_mm
        if lens.blur is not None:
            from_pupil = lens.blur.nearest_mm - float(lens.entrance_pupil_offset_mm)
            nearest_mm = max(nearest_mm, 1.05 * from_pupil)
        if not (depth_mm < nearest_mm).any():
            return depth_mm
        self._note(
            f"depth nearer than {nearest_mm:.0f} mm, of which the lens has no image, "
            "is taken as that"
        )
        return np.maximum(depth_mm, np.float32(nearest_mm))

    def _knows_blur(self, state: PlateState) -> bool:
        """Whether the lens has kernels at this state; said so if not."""
        lens = self.preset.at(*state.lens_key)
        if lens.blur is not None or None not in (
            lens.f_number,
            lens.focus_distance_mm,
        ):
            return True
        if self.options.depth.asked or self.options.edge_mask:
            raise ImageError(
                "states no f-number or focus distance, which depth of field needs",
                remedy="give --f-number and --focus-distance-mm, or --no-defocus",
            )
        self._note(
            "depth of field is left out: f-number or focus distance is not known "
            "(--f-number, --focus-distance-mm)"
        )
        return False

    def _render_deep(self, path: Path) -> ExrImage:
        """A deep plate, flat: its layers hold what the front ones hide."""
        deep = read_deep(path)
        flat, options = deep.flat, self.options
        state = self.noted_state(ExrImage((flat,)))
        meaning, notes = depth_meaning(
            ExrImage((flat,)),
            FoundDepth(flat, options.depth.channel or "Z"),
            options.depth,
        )
        slant = 1.0
        if meaning.kind == "ray":
            offsets = self.geometry(state, flat.display_window).mm(
                flat.data_window.pixel_centres()
            )
            slant = ray_slant(offsets, self._cg_focal_length_mm(state))
        stack = deep_layers(deep, meaning, slant, depth_channel=options.depth.channel)
        window = flat.data_window if options.keep_overscan else flat.display_window
        blurs = options.switches.defocus and self._knows_blur(state)
        if blurs:
            depth = self._within_reach(stack.depth_mm, state)
            pixels = LayerStack(stack.rgba, depth)
        else:
            pixels = flattened(stack)
        reach = self._reach(flat, window) if blurs else window
        stages = self.stages_for(state, flat.display_window, reach)
        self._note_border(stages, window, flat.data_window)
        for note in (*notes, DEEP_IS_FLAT):
            self._note(note)
        rendered = render_stages(
            pixels, flat.data_window, stages, window, method=options.filter
        )
        kept = {k: v for k, v in flat.attributes.items() if k not in _DEEP_ATTRIBUTES}
        planes = np.ascontiguousarray(np.moveaxis(rendered, -1, 0))
        channels = dict(zip("RGBA", planes, strict=True))
        result = replace(flat, channels=channels, data_window=window, attributes=kept)
        return ExrImage((self.signed(result, state),))

    def signed(self, part: ExrPart, state: PlateState) -> ExrPart:
        """The part with a header that says what was done to it."""
        said = {**part.attributes, SAID: self._said(state)}
        if OVERSCAN in said and part.data_window == part.display_window:
            said[OVERSCAN] = "0" if isinstance(said[OVERSCAN], str) else 0.0
        return replace(part, attributes=said)

    def _note_border(self, stages: Stages, window: Window, source: Window) -> None:
        if self._stages_noted is not stages:
            self._note(border_note(stages, window, source))
            self._stages_noted = stages

    def geometry(self, state: PlateState, display: Window) -> PlateGeometry:
        """How a plate lies on the sensor."""
        lens = self.preset.at(*state.lens_key)
        return PlateGeometry.of(lens, display, state.sensor_width_mm)

    def _cg_focal_length_mm(self, state: PlateState) -> float:
        stated = state.lens_key[0]
        return self.preset.entries[0].focal_length_mm if stated is None else stated

    def stages_for(self, state: PlateState, display: Window, window: Window) -> Stages:
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

    def _reach(self, part: ExrPart, window: Window) -> Window:
        """Pixels from which light may spread into `window`: all that the plate has, as
        far as an external map knows where they land."""
        wanted = window_with_margin(window, part.data_window)
        if self.stmap is None:
            return wanted
        known = self._mapped_window(self.stmap, part.display_window)
        low = np.maximum(wanted[:2], known[:2])
        high = np.minimum(wanted[2:], known[2:])
        return window_with_margin(window, Window(*map(int, (*low, *high))))

    @staticmethod
    def _mapped_window(stmap: Stmap, display: Window) -> Window:
        """The window of a map in the pixel space of a plate."""
        made, own = stmap.display_window, stmap.data_window
        dx, dy = display.x_min - made.x_min, display.y_min - made.y_min
        return Window(own.x_min + dx, own.y_min + dy, own.x_max + dx, own.y_max + dy)

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
        moved = self._mapped_window(self.stmap, display)
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
                ("depth of field", switches.defocus),
            )
            if on
        ]
        if self.options.stmap is not None:
            effects.append(f"map {self.options.stmap.name}")
        if switches.defocus and self.options.edge_mask:
            effects.append(f"edges of {', '.join(self.options.edge_mask)}")
        lens = ", ".join([f"{self.preset.lens.name} ({self._digest})", *at])
        if self.options.output != "result":
            effects = [self.options.output]
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
