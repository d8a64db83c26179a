"""Diffusion: a net or soft-focus filter, which softens detail around a sharp core.

A share of all light goes into a halo of three octaves, small enough to melt skin and
edges; the rest stays where it was, so that the picture remains sharp underneath. The
sum over the picture is kept in every channel. Placed as `pro_mist`.
"""

from lensfit.rendering.look.halo import Halo, haloed
from lensfit.rendering.look.light import all_light, picture_with_halo
from lensfit.rendering.look.pyramid import Picture

HALO = Halo((1.0,) * 3)


def diffused(
    colour: Picture, share: float, half_light_px: float, least_px: float
) -> Picture:
    """A picture through a diffusion filter; parameters as `pro_mist.misted`."""
    light = all_light(colour)
    halo = haloed(light, HALO, half_light_px, least_px)
    return picture_with_halo(colour, light, halo, share)
