"""Depth of field: layers cut into levels of depth, each blurred and laid over the rest.

From the farthest level to the nearest,

    picture = shown_k + picture * (1 - hidden_k),

with both from `lensfit.render.convolve`. Near blur so spreads over a sharp background,
thin near things turn translucent, and a near sharp edge hides far blur completely.
Lights far brighter than white are spread by themselves (`lensfit.render.highlights`)
and dimmed by the levels in front of them.

A level that blurs less than could be seen is laid over as it is; a picture that holds
no other comes back bit for bit.
"""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float32, Int16

from lensfit.coords import Window
from lensfit.render.blur_setup import BlurSetup
from lensfit.render.blur_tiles import CELL, BlurTiles
from lensfit.render.buffers import aligned_empty, crop
from lensfit.render.convolve import blurred_tiles, sharp_tiles
from lensfit.render.edges import two_layers
from lensfit.render.flat_plate import FlatPlate
from lensfit.render.highlights import Highlights
from lensfit.render.layer_stack import LayerStack, flattened
from lensfit.render.lights import SpreadLights
from lensfit.render.plate_defocus import Defocus

NEVER = np.iinfo(np.int16).max
"""Level of a pixel that a layer lacks."""
_BATCH = 8
_OPAQUE = 1e-4


@dataclass(eq=False)
class Scene:
    """What is blurred: layers with their levels, and lights by themselves.

    Attributes
    ----------
    rgba, index : Front to back; a pixel's level, `NEVER` where the layer is empty.
    highlights : Lights taken off, or None.
    is_opaque : Whether one can nowhere see through everything.
    """

    rgba: list[Float32[np.ndarray, "height width 4"]]
    index: Int16[np.ndarray, "layers height width"]
    highlights: Highlights | None = None
    is_opaque: bool = False


def stays_sharp(
    radius_px: Float32[np.ndarray, "height width"], window: Window, defocus: Defocus
) -> bool:
    """Whether no blur of these radii would be seen."""
    defocus = defocus.over(radius_px)
    index = defocus.levels.index(radius_px)
    return defocus.setup(window, levels_in(index, radius_px, defocus)).is_sharp


def blurred_plate(
    plate: FlatPlate,
    window: Window,
    output_window: Window,
    defocus: Defocus,
    in_front: LayerStack | None = None,
) -> Float32[np.ndarray, "out_height out_width 4"]:
    """A flat plate as the lens shows it, bit for bit where that is how it was.

    Parameters
    ----------
    plate : Over `window`; loses what it holds, since two copies are too many.
    output_window : Pixels to return; inside `window`.
    in_front : Layers over `window` that were cut out of the plate, each with its own
        distances; the plate is what they hide.
    """
    if plate.is_sharp:
        return crop(plate.rgba, window, output_window)
    defocus = defocus.over(defocus.circle.radius_px(plate.depth_mm))
    rgba = np.nan_to_num(plate.rgba, nan=0.0, posinf=0.0, neginf=0.0)
    is_opaque = bool((rgba[..., 3] >= 1 - _OPAQUE).all())
    found = two_layers(rgba, plate.radius_px, plate.mattes, plate.guide)
    each_px = np.stack([found.front_px, found.back_px])
    index = defocus.levels.index(each_px)
    index[1][~found.has_back] = NEVER
    layers = [found.front, found.back]
    if in_front is not None:
        own_px = defocus.circle.radius_px(in_front.depth_mm)
        own = defocus.levels.index(own_px)
        own[in_front.rgba[..., 3] <= 0] = NEVER
        layers = [*np.nan_to_num(in_front.rgba, posinf=0, neginf=0), *layers]
        index, each_px = np.concatenate([own, index]), np.concatenate([own_px, each_px])
    setup = defocus.setup(window, levels_in(index, each_px, defocus))
    scene = Scene(layers, index, plate.lights, is_opaque)
    del rgba, found, each_px, layers
    return _blurred_scene(scene, setup, window, output_window, defocus)


def blurred_layers(
    layers: LayerStack, window: Window, output_window: Window, defocus: Defocus
) -> Float32[np.ndarray, "out_height out_width 4"]:
    """A deep plate, which knows what is hidden; parameters as `blurred_plate`."""
    radius_px = defocus.circle.radius_px(layers.depth_mm)
    defocus = defocus.over(radius_px)
    index = defocus.levels.index(radius_px)
    index[layers.rgba[..., 3] <= 0] = NEVER
    setup = defocus.setup(window, levels_in(index, radius_px, defocus))
    if setup.is_sharp:
        return crop(flattened(layers), window, output_window)
    rgba = np.nan_to_num(layers.rgba, nan=0.0, posinf=0.0, neginf=0.0)
    return _blurred_scene(
        Scene(list(rgba), index), setup, window, output_window, defocus
    )


def _blurred_scene(
    scene: Scene,
    setup: BlurSetup,
    window: Window,
    output_window: Window,
    defocus: Defocus,
) -> Float32[np.ndarray, "out_height out_width 4"]:
    tiles = BlurTiles.over(window, output_window, setup)
    size = output_window.height, output_window.width
    colour, through = np.zeros((*size, 3), np.float32), np.ones(size, np.float32)
    lights = SpreadLights.of(
        scene.highlights, window, output_window, defocus.bank, setup
    )
    where = _presence(scene, setup.levels)
    arrays = _padded(scene, tiles)
    with ThreadPoolExecutor() as threads:
        for level in setup.levels:
            active = tiles.reached(where[level], setup.reach_px(level))
            jobs = [active[i : i + _BATCH] for i in range(0, len(active), _BATCH)]
            work = [
                threads.submit(_blurred, arrays, tiles, setup, level, job)
                for job in jobs
            ]
            for job, made in zip(jobs, work, strict=True):
                shown, hidden = made.result()
                for n, tile in enumerate(job):
                    at = tiles.inside(tile)
                    left = _lay_over(colour[at], through[at], shown[n], hidden[n])
                    lights.dim(at, left)
            lights.add(level)
    if scene.is_opaque:
        # What nobody knows, far behind near things, looks like the rest of its pixel.
        colour /= np.maximum(1 - through, _OPAQUE)[..., None]
        through[:] = 0
    result = np.empty((*size, 4), np.float32)
    np.add(colour, lights.plane, out=result[..., :3])
    np.subtract(1, through, out=result[..., 3])
    return result


def levels_in(
    index: Int16[np.ndarray, "*shape"],
    radius_px: Float32[np.ndarray, "*shape"],
    defocus: Defocus,
) -> dict[int, float]:
    """The levels that occur, far to near, and where in each its pixels really lie.

    A wall that fills half of a picture so gets the kernel of its own distance.
    """
    present = index != NEVER
    some = index if present.all() else index[present]
    radii = radius_px if some is index else radius_px[present]
    if not some.size:
        return {0: 0.0}
    low = int(some.min())
    from_low = (some - np.int16(low)).ravel()
    counts = np.bincount(from_low)
    sums = np.bincount(from_low, radii.ravel())
    return {
        low + int(n): defocus.levels.between(sums[n] / counts[n])
        for n in np.flatnonzero(counts)
    }


def _presence(scene: Scene, levels: list[int]) -> dict[int, np.ndarray]:
    """For each level, which cells of the window hold any of it."""
    low, count = levels[0], levels[-1] - levels[0] + 1
    height, width = scene.index.shape[1:]
    rows, columns = -(-height // CELL), -(-width // CELL)
    cell = (np.arange(height) // CELL * columns)[:, None] + np.arange(width) // CELL
    held = np.zeros(count * rows * columns, bool)
    for index in scene.index:
        own = index != NEVER
        if own.all():
            held[((index.astype(np.int32) - low) * (rows * columns) + cell)] = True
        else:
            at = (index[own].astype(np.int32) - low) * (rows * columns) + cell[own]
            held[at] = True
    planes = held.reshape(count, rows, columns).astype(np.uint8)
    return {n: planes[n - low] for n in levels}


def _padded(scene: Scene, tiles: BlurTiles) -> tuple[jnp.ndarray, jnp.ndarray]:
    """Layers with a margin that continues their border, on the device; the scene gives
    its own up, since two copies of a large frame are too many."""
    (top, bottom), (left, right) = tiles.padding
    count, height, width = scene.index.shape
    rgba = aligned_empty((count, top + height + bottom, left + width + right, 4))
    for layer in rgba:
        own = scene.rgba.pop(0)
        layer[top : top + height, left : left + width] = own
        layer[top : top + height, :left] = own[:, :1]
        layer[top : top + height, left + width :] = own[:, -1:]
        layer[:top], layer[top + height :] = layer[top], layer[top + height - 1]
    around = ((0, 0), *tiles.padding)
    return jnp.asarray(rgba), jnp.asarray(np.pad(scene.index, around, mode="edge"))


def _blurred(
    arrays: tuple[jnp.ndarray, jnp.ndarray],
    tiles: BlurTiles,
    setup: BlurSetup,
    level: int,
    job: list[int],
) -> tuple[np.ndarray, np.ndarray]:
    """Some tiles of a level; always a whole batch, so that one program serves all."""
    filled = (job + job[-1:] * _BATCH)[:_BATCH]
    size, at = tiles.size, np.int16(level)
    if level not in setup.rooms:
        corners = np.array([tiles.corner(t, size) for t in filled], np.int32)
        shown, hidden = sharp_tiles(*arrays, corners, at, tile=size)
    else:
        room = setup.rooms[level]
        corners = np.array([tiles.corner(t, room) for t in filled], np.int32)
        nodes, cells = setup.around(corners - tiles.margin, room)
        shown, hidden = blurred_tiles(
            *arrays,
            corners,
            at,
            setup.transforms[level],
            nodes,
            cells,
            tile=size,
            room=room,
        )
    return np.asarray(shown), np.asarray(hidden)


def _lay_over(
    colour: np.ndarray, through: np.ndarray, shown: np.ndarray, hidden: np.ndarray
) -> np.ndarray:
    """A tile of a level over what lies behind it; what the level lets through."""
    height, width = through.shape
    left = 1 - hidden[:height, :width]
    colour *= left
    colour += shown[:height, :width]
    through *= left[..., left.shape[-1] // 2]
    return left
