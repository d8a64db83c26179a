"""Ideal lenses and plates in closed form, for tests of depth of field."""

import cv2
import numpy as np

from lensfit.preset.thin_lens import ThinCamera, thin_lens_preset

WIDTH, HEIGHT = 200, 140
FOCUS_MM = 350.0
PX_MM = 50 / 2 * 50 / (2 * 36 / WIDTH)
"""Radius of blur per vergence, px mm: f/N f / 2 pitch."""


def ideal_lens():
    """50 mm f/2 focused near by, 200 pixels across 36 mm."""
    camera = ThinCamera(50.0, 2.0, FOCUS_MM / 1000, 36.0, WIDTH, HEIGHT)
    return thin_lens_preset(camera).at(focus_distance_mm=FOCUS_MM)


def depth_of(radius_px):
    """Distance whose blur has this signed radius, positive in front of the focus."""
    return 1 / (1 / FOCUS_MM + np.asarray(radius_px, float) / PX_MM)


def depth_plane(radius_px):
    """The same distance over the whole frame."""
    return np.full((HEIGHT, WIDTH), depth_of(radius_px), np.float32)


def noise(seed=0, low=0.1, high=0.9):
    """A picture without structure, three channels, as the pixel filter of a renderer
    leaves it: no detail finer than two pixels."""
    values = np.random.default_rng(seed).uniform(-1, 1, (HEIGHT, WIDTH, 3))
    smooth = cv2.GaussianBlur(values, (0, 0), 1.0)
    smooth *= (high - low) / 2 / np.abs(smooth).max()
    return (smooth + (high + low) / 2).astype(np.float32)


def disc(radius_px, half, parts=24):
    """A disc on pixels, by counting points."""
    t = (np.arange((2 * half + 1) * parts) + 0.5) / parts - half - 0.5
    inside = (t**2 + t[:, None] ** 2 <= radius_px**2).astype(float)
    shares = inside.reshape(2 * half + 1, parts, 2 * half + 1, parts).mean((1, 3))
    return shares / shares.sum()
