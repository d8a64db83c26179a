"""How fast this machine can move, multiply and transform numbers, and how far from that
a stage of lensfit is.

A floor is the bytes or the floating-point operations that a stage cannot do without,
over the rate at which this machine does nothing else, measured in the same run: memory
by a copy in NumPy, multiplication by a matrix product, transforms by JAX. The distance
is a ratio of seconds; 1 would be perfect, and no stage that does anything else besides
reaches it.
"""

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from data_synth.bench.times import best

_RUNS = 5
_COPIED_BYTES = 1 << 27
_MATRIX = 1024
_TILE_PX, _TILES = 128, 64


class Rates(NamedTuple):
    """What the machine does per second.

    Attributes
    ----------
    bytes : Moved to and from memory, both counted.
    flops : Float64, in a matrix product.
    fft_flops : Float32, in transforms of real tiles, 2.5 n log2 n for each of n pixels.
    """

    bytes: float
    flops: float
    fft_flops: float


class Floor(NamedTuple):
    """A stage beside what it cannot do without.

    Attributes
    ----------
    stage : What is measured.
    needs : Bytes or operations.
    unit : Which.
    rate : Of this machine, per second.
    seconds : Measured of the stage.
    """

    stage: str
    needs: float
    unit: str
    rate: float
    seconds: float

    @property
    def distance(self) -> float:
        """Seconds over those of the floor."""
        return self.seconds * self.rate / self.needs

    def as_table(self) -> dict[str, str | float]:
        """For JSON, with the floor itself and the distance from it."""
        floor_s = self.needs / self.rate
        return self._asdict() | {"floor_s": floor_s, "distance": self.distance}


def measured_rates() -> Rates:
    """Best of a few runs each; about a second."""
    source = np.ones(_COPIED_BYTES // 8)
    target = np.empty_like(source)
    matrix = np.random.default_rng(0).random((_MATRIX, _MATRIX))
    tiles = jnp.ones((_TILES, _TILE_PX, _TILE_PX), jnp.float32)
    transform = jax.jit(jnp.fft.rfft2)
    return Rates(
        bytes=2 * _COPIED_BYTES / best_seconds(lambda: np.copyto(target, source)),
        flops=2 * _MATRIX**3 / best_seconds(lambda: matrix @ matrix),
        fft_flops=fft_flops(_TILES, _TILE_PX)
        / best_seconds(lambda: jax.block_until_ready(transform(tiles))),
    )


def fft_flops(tiles: float, side_px: int) -> float:
    """Operations of as many transforms of real square tiles."""
    pixels = side_px * side_px
    return tiles * 2.5 * pixels * math.log2(pixels)


def best_seconds(work: Callable[[], Any]) -> float:
    """The least wall time of several runs, one before them left out."""
    work()
    return best(work, _RUNS)[1]
