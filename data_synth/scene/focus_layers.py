"""What every depth of a drawn scene takes part in: subject, floor and lamps."""

import numpy as np

from data_synth.scene.layers import Lamps, Layer, Plane, floor_plane, square_plane
from data_synth.scene.paints import Checker, Plain, Star
from data_synth.scene.shapes import Discs, Rectangle, Union, Without
from data_synth.scene.stage import Stage


def subject_layers(stage: Stage) -> list[Layer]:
    """A star, a board of bars and a ring where the lens is focused."""
    unit = stage.height_mm(stage.focus_mm)
    centre = (
        float(stage.rng.uniform(-0.25, 0.35)),
        float(stage.rng.uniform(-0.1, 0.1)),
    )
    star = Discs(np.array([centre]) * unit, np.array([0.19 * unit]))
    sectors = int(stage.rng.integers(18, 40))
    plane = square_plane(stage.focus_mm)
    left = -stage.half_width * 0.55
    board = Rectangle((left * unit, -0.3 * unit), ((left + 0.26) * unit, 0.22 * unit))
    bars = Checker((0.85, 0.83, 0.8), (0.06, 0.06, 0.07), (np.inf, 0.02 * unit))
    middle = np.array([[stage.half_width * 0.55, stage.rng.uniform(-0.2, 0.2)]]) * unit
    ring = Without(
        Discs(middle, np.array([0.13 * unit])), Discs(middle, np.array([0.1 * unit]))
    )
    star_paint = Star((centre[0] * unit, centre[1] * unit), sectors)
    return [
        Layer("star", plane, star, star_paint),
        stage.lit_layer("board", _moved(plane, 1.004), board, bars),
        stage.lit_layer("ring", _moved(plane, 0.994), ring, Plain(stage.colour(0.4))),
    ]


def _moved(plane: Plane, factor: float) -> Plane:
    return square_plane(float(plane.origin_mm[2]) * factor)


def floor_layers(stage: Stage) -> list[Layer]:
    """A checkered floor from below the frame to the background."""
    farthest = stage.farther(0.8)
    part = stage.rng.uniform(0.28, 0.38)
    height = part * stage.height_mm(stage.focus_mm)
    # It reaches below the plate's lower edge, half a frame height and the overscan.
    nearest = 0.9 * part / 0.6 * stage.focus_mm
    plane = floor_plane(height, stage.focus_mm)
    half = 2 * stage.half_width * stage.height_mm(farthest)
    shape = Rectangle(
        (-half, stage.focus_mm - farthest), (half, stage.focus_mm - nearest)
    )
    side_mm = 0.13 * stage.height_mm(stage.focus_mm)
    tiles = Checker(
        stage.colour(0.45), stage.colour(0.04, 0.2), (side_mm, side_mm * 1.5)
    )
    return [stage.lit_layer("floor", plane, shape, tiles)]


def lamps_layers(stage: Stage) -> list[Layer]:
    """Small lamps: many far ones, some between, a few before the focus."""
    rng = stage.rng
    rows = (
        ("far lamps", stage.farther(rng.uniform(0.6, 0.83)), int(rng.integers(25, 45))),
        ("lamps", stage.farther(rng.uniform(0.1, 0.5)), int(rng.integers(8, 18))),
        ("near lamps", stage.nearer(rng.uniform(0.1, 0.6)), 5),
    )
    return [_lamps_at(stage, *row) for row in rows]


def _lamps_at(stage: Stage, name: str, depth_mm: float, count: int) -> Layer:
    """Lamps of a third of a row to more than one in radius, on nothing."""
    rng = stage.rng
    tint = rng.uniform(0.5, 1.0, (count, 3))
    lamps = Lamps(
        stage.places(count) * stage.height_mm(depth_mm),
        rng.uniform(0.35, 1.3, count) * stage.row_mm(depth_mm),
        tint * 10 ** rng.uniform(1.5, 2.9, (count, 1)),
    )
    black = Plain((0.0, 0.0, 0.0))
    return Layer(name, square_plane(depth_mm), Union(), black, lamps=lamps)
