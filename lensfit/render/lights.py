"""Highlights as the lens spreads them: over a frame, behind the levels yet to come."""

from dataclasses import dataclass
from itertools import product
from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Bool, Float, Float32

from lensfit.coords import Window
from lensfit.render.blur_setup import BlurSetup
from lensfit.render.highlights import Highlights, Spot, spots
from lensfit.render.kernel_bank import RGB, KernelBank, trimmed
from lensfit.render.uv import Channel

_FINER = 3
_LOST = 1e-6
"""Share of a light that may be cut off: what is left at its rim still glares."""
_CELL = 16


@dataclass(eq=False)
class SpreadLights:
    """Lights wait for their level, and levels in front of them dim them.

    Attributes
    ----------
    plane : What has been spread so far, over the output.
    waiting : By level: a patch of spread light, row and column of its first pixel,
        and which colour.
    lit : Which cells of `plane` hold anything.
    """

    plane: Float32[np.ndarray, "height width 3"]
    waiting: dict[int, list[tuple[np.ndarray, int, int, int]]]
    lit: Bool[np.ndarray, "rows columns"]

    @classmethod
    def of(
        cls,
        found: Highlights | None,
        window: Window,
        output: Window,
        bank: KernelBank,
        setup: BlurSetup,
    ) -> "SpreadLights":
        """Spread all lights of a plate, each by the kernel of its place and depth."""
        waiting: dict[int, list[tuple[np.ndarray, int, int, int]]] = {}
        plane = np.zeros((output.height, output.width, 3), np.float32)
        each = [] if found is None else list(spots(found, setup.light_step_px))
        top, left = output.y_min - window.y_min, output.x_min - window.x_min
        for spot, kernel in zip(each, _kernels(each, bank, setup), strict=True):
            own = round(bank.levels.between(spot.radius_px))
            level = min(setup.levels, key=lambda n, own=own: abs(n - own))
            half = kernel.shape[-1] // 2
            place = spot.row - half - top, spot.column - half - left
            spread = _spread(spot.light, kernel)
            waiting.setdefault(level, []).append((spread, *place, spot.colour))
        cells = np.zeros((output.height // _CELL + 1, output.width // _CELL + 1), bool)
        return cls(plane, waiting, cells)

    def add(self, level: int) -> None:
        """Lights of a level that has just been laid over."""
        for light, row, column, colour in self.waiting.pop(level, []):
            height, width = self.plane.shape[:2]
            y0, x0 = max(row, 0), max(column, 0)
            y1 = min(row + light.shape[0], height)
            x1 = min(column + light.shape[1], width)
            if y0 < y1 and x0 < x1:
                part = light[y0 - row : y1 - row, x0 - column : x1 - column]
                self.plane[y0:y1, x0:x1, colour] += part
                rows, columns = (
                    slice(y0 // _CELL, y1 // _CELL + 1),
                    slice(x0 // _CELL, x1 // _CELL + 1),
                )
                self.lit[rows, columns] = True

    def dim(self, at: tuple[slice, slice], left: np.ndarray) -> None:
        """A level that lets this share through lies in front of the lights so far."""
        rows, columns = (slice(s.start // _CELL, s.stop // _CELL + 1) for s in at)
        if self.lit[rows, columns].any():
            self.plane[at] *= left


def _kernels(
    each: list[Spot], bank: KernelBank, setup: BlurSetup
) -> list[Float32[np.ndarray, "size size"]]:
    """Kernels of lights where they stand; those not made before are made together."""
    keys = [_Key.of(spot, setup) for spot in each]
    new = {k: None for k in keys if k not in bank.of_lights}
    for channel, finer in product(RGB, (1, _FINER)):
        mine = [k for k in new if k.channel == channel and k.finer == finer]
        if not mine:
            continue
        points = np.array([(key.x, key.y) for key in mine])
        levels = np.array([bank.levels.between(key.radius_px) for key in mine])
        made = bank.at(points, levels, (channel,), finer=finer)
        first = made.shape[-1] // 2 % finer
        for key, kernel in zip(
            mine, made[..., first::finer, first::finer], strict=True
        ):
            bank.of_lights[key] = trimmed(kernel[None], _LOST)[0, 0]
    return [bank.of_lights[key] for key in keys]


class _Key(NamedTuple):
    """What decides a light's kernel."""

    x: float
    y: float
    radius_px: float
    finer: int
    channel: Channel

    @classmethod
    def of(cls, spot: Spot, setup: BlurSetup) -> "_Key":
        x, y = setup.place_of_light(np.array([spot.x, spot.y]))
        finer = 1 if spot.is_point else _FINER
        channel = RGB[spot.colour] if setup.chromatic else "g"
        return cls(float(x), float(y), round(spot.radius_px, 4), finer, channel)


def _spread(
    light: Float32[np.ndarray, "height width"],
    kernel: Float32[np.ndarray, "size size"],
) -> Float[np.ndarray, "tall wide"]:
    """A patch of light blurred, larger by the kernel's half on every side."""
    half = kernel.shape[-1] // 2
    turned = np.ascontiguousarray(kernel[::-1, ::-1])  # cv2 correlates
    return cv2.filter2D(np.pad(light, half), -1, turned, borderType=cv2.BORDER_CONSTANT)
