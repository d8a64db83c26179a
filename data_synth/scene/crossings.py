"""What rays meet in a scene, nearest first, each surface covering what lies behind."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from data_synth.scene.layers import Layer, Scene, SceneRays

LEAST_THROUGH = 1e-12


@dataclass(frozen=True, eq=False)
class Crossing:
    """Rays that end, in part or wholly, at one layer.

    Attributes
    ----------
    number : Of the layer in the scene.
    rays : Numbers of the rays.
    share : How much of each ray ends here: coverage times what nearer layers let
        through.
    place_mm : Where, in the layer's plane.
    depth_mm : Where, along the axis.
    """

    number: int
    rays: Int[np.ndarray, " some"]
    share: Float[np.ndarray, " some"]
    place_mm: Float[np.ndarray, "some 2"]
    depth_mm: Float[np.ndarray, " some"]


def crossings(layers: tuple[Layer, ...], rays: SceneRays) -> Iterator[Crossing]:
    """Every layer that each ray meets, while anything of the ray is left.

    Layers square to the axis stand in one order for all rays. Tilted ones may pass
    through them, and are met in the gap between two of them where each ray meets them.
    """
    numbers = range(len(layers))
    square = [n for n in numbers if layers[n].plane.is_square]
    square.sort(key=lambda n: layers[n].plane.origin_mm[2])
    tilted = [n for n in numbers if not layers[n].plane.is_square]
    met_tilted = _Tilted(layers, tilted, square, rays)
    through = np.ones(len(rays))
    alive = np.arange(len(rays))
    for gap in range(len(square) + 1):
        for number, some, depth in met_tilted.in_gap(gap, alive):
            yield from _met(layers[number], number, rays, some, depth, through)
        if gap < len(square):
            number = square[gap]
            depth = np.full(len(alive), layers[number].plane.origin_mm[2])
            yield from _met(layers[number], number, rays, alive, depth, through)
        alive = alive[through[alive] > LEAST_THROUGH]


def _met(layer: Layer, number: int, rays, some, depth_mm, through):
    """What a layer covers of some rays; `through` becomes what is left of them."""
    place = layer.plane.place_mm(rays.some(some), depth_mm)
    covered = layer.coverage(place)
    met = np.flatnonzero(covered)
    if len(met):
        some = some[met]
        share = through[some] * covered[met]
        through[some] -= share
        yield Crossing(number, some, share, place[met], depth_mm[met])


class _Tilted:
    """Where rays meet tilted layers, nearest first, and between which square ones."""

    def __init__(self, layers, tilted: list[int], square: list[int], rays: SceneRays):
        self._tilted = tilted
        if tilted:
            depth = np.stack([layers[n].plane.depth_mm(rays) for n in tilted], 1)
            self._order = np.argsort(depth, axis=1, kind="stable")
            self._depth = np.take_along_axis(depth, self._order, 1)
            bounds = np.array([layers[n].plane.origin_mm[2] for n in square])
            gap = np.searchsorted(bounds, self._depth)
            self._gap = np.where(np.isfinite(self._depth), gap, -1)

    def in_gap(self, gap: int, alive):
        """Numbers of layers, rays that meet each in a gap, and the depths, in order."""
        for rank in range(len(self._tilted)):
            here = alive[self._gap[alive, rank] == gap]
            for column, number in enumerate(self._tilted):
                some = here[self._order[here, rank] == column]
                if len(some):
                    yield number, some, self._depth[some, rank]


def radiance_along(
    scene: Scene, rays: SceneRays, channel: int
) -> Float[np.ndarray, " rays"]:
    """Radiance of one channel that comes along each ray; lamps count as dark."""
    light = np.zeros(len(rays))
    for met in crossings(scene.layers, rays):
        radiance = scene.layers[met.number].radiance(met.place_mm, lamps_lit=False)
        light[met.rays] += met.share * radiance[:, channel]
    return light


def share_let_through(
    layers: tuple[Layer, ...], rays: SceneRays, depth_mm: Float[np.ndarray, " rays"]
) -> Float[np.ndarray, " rays"]:
    """How much of the light that starts at a depth of each ray reaches the lens.

    Parameters
    ----------
    layers : Those that may stand before it; the one it starts from is left out.
    """
    through = np.ones(len(rays))
    for layer in layers:
        depth = layer.plane.depth_mm(rays)
        nearer = np.flatnonzero((depth < depth_mm) & (through > 0))
        place = layer.plane.place_mm(rays.some(nearer), depth[nearer])
        through[nearer] *= 1.0 - layer.coverage(place)
    return through
