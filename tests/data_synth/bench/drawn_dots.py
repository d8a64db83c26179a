"""Pictures of dots whose blur is known, drawn sample by sample."""

import numpy as np

from data_synth.bench.peers.dots import PicturedDots

CELL_MM = 0.01
SIDE = 24
HALF_DIAGONAL_MM = 15.0
FINE = 8
HOLE_MM2 = np.diag([2e-5, 1.5e-5])


def grid_mm(columns=7, rows=5):
    """Places over the frame, (dots, 2)."""
    axes = np.linspace(-11, 11, columns), np.linspace(-8, 8, rows)
    return np.stack(np.meshgrid(*axes), -1).reshape(-1, 2)


def pictures_of(light_of, setting, places_mm=None, noise=0.0, hole_mm2=HOLE_MM2):
    """Dots, each a cell-mean of `light_of(place_mm, x_mm, y_mm)` about its centre.

    The centre of each channel is somewhere within half a cell of the middle.
    """
    places_mm = grid_mm() if places_mm is None else places_mm
    rng = np.random.default_rng(7)
    offset = rng.uniform(-0.5, 0.5, (len(places_mm), 3, 2))
    at = (np.arange(SIDE * FINE) + 0.5) / FINE - SIDE / 2
    light = np.zeros((len(places_mm), 3, SIDE, SIDE))
    for k, place in enumerate(places_mm):
        for c in range(3):
            x, y = (at - offset[k, c, 0])[None], (at - offset[k, c, 1])[:, None]
            fine = light_of(place, x * CELL_MM, y * CELL_MM)
            light[k, c] = fine.reshape(SIDE, FINE, SIDE, FINE).mean((1, 3))
    share = light / light.sum((2, 3), keepdims=True)
    steps = np.arange(SIDE) + 0.5
    centre = np.stack([share.sum(2) @ steps, share.sum(3) @ steps], -1)
    light = 0.02 + (1 + np.arange(3))[:, None, None] * 0.2 * light / light.max()
    return PicturedDots(
        *setting,
        focal_length_mm=50.0,
        half_diagonal_mm=HALF_DIAGONAL_MM,
        place_mm=places_mm,
        light=light + noise * rng.standard_normal(light.shape),
        use=np.ones(light.shape, bool),
        centre_cells=centre,
        cell_mm=np.full(2, CELL_MM),
        hole_mm2=hole_mm2,
    )


def gaussian(covariance_mm2):
    """Light of a Gaussian."""
    inverse = np.linalg.inv(covariance_mm2)

    def light(_, x, y):
        square = inverse[0, 0] * x * x + 2 * inverse[0, 1] * x * y
        return np.exp(-(square + inverse[1, 1] * y * y) / 2)

    return light
