"""What stands behind the focus in a drawn scene."""

import numpy as np

from data_synth.scene.layers import Layer, square_plane, wall_plane
from data_synth.scene.near_layers import wires_across
from data_synth.scene.paints import Checker, Paint, Plain, Windows
from data_synth.scene.shapes import Everywhere, Rectangle, Strips
from data_synth.scene.stage import Stage

NIGHT = ((0.9, 0.75, 0.45), (0.3, 0.3, 0.6), (0.25, 0.22, 0.25), (0.6, 0.5, 0.45))


def back_wires_layers(stage: Stage) -> list[Layer]:
    """Thin bright wires behind the focus."""
    depth = stage.farther(stage.rng.uniform(0.1, 0.4))
    wires = wires_across(stage, depth, int(stage.rng.integers(2, 5)), (0.8, 3.0))
    bright = Plain((0.7, 0.65, 0.6))
    return [stage.lit_layer("far wires", square_plane(depth), wires, bright)]


def columns_layers(stage: Stage) -> list[Layer]:
    """Striped columns behind the focus."""
    depth = stage.farther(stage.rng.uniform(0.2, 0.5))
    unit = stage.height_mm(depth)
    count = int(stage.rng.integers(3, 6))
    x = np.linspace(-1, 1, count) * stage.half_width + stage.rng.uniform(
        -0.1, 0.1, count
    )
    start, end = (np.column_stack([x, np.full(count, s)]) for s in (-1.0, 1.0))
    width = np.full(count, stage.rng.uniform(0.05, 0.12))
    columns = Strips(start * unit, end * unit, width * unit)
    stripes = Checker(stage.colour(0.3), stage.colour(0.1, 0.4), (np.inf, 0.06 * unit))
    return [stage.lit_layer("columns", square_plane(depth), columns, stripes)]


def lattice_layers(stage: Stage) -> list[Layer]:
    """Crossed slats behind the focus."""
    depth = stage.farther(stage.rng.uniform(0.15, 0.45))
    unit = stage.height_mm(depth)
    left = stage.rng.uniform(-0.9, 0.4) * stage.half_width
    steps = np.arange(9) * 0.07
    zero = np.zeros(9)
    start = np.concatenate(
        [np.column_stack([steps, zero]), np.column_stack([zero, steps])]
    )
    end = np.concatenate(
        [np.column_stack([steps, zero + 0.56]), np.column_stack([zero + 0.56, steps])]
    )
    corner = np.array([left, -0.35])
    slats = Strips(
        (start + corner) * unit, (end + corner) * unit, np.full(18, 0.014 * unit)
    )
    return [
        stage.lit_layer("lattice", square_plane(depth), slats, Plain(stage.colour(0.4)))
    ]


def wall_layers(stage: Stage) -> list[Layer]:
    """An upright wall that recedes, along one side of the frame."""
    nearest, farthest = stage.farther(0.08), stage.farther(0.6)
    side = stage.rng.choice([-1.0, 1.0])
    near_x = side * stage.half_width * 1.15 * stage.height_mm(nearest)
    far_x = side * stage.half_width * 0.45 * stage.height_mm(farthest)
    turn = float(np.arctan2(farthest - nearest, far_x - near_x))
    plane = wall_plane((near_x, 0.0, nearest), turn)
    length = float(np.hypot(far_x - near_x, farthest - nearest))
    top = -0.38 * stage.height_mm(nearest)
    shape = Rectangle((0.0, top), (length, 2 * abs(top)))
    side_mm = 0.11 * stage.height_mm(nearest)
    bricks = Checker(
        stage.colour(0.35), stage.colour(0.1, 0.4), (1.6 * side_mm, side_mm)
    )
    return [stage.lit_layer("wall", plane, shape, bricks)]


def background_layers(stage: Stage) -> list[Layer]:
    """A facade of windows or a chequered cloth, and the sky."""
    depth = stage.farther(0.85)
    unit = stage.height_mm(depth)
    if stage.rng.uniform() < 0.5:
        paint: Paint = Windows(
            (0.075 * unit, 0.06 * unit), 0.62, (0.05, 0.055, 0.065), np.array(NIGHT)
        )
    else:
        paint = Checker(
            stage.colour(0.4), stage.colour(0.03, 0.2), (0.08 * unit, 0.08 * unit)
        )
    top = stage.rng.uniform(-0.25, 0.1) * unit
    shape = Rectangle((-9 * unit, top), (9 * unit, 9 * unit))
    sky = square_plane(stage.farther(0.97))
    blue = Plain(
        tuple((np.array([0.3, 0.42, 0.75]) * stage.rng.uniform(0.2, 1)).tolist())
    )
    return [
        stage.lit_layer("facade", square_plane(depth), shape, paint),
        stage.lit_layer("sky", sky, Everywhere(), blue),
    ]
