"""How many rays a photograph of a scene is made of, and the seeds that draw them."""

import math
from dataclasses import dataclass

import numpy as np

SHARES = (1, 4, 1)
"""Rays of the three wavelengths of a channel: their weights, so that each ray counts
the same."""


@dataclass(frozen=True)
class Sampling:
    """How many rays to trace.

    Attributes
    ----------
    exposures : Independent ones that are averaged; at least two.
    rays_per_pixel : Of each exposure, channel and outer wavelength; a power of two. The
        middle wavelength gets four times as many.
    lamp_rays_per_pixel : Of each exposure and channel, for a pixel of a lamp's image.
    plate_rays_per_pixel : Of the pinhole plate; a power of two.
    """

    exposures: int = 4
    rays_per_pixel: int = 4
    lamp_rays_per_pixel: int = 64
    plate_rays_per_pixel: int = 64


def seed_of(*parts: int) -> int:
    """A seed made of several numbers: another for each combination."""
    return int(np.random.SeedSequence(parts).generate_state(1)[0])


def sampling_of(rays_per_pixel: int) -> Sampling:
    """About this many rays for a pixel and channel, in whole powers of two.

    Four exposures of at least six rays, and of at most as many as asked.
    """
    each = rays_per_pixel / (Sampling.exposures * sum(SHARES))
    return Sampling(rays_per_pixel=1 << max(0, round(math.log2(max(each, 1.0)))))
