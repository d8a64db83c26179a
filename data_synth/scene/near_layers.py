"""What stands between the lens and its focus in a drawn scene."""

import numpy as np

from data_synth.scene.layers import Layer, square_plane
from data_synth.scene.paints import Plain
from data_synth.scene.shapes import Discs, Leaves, Rectangle, Strips, Without
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
