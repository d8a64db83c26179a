"""Seeded random scenes that suit a lens: what stands where, how large, how bright.

Things stand before the focus and behind it; subject, floor and lamps take part in every
depth.
"""

import numpy as np

from data_synth.scene.layers import (
    Lamps,
    Layer,
    Plane,
    Scene,
    floor_plane,
    square_plane,
    wall_plane,
)
from data_synth.scene.paints import Checker, Paint, Plain, Star, Windows
from data_synth.scene.plates import PinholeCamera
from data_synth.scene.shapes import (
    Discs,
    Everywhere,
    Leaves,
    Rectangle,
    Strips,
    Union,
    Without,
)
from data_synth.scene.stage import Stage


def leaves_layers(stage: Stage) -> list[Layer]:
    """Leaves at the sides of the frame, in two or three depths."""
    layers = []
    for k in range(stage.rng.integers(2, 4)):
        depth = stage.nearer(stage.rng.uniform(0.25, 1.0))
        unit = stage.height_mm(depth)
        count = int(stage.rng.integers(25, 60))
        side = stage.rng.choice([-1, 1])
        centre = stage.rng.normal(0, 0.16, (count, 2)) + np.array(
            [side * stage.half_width * 0.8, stage.rng.uniform(-0.4, 0.3)]
        )
        length = stage.rng.uniform(0.02, 0.055, count)
        leaves = Leaves(
            centre * unit,
            length * unit,
            length * unit * stage.rng.uniform(0.25, 0.45, count),
            stage.rng.uniform(0, np.pi, count),
        )
        green = (0.07, stage.rng.uniform(0.22, 0.42), 0.05)
        layers.append(
            stage.lit_layer(f"leaves {k}", square_plane(depth), leaves, Plain(green))
        )
    return layers


def wires_across(
    stage: Stage, depth: float, count: int, width_rows: tuple[float, float]
) -> Strips:
    """Strips from edge to edge of the plate, widths in 540ths of the frame's height."""
    unit = stage.height_mm(depth)
    half = stage.half_width * 1.1
    ends = stage.rng.uniform(-0.7, 0.7, (count, 2))
    start = np.column_stack([np.full(count, -half), ends[:, 0]])
    end = np.column_stack([np.full(count, half), ends[:, 1]])
    return Strips(
        start * unit,
        end * unit,
        stage.rng.uniform(*width_rows, count) * stage.row_mm(depth),
    )


def wires_layers(stage: Stage) -> list[Layer]:
    """Thin wires before the focus."""
    depth = stage.nearer(stage.rng.uniform(0.1, 0.7))
    wires = wires_across(stage, depth, int(stage.rng.integers(2, 6)), (0.6, 4.0))
    return [
        stage.lit_layer("wires", square_plane(depth), wires, Plain((0.02, 0.02, 0.03)))
    ]


def veil_layers(stage: Stage) -> list[Layer]:
    """A thin cloth that lets most of the light through."""
    depth = stage.nearer(stage.rng.uniform(0.2, 0.8))
    unit = stage.height_mm(depth)
    left = stage.rng.uniform(-0.6, 0.2) * stage.half_width
    shape = Rectangle((left * unit, -unit), ((left + 0.45) * unit, 0.3 * unit))
    opacity = float(stage.rng.uniform(0.25, 0.5))
    plane = square_plane(depth)
    return [
        stage.lit_layer("veil", plane, shape, Plain(stage.colour(0.3)), opacity=opacity)
    ]


def sheet_with_holes_layers(stage: Stage) -> list[Layer]:
    """A plate with round holes along one side of the frame."""
    depth = stage.nearer(stage.rng.uniform(0.3, 1.0))
    unit = stage.height_mm(depth)
    side = stage.rng.choice([-1.0, 1.0])
    inner = side * stage.half_width * 0.62
    low, high = sorted([inner, side * stage.half_width * 1.2])
    pitch = 0.11
    x, y = np.meshgrid(np.arange(low, high, pitch), np.arange(-0.7, 0.7, pitch))
    centre = np.stack([x, y], -1).reshape(-1, 2) + pitch / 2
    holes = Discs(centre * unit, np.full(len(centre), 0.036 * unit))
    sheet = Rectangle((low * unit, -0.7 * unit), (high * unit, 0.7 * unit))
    return [
        stage.lit_layer("sheet with holes", square_plane(depth), Without(sheet, holes),
            Plain(stage.colour(0.1, 0.5)),
        )
    ]  # fmt: skip


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


FLOOR_PART = 0.75
"""Of all scenes have a floor."""


def drawn_scene(
    camera: PinholeCamera, focus_mm: float, pupil_diameter_mm: float, seed: int
) -> Scene:
    """A random scene: a sharp subject, things before and behind it, and lamps.

    Parameters
    ----------
    focus_mm : Depth of the focus from the entrance pupil.
    pupil_diameter_mm : Of the entrance pupil.
    """
    height_mm = camera.frame.size_mm[1]
    blur = pupil_diameter_mm * camera.focal_length_mm / height_mm
    rng = np.random.default_rng(seed)
    stage = Stage(camera, focus_mm, blur, rng)
    near = [leaves_layers, wires_layers, veil_layers, sheet_with_holes_layers]
    behind = [columns_layers, back_wires_layers, wall_layers, lattice_layers]
    chosen = [near[k] for k in rng.permutation(4)[: rng.integers(2, 4)]]
    chosen += [behind[k] for k in rng.permutation(4)[: rng.integers(2, 4)]]
    if rng.uniform() < FLOOR_PART:
        chosen.append(floor_layers)
    chosen += [subject_layers, lamps_layers, background_layers]
    layers = [layer for make in chosen for layer in make(stage)]
    return Scene(tuple(sorted(layers, key=lambda layer: layer.plane.origin_mm[2])))
