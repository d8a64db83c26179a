"""Depth of field: surfaces seen through every point of the pupil, and small lights.

    surfaces    the visible surfaces and the inpainted background (`surfaces`)
    gather      each pixel is the mean of its rays through them (`gather`)
    lights      removed beforehand, added as meshes, occluded by what stands before
                them (`light_mesh`)

The picture is made in large tiles, each with a margin as wide as the largest ray
displacement, so that memory does not grow with the picture. A picture in which no ray
is visibly displaced comes back bit for bit.
"""

from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial

import cv2
import numpy as np
from jaxtyping import Float32

from lensfit.coords import Window
from lensfit.cores import available_cores
from lensfit.rendering.buffers import crop
from lensfit.rendering.gather import TILE, PackedSurfaces, gather
from lensfit.rendering.highlights import Highlights, Spot, spots
from lensfit.rendering.layer_stack import LayerStack, flattened_layers
from lensfit.rendering.light_mesh import light_kernel
from lensfit.rendering.packed_surfaces import packed_surfaces
from lensfit.rendering.plate_defocus import Defocus, Rays
from lensfit.rendering.plate_surfaces import FlatPlate, shared_pixels
from lensfit.rendering.ray_field import RayField, window_steps_px
from lensfit.rendering.surfaces import (
    Slabs,
    Surface,
    surfaces_of_layers,
    surfaces_of_plate,
)

_OPAQUE = 1e-4
_SIDE, _LEAST_SIDE = 1024, 256
"""Of tiles: at most, and at least where there are cores to share them."""
_STRIP_TILES = 6
"""Of the loop over rays, in the height of a strip that one core fills."""
_MARGINS = 2
"""Tiles are at least so many margins wide."""


@dataclass(eq=False)
class Scene:
    """What is blurred, over one window.

    Attributes
    ----------
    layers : Premultiplied, front to back, with the signed radius of blur of each pixel.
    plate : A flat plate behind them, which hides what is behind it; or None.
    lights : Taken off the layers and the plate.
    is_opaque : Whether one can nowhere see through everything.
    """

    layers: list[tuple[np.ndarray, np.ndarray]]
    plate: FlatPlate | None
    lights: list[Highlights]
    is_opaque: bool

    def radii_px(self) -> list[np.ndarray]:
        """Of all that the layers and the plate show."""
        found = [r[rgba[..., 3] > 0] for rgba, r in self.layers]
        found += [self.plate.radius_px] if self.plate is not None else []
        return [r for r in found if r.size]

    def range_px(self) -> tuple[float, float]:
        """Least and greatest radius of what there is, lights included."""
        lights = [light.radius_px[light.mask > 0] for light in self.lights]
        found = self.radii_px() + [r for r in lights if r.size]
        if not found:
            return 0.0, 0.0
        return min(float(r.min()) for r in found), max(float(r.max()) for r in found)


def stays_sharp(
    radius_px: Float32[np.ndarray, "height width"], window: Window, defocus: Defocus
) -> bool:
    """Whether no blur of these radii would be seen."""
    ends = float(radius_px.min()), float(radius_px.max())
    if max(abs(r) for r in ends) > defocus.budget.unseen_px:
        return False
    return defocus.rays(window, *ends).is_sharp(radius_px)


def blurred_plate(
    plate: FlatPlate,
    window: Window,
    output_window: Window,
    defocus: Defocus,
    in_front: LayerStack | None = None,
    lights_in_front: Sequence[Highlights | None] = (),
) -> Float32[np.ndarray, "out_height out_width 4"]:
    """A flat plate as the lens shows it, bit for bit where that is how it was.

    Parameters
    ----------
    plate : Over `window`.
    output_window : Pixels to return; inside `window`.
    in_front : Layers over `window` that were cut out of the plate, each with its own
        distances; the plate is what they hide.
    lights_in_front : Of each of those layers.
    """
    if plate.is_sharp:
        return crop(plate.rgba, window, output_window)
    plate.rgba = np.nan_to_num(plate.rgba, nan=0.0, posinf=0.0, neginf=0.0)
    is_opaque = bool((plate.rgba[..., 3] >= 1 - _OPAQUE).all())
    layers = [] if in_front is None else _layers(in_front, defocus)
    lights = [light for light in (plate.lights, *lights_in_front) if light is not None]
    scene = Scene(layers, plate, lights, is_opaque)
    return _blurred_scene(scene, window, output_window, defocus)


def blurred_layers(
    layers: LayerStack,
    window: Window,
    output_window: Window,
    defocus: Defocus,
    lights: Sequence[Highlights | None],
) -> Float32[np.ndarray, "out_height out_width 4"]:
    """A deep plate, which knows what is hidden.

    Parameters
    ----------
    layers : Over `window`, without their lights.
    lights : Of each of them; None where there are none.
    """
    found = [light for light in lights if light is not None]
    scene = Scene(_layers(layers, defocus), None, found, is_opaque=False)
    if not found and stays_sharp(np.array(scene.range_px()), window, defocus):
        return crop(flattened_layers(layers), window, output_window)
    return _blurred_scene(scene, window, output_window, defocus)


def _layers(stack: LayerStack, defocus: Defocus) -> list[tuple[np.ndarray, np.ndarray]]:
    rgba = np.nan_to_num(stack.rgba, nan=0.0, posinf=0.0, neginf=0.0)
    return list(zip(rgba, defocus.circle.radius_px(stack.depth_mm), strict=True))


def _blurred_scene(
    scene: Scene, window: Window, output_window: Window, defocus: Defocus
) -> Float32[np.ndarray, "out_height out_width 4"]:
    frame = _Frame(scene, window, output_window, defocus)
    step_px = defocus.budget.light_step_px
    every = [spot for found in scene.lights for spot in spots(found, step_px)]
    tiles = list(tiles_of(output_window, frame.reach_px))
    lights = _lights_of_tiles(every, tiles, window)
    picture = frame.picture
    lit = np.zeros((*picture.shape[:2], 3), np.float32) if every else None
    down = window.y_min - output_window.y_min
    across = window.x_min - output_window.x_min
    # Tiles wait for their parts, and the parts of all share the cores.
    cores = available_cores()
    with ThreadPoolExecutor(cores) as workers, ThreadPoolExecutor(cores) as in_work:
        made = in_work.map(partial(frame.fill, workers=workers), tiles, lights)
        for found in made:
            for light, row, column, colour in found:
                assert lit is not None
                _add(lit[..., colour], light, row + down, column + across)
    if lit is not None:
        picture[..., :3] += lit
    return picture


class _Frame:
    """What the tiles of a picture share, and the picture.

    Attributes
    ----------
    rays, slabs, cuts : Of the whole range of depth, so that tiles agree. Rays are
        those that reach the picture: what a lens does far beyond it, where it was not
        photographed, changes nothing in it.
    light_rays : Those of lights, which lie beside the picture too.
    reach_px : How far rays are led; a tile needs twice as much around it.
    pinhole : The scene where nothing is blurred, over `window`.
    picture : Over `output_window`, filled tile by tile.
    """

    def __init__(
        self, scene: Scene, window: Window, output_window: Window, defocus: Defocus
    ):
        least, most = scene.range_px()
        self.scene, self.window, self.output_window = scene, window, output_window
        self.rays = defocus.rays(output_window, least, most)
        self.light_rays = defocus.rays(window, least, most)
        self.slabs = defocus.slabs(least, most)
        self.cuts = self.slabs.cuts_px(scene.radii_px())
        self.reach_px = self.rays.reach_px(least, most)
        self.is_continuous = defocus.depth_levels is None
        self.cubic_px = defocus.budget.cubic_px
        self.pinhole = _pinhole(scene)
        size = output_window.height, output_window.width
        self.picture = np.zeros((*size, 4), np.float32)

    def fill(
        self, tile: Window, lights: list[Spot], workers: ThreadPoolExecutor
    ) -> list[tuple[np.ndarray, int, int, int]]:
        """Make a tile of the picture; what its lights add, as of `_laid_down`."""
        window, rays = self.window, self.rays
        region = tile_with_margin(tile, 2 * self.reach_px, window)
        given = self.scene, region, window, self.cuts, self.slabs, self.is_continuous
        surfaces = workers.submit(_surfaces, *given).result()
        given = lights, surfaces, self.light_rays, rays.many, region, window
        laid_down = workers.submit(_laid_down, *given)
        strips = []
        if surfaces:
            packing = workers.submit(
                packed_surfaces, surfaces, rays.many, self.cubic_px
            )
            target = crop(self.picture, self.output_window, tile)
            sharp = crop(self.pinhole, window, tile)
            strip = partial(
                _gather_rows,
                *(target, tile, region, packing.result(), rays, sharp),
                self.scene.is_opaque,
            )
            strips = [workers.submit(strip, rows) for rows in _strips_of(tile.height)]
        for made in strips:
            made.result()
        return laid_down.result()


def _pinhole(scene: Scene) -> np.ndarray:
    """The scene as it is where nothing is blurred."""
    if scene.plate is not None and not scene.layers:
        return scene.plate.rgba
    every = [rgba for rgba, _ in scene.layers]
    every += [scene.plate.rgba] if scene.plate is not None else []
    return flattened_layers(
        LayerStack(
            np.stack(every), np.ones((len(every), *every[0].shape[:2]), np.float32)
        )
    )


def _surfaces(
    scene: Scene,
    region: Window,
    window: Window,
    cuts: list[float],
    slabs: Slabs,
    is_continuous: bool,
) -> list[Surface]:
    """Surfaces over a region, near to far.

    Parameters
    ----------
    is_continuous : Whether depth varies within a surface; else each blurs alike.
    """
    layers = [
        (crop(rgba, window, region), crop(r, window, region))
        for rgba, r in scene.layers
    ]
    found = surfaces_of_layers(layers, cuts, slabs) if layers else []
    if scene.plate is not None:
        plate = scene.plate
        shared = None
        if plate.mattes is not None and len(plate.mattes.ids) > 1:
            shared = shared_pixels(plate, window, region)
        guide = None if plate.guide is None else crop(plate.guide, window, region)
        found += surfaces_of_plate(
            crop(plate.rgba, window, region),
            crop(plate.radius_px, window, region),
            cuts,
            slabs,
            guide,
            shared,
        )
        if layers:
            found.sort(key=lambda surface: -surface.middle_px)
    return (
        found if is_continuous else [surface.with_middle_radius() for surface in found]
    )


def _gather_rows(
    target: np.ndarray,
    tile: Window,
    region: Window,
    surfaces: PackedSurfaces,
    rays: Rays,
    sharp: np.ndarray,
    is_opaque: bool,
    rows: tuple[int, int],
) -> None:
    """Fill rows of a tile of the picture."""
    many, few, window = rays.many, rays.few, rays.window
    down_px, across_px = window_steps_px(window, *many.weight.shape[1:3])
    gather(
        target,
        (tile.y_min - region.y_min, tile.x_min - region.x_min),
        rows,
        surfaces,
        (many.moved_px, many.weight),
        (few.moved_px, few.weight),
        (across_px, down_px),
        (float(tile.x_min - window.x_min), float(tile.y_min - window.y_min)),
        (
            np.float32(rays.defocus.budget.unseen_px),
            np.float32(rays.defocus.budget.few_px),
            is_opaque,
        ),
        sharp,
    )


def _laid_down(
    mine: list[Spot],
    surfaces: list[Surface],
    light_rays: Rays,
    field: RayField,
    region: Window,
    window: Window,
) -> list[tuple[np.ndarray, int, int, int]]:
    """Lights of a tile as the lens spreads them: patches, their first pixel in the
    window, and colours."""
    if not mine:
        return []
    before: PackedSurfaces = packed_surfaces(surfaces, field, smooth=False)
    offset = region.y_min - window.y_min, region.x_min - window.x_min
    found = []
    for spot in mine:
        kernel = light_kernel(
            light_rays.lights,
            spot.colour,
            (spot.x, spot.y),
            spot.radius_px,
            before,
            offset,
            is_point=spot.is_point,
        )
        half = kernel.shape[-1] // 2
        turned = np.ascontiguousarray(kernel[::-1, ::-1])  # cv2 correlates
        light = cv2.filter2D(
            np.pad(spot.light, half), -1, turned, borderType=cv2.BORDER_CONSTANT
        )
        found.append((light, spot.row - half, spot.column - half, spot.colour))
    return found


def _strips_of(height: int) -> list[tuple[int, int]]:
    """First rows, and those after the last, of parts that can be filled apart."""
    tall = _STRIP_TILES * TILE
    return [(top, min(top + tall, height)) for top in range(0, height, tall)]


def _add(plane: np.ndarray, light: np.ndarray, row: int, column: int) -> None:
    """Add a patch where it lies in the plane."""
    height, width = plane.shape
    y0, x0 = max(row, 0), max(column, 0)
    y1, x1 = min(row + light.shape[0], height), min(column + light.shape[1], width)
    if y0 < y1 and x0 < x1:
        plane[y0:y1, x0:x1] += light[y0 - row : y1 - row, x0 - column : x1 - column]


def tiles_of(output: Window, reach: int, cores: int | None = None) -> Iterator[Window]:
    """The output cut into parts for the cores, not small beside their margins.

    Parameters
    ----------
    cores : That share the work; those of this process if None.
    """
    least = max(_LEAST_SIDE, _MARGINS * reach)
    cores = cores or available_cores()
    side = min(max(output.width // cores, least), max(_SIDE, least))
    down = min(max(output.height, 1), max(_SIDE, least))
    for top in range(output.y_min, output.y_max + 1, down):
        for left in range(output.x_min, output.x_max + 1, side):
            yield Window(
                left,
                top,
                min(left + side - 1, output.x_max),
                min(top + down - 1, output.y_max),
            )


def tile_with_margin(tile: Window, margin: int, window: Window) -> Window:
    """A tile with a margin, as far as there is any picture."""
    return Window(
        max(tile.x_min - margin, window.x_min),
        max(tile.y_min - margin, window.y_min),
        min(tile.x_max + margin, window.x_max),
        min(tile.y_max + margin, window.y_max),
    )


def _lights_of_tiles(
    every: list[Spot], tiles: list[Window], window: Window
) -> list[list[Spot]]:
    """Each light at the tile nearest to it."""
    found: list[list[Spot]] = [[] for _ in tiles]
    if not every:
        return found
    boxes = np.array(tiles, float)
    at = np.array([(spot.x + window.x_min, spot.y + window.y_min) for spot in every])
    low, high = boxes[:, None, :2] - at, at - boxes[:, None, 2:] - 1
    away = np.maximum(np.maximum(low, high), 0).max(-1)
    for spot, nearest in zip(every, away.argmin(0), strict=True):
        found[nearest].append(spot)
    return found
