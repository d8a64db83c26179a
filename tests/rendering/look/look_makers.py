"""Plates with lights, and an ideal lens, for tests of looks."""

from functools import cache

import numpy as np

from lensfit.coords import Window
from lensfit.preset.knob_groups import LookKnobs
from lensfit.preset.thin_lens import ThinCamera, thin_lens_preset
from lensfit.rendering.frame import render

WIDTH, HEIGHT = 240, 160
FOCUS_MM = 2000.0
FRAME = Window.of_size(WIDTH, HEIGHT)


@cache
def ideal_lens(width=WIDTH, height=HEIGHT):
    """50 mm f/2 without distortion, 36 mm across the frame."""
    camera = ThinCamera(50.0, 2.0, FOCUS_MM / 1000, 36.0, width, height)
    return thin_lens_preset(camera).at(focus_distance_mm=FOCUS_MM)


def depth_plane(distance_mm=FOCUS_MM):
    return np.full((HEIGHT, WIDTH), distance_mm, np.float32)


def grey(value=0.2):
    return np.full((HEIGHT, WIDTH, 3), value, np.float32)


def with_light(row, column, light=1000.0, value=0.0):
    picture = grey(value)
    picture[row, column] = light
    return picture


def noise(seed=0, low=0.1, high=3.0):
    values = np.random.default_rng(seed).uniform(low, high, (HEIGHT, WIDTH, 3))
    return values.astype(np.float32)


def looked(picture, depth_mm=None, lens=None, tolerance=1e-3, windows=None, **knobs):
    return render(
        picture,
        depth_mm,
        lens or ideal_lens(),
        tolerance=tolerance,
        look=LookKnobs(**knobs),
        **(windows or {}),
    )


def centroid(plane):
    """x and y of a plane's light, pixel centres at halves."""
    y, x = np.indices(plane.shape) + 0.5
    total = plane.sum(dtype=float)
    return np.array([(plane * x).sum() / total, (plane * y).sum() / total])


def within(plane, centre, radius):
    """Share of a plane's light within a radius."""
    y, x = np.indices(plane.shape) + 0.5
    near = np.hypot(x - centre[0], y - centre[1]) <= radius
    return plane[near].sum(dtype=float) / plane.sum(dtype=float)
