"""Straighten a photographed plate: the inverse of `flat_plate`.

Each pixel of the straight picture reads the photograph where the lens images it.
Distortion makes the picture larger or smaller, so the data window becomes that of the
whole photograph, straightened, with a margin of `SPARE_PX` pixels continued from the
photograph's own border for the filter of a later distortion. Where the data window
ends inside the display window, the picture is empty beyond (`frame.tight_window`), and
is not continued. If wanted, each channel reads by its own map (which removes lateral
colour) and the photograph is divided by its fall-off first (light lost on the sensor
belongs to where it landed).

The result is a pinhole picture. Its camera stands in the header (`Pinhole`).
"""

import json
import math
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Float32, Int

from lensfit.batches import in_batches
from lensfit.coords import Window
from lensfit.errors import ImageError
from lensfit.io.exr import ExrImage, ExrPart, with_channels
from lensfit.lens import Lens
from lensfit.plate.camera.plate_state import PlateState
from lensfit.plate.frame.flat_plate import layers_to_render, stacked_channels
from lensfit.plate.frame.plate_lens import PlateLens
from lensfit.plate.frame.plate_notes import number_note
from lensfit.plate.frame.provenance import UNDISTORTED, part_with_signature
from lensfit.plate.frame.tight_window import EmptyRing, known_window
from lensfit.plate.plate_file import ColourLayer, resized_channels
from lensfit.rendering.filters import Filter, longest_reach
from lensfit.rendering.overscan import window_of_percent
from lensfit.rendering.render_stages import (
    CHANNELS,
    Budget,
    apply_gain,
    illumination_gain,
    lateral_colour_px,
)
from lensfit.rendering.uv import Channel, PlateGeometry, SourceMap, source_map
from lensfit.rendering.warp import warp

PINHOLE = "lensfit/pinhole"
"""Header entry with the camera of a straight picture, as JSON."""
SPARE_PX = longest_reach() + 1
"""As wide as any filter reads, and the map's own error."""
MOST_GROWTH = 3.0
"""Width of a straight picture over that of its frame; a wider one is stated."""
_ALPHA = 3
_EMPTY_PX = 1
"""The same beside emptiness: the border's own pixels fade within it."""
_BORDER_POINTS = 512


class Pinhole(NamedTuple):
    """The camera of a straight picture, as matchmove programs ask for it.

    Attributes
    ----------
    focal_length_px : Along x and y; they differ where pixels are not square.
    centre_px : Principal point, from the top left corner of the display window.
    focal_length_mm : Of the pinhole with the same angle of view.
    film_back_mm : Width and height of the display window on the sensor.
    data_film_back_mm : Of the data window: the film back of the whole picture.
    data_offset_mm : Middle of the data window from the principal point, x right and y
        down.
    pixel_aspect : Width of a pixel over its height, on the sensor.
    display_window, data_window : x_min, y_min, x_max, y_max.
    """

    focal_length_px: tuple[float, float]
    centre_px: tuple[float, float]
    focal_length_mm: float
    film_back_mm: tuple[float, float]
    data_film_back_mm: tuple[float, float]
    data_offset_mm: tuple[float, float]
    pixel_aspect: float
    display_window: Window
    data_window: Window

    @property
    def text(self) -> str:
        """As the header holds it."""
        return json.dumps(self._asdict())


@dataclass(frozen=True, eq=False)
class Straightening:
    """How plates of one state and one size are straightened.

    Attributes
    ----------
    window : Pixels of the straight picture.
    ring : Emptiness about the photograph, where it ends inside the display window.
    maps : Where red, green and blue read the photograph; the same object where they
        share one.
    gains : Relative illumination over the photograph; None where it stays.
    beyond : For each map the pixels that show nothing of the photograph, as indices
        into a flat plane.
    """

    window: Window
    ring: EmptyRing
    maps: tuple[SourceMap, SourceMap, SourceMap]
    gains: tuple[Float32[np.ndarray, "height width"] | None, ...]
    beyond: tuple[Int[np.ndarray, " pixels"], ...]


def straight_window(
    lens: Lens,
    geometry: PlateGeometry,
    data_window: Window,
    channels: tuple[Channel, ...],
) -> Window:
    """The pixels that a photograph fills when it is straightened.

    The map is continuous and one-to-one, so the photograph's border holds the extremes.

    Parameters
    ----------
    data_window : Of the photograph.
    channels : Those that have maps of their own.

    Raises
    ------
    ImageError : It would be wider than `MOST_GROWTH` frames, or the lens knows no
        straight picture of it.
    """
    border = _border(data_window)
    mapped = np.concatenate(
        [in_batches(geometry.undistorted(lens, c), border) for c in channels]
    )
    mapped = mapped[np.isfinite(mapped).all(-1)]
    low = mapped.min(0, initial=math.inf)
    size = np.array(geometry.size_px)
    if not mapped.size or (np.ptp(mapped, axis=0) > MOST_GROWTH * size).any():
        raise ImageError(
            f"is over {MOST_GROWTH:g} times as wide as its frame when straightened",
            remedy="state how much of it is wanted with --overscan",
        )
    high = mapped.max(0)
    found = Window(
        math.floor(low[0]),
        math.floor(low[1]),
        math.ceil(high[0]) - 1,
        math.ceil(high[1]) - 1,
    )
    known = known_window(data_window, geometry.display_window)
    left, top, right, bottom = (
        SPARE_PX if own == its else _EMPTY_PX
        for own, its in zip(data_window, known, strict=True)
    )
    return Window(
        found.x_min - left,
        found.y_min - top,
        found.x_max + right,
        found.y_max + bottom,
    )


def _border(window: Window) -> np.ndarray:
    t = np.linspace(0.0, 1.0, _BORDER_POINTS)
    low = np.array(window[:2], float)
    size = np.array([window.width, window.height])
    sides = [np.stack([t, t * 0 + end], -1) for end in (0.0, 1.0)]
    return low + size * np.concatenate([*sides, *(side[:, ::-1] for side in sides)])


def prepare_straightening(
    lens: Lens,
    geometry: PlateGeometry,
    data_window: Window,
    *,
    tolerance: float,
    lateral_colour: bool,
    falloff: bool,
    window: Window | None = None,
) -> Straightening:
    """Maps and gains of a lens for photographs with this data window.

    Parameters
    ----------
    tolerance : Accepted error of the picture, display-referred.
    lateral_colour, falloff : Whether they are taken off too.
    window : Pixels of the straight picture; all that the photograph fills if None.

    Raises
    ------
    ImageError : As `straight_window`.
    """
    budget = Budget.of(tolerance)
    seen = 0.0
    if lateral_colour:
        seen = max(lateral_colour_px(lens, geometry, data_window))
    one: tuple[Channel, ...] = ("g",)
    own = CHANNELS if seen > budget.unseen_lateral_colour_px else one
    window = window or straight_window(lens, geometry, data_window, own)
    made = [
        source_map(geometry.distorted(lens, c), window, budget.map_error_px)
        for c in own
    ]
    red, green, blue = made if len(made) > 1 else made * 3
    gains: tuple[Float32[np.ndarray, "height width"] | None, ...] = (None,) * 3
    if falloff:
        gains = tuple(
            illumination_gain(
                lens, geometry, data_window, c, tolerance=budget.gain_error
            )
            for c in CHANNELS
        )
    maps = (red, green, blue)
    found = {id(one): _beyond(one, data_window) for one in made}
    ring = EmptyRing.about(data_window, geometry.display_window)
    beyond = tuple(found[id(one)] for one in maps)
    return Straightening(window, ring, maps, gains, beyond)


def straight_pixels(
    pixels: Float32[np.ndarray, "height width channels"],
    straightening: Straightening,
    method: Filter,
) -> Float32[np.ndarray, "out_height out_width channels"]:
    """A photograph, straightened; black where it shows nothing.

    Parameters
    ----------
    pixels : Grey, or red, green, blue (and alpha) over the data window.
    method : Filter of the warp.
    """
    count = pixels.shape[-1]
    red, green, blue = straightening.maps
    maps = [green] if count == 1 else [red, green, blue, green][:count]
    own = straightening.beyond
    beyond = [own[1]] if count == 1 else [*own, own[1]][:count]
    gains = [_inverse(gain) for gain in straightening.gains]
    gains = [gains[1]] if count == 1 else [*gains, None][:count]
    ring = straightening.ring
    made = warp(
        ring.empty(apply_gain(pixels, gains)),
        ring.outer,
        maps[0] if all(one is maps[0] for one in maps) else maps,
        border="clamp",
        method=method,
        alpha_channel=_ALPHA if count > _ALPHA else None,
    )
    flat = made.reshape(-1, count)
    for channel, black in enumerate(beyond):
        flat[black, channel] = 0
    return made


def _inverse(gain: np.ndarray | None) -> np.ndarray | None:
    """No light stays no light."""
    if gain is None:
        return None
    lit = np.nan_to_num(gain, nan=0.0) > 0
    return np.divide(1, gain, out=np.zeros_like(gain), where=lit)


def _beyond(one: SourceMap, data_window: Window) -> Int[np.ndarray, " pixels"]:
    """Where the map reads farther beyond the photograph than filters do."""
    window, moved = one.window, one.displacement_px
    x = np.arange(window.x_min, window.x_max + 1, dtype=np.float32) + 0.5
    y = np.arange(window.y_min, window.y_max + 1, dtype=np.float32) + 0.5
    read_x, read_y = moved[0] + x, moved[1] + y[:, None]
    inside = (read_x > data_window.x_min - SPARE_PX) & (
        read_x < data_window.x_max + 1 + SPARE_PX
    )
    inside &= (read_y > data_window.y_min - SPARE_PX) & (
        read_y < data_window.y_max + 1 + SPARE_PX
    )
    return np.flatnonzero(~inside)


def pinhole_camera(lens: Lens, geometry: PlateGeometry, data_window: Window) -> Pinhole:
    """The camera of a straight picture: the pinhole that the lens is a departure from.

    Parameters
    ----------
    data_window : Of the straight picture.
    """
    display = geometry.display_window
    pitch = np.array(geometry.pitch_mm)
    focal_mm = float(lens.distortion.principal_distance_mm)
    point_mm = np.asarray(lens.distortion.principal_point_mm, float)
    centre = geometry.px(point_mm[None])[0]
    low = np.array(data_window[:2], float)
    size = np.array([data_window.width, data_window.height])
    return Pinhole(
        _pair(focal_mm / pitch),
        _pair(centre - np.array(display[:2])),
        focal_mm,
        _pair(np.array(geometry.area_mm)),
        _pair(size * pitch),
        _pair((low + size / 2 - centre) * pitch),
        geometry.pixel_shape,
        display,
        data_window,
    )


def _pair(values: np.ndarray) -> tuple[float, float]:
    return float(values[0]), float(values[1])


class PlateStraightener:
    """Straightens plates; keeps what it prepared while camera and windows stay."""

    def __init__(self, lens: PlateLens):
        self.lens = lens
        self._key: object = None
        self._kept: Straightening | None = None

    def render(
        self,
        image: ExrImage,
        path: Path,
        header: ExrImage | None = None,
        picked_in: ExrImage | None = None,
    ) -> ExrImage:
        """The straight picture of a plate of one view.

        Parameters
        ----------
        header : States its camera, if `image` itself does not.
        picked_in : The view with the pixel that is in focus, if not this one.

        Raises
        ------
        ImageError : No part holds colour, or it cannot be straightened.
        """
        state = self.lens.noted_state(header or image, path, picked_in)
        found = layers_to_render(image, self.lens.options.layers)
        return ExrImage(
            tuple(
                self._straightened_part(part, found[id(part)], state, path.name)
                if id(part) in found
                else self.lens.restated(part, state)
                for part in image.parts
            )
        )

    def _straightened_part(
        self, part: ExrPart, layers: list[ColourLayer], state: PlateState, name: str
    ) -> ExrPart:
        done = self._straightening(state, part)
        result = resized_channels(self.lens.restated(part, state), done.window)
        for layer in layers:
            pixels = stacked_channels(part, layer.names)
            self.lens.notes.add(number_note(pixels, name, blurred=False))
            made = straight_pixels(pixels, done, self.lens.options.filter)
            result = with_channels(result, layer.names, made)
        lens, geometry = self.lens.lens_at(state), self._geometry(state, part)
        camera = pinhole_camera(lens, geometry, done.window)
        attributes: dict[str, object] = {PINHOLE: camera.text}
        attributes |= self.lens.standard_attributes(state, part)
        return part_with_signature(
            result, self.lens.signature(state), attributes, UNDISTORTED
        )

    def _geometry(self, state: PlateState, part: ExrPart) -> PlateGeometry:
        return self.lens.geometry(state, part.display_window)

    def _straightening(self, state: PlateState, part: ExrPart) -> Straightening:
        options = self.lens.options
        spanned = (state.sensor_width_mm, state.pixel_shape)
        windows = (part.display_window, part.data_window)
        key = (state.lens_key, state.knobs, spanned, windows)
        if self._kept is None or key != self._key:
            self._kept = None  # two sets need not be held in memory at once
            percent = options.straight_overscan_percent
            window = None
            if percent is not None:
                window = window_of_percent(part.display_window, percent)
            self._kept = prepare_straightening(
                self.lens.lens_at(state),
                self._geometry(state, part),
                part.data_window,
                tolerance=options.tolerance,
                lateral_colour=options.switches.lateral_colour,
                falloff=options.switches.falloff,
                window=window,
            )
            self._key = key
        return self._kept
