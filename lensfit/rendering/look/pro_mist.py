"""Pro-mist: a filter whose specks scatter a share of all light into a wide halo.

There is no threshold: highlights glow, and the black level lifts by the share of the
mean of the surroundings, up to the width of the frame. The halo falls off as 1/r^2 over
six octaves. The sum over the picture is kept in every channel.

The real filter is in front of the lens. Here it acts after the lens, on the blurred and
distorted picture: the halo is neither distorted nor dimmed towards the corners, which
is barely visible of a smooth halo.
"""

from lensfit.rendering.look.halo import Halo, haloed
from lensfit.rendering.look.light import all_light, picture_with_halo
from lensfit.rendering.look.pyramid import Picture

HALO = Halo((1.0,) * 6)


def misted(
    colour: Picture, share: float, half_light_px: float, least_px: float
) -> Picture:
    """A picture behind a pro-mist filter.

    Parameters
    ----------
    share : Of the light that is scattered, 0 to 1.
    half_light_px : Within which half of that lands.
    least_px : From `pyramid.least_sigma_px`.
    """
    light = all_light(colour)
    halo = haloed(light, HALO, half_light_px, least_px)
    return picture_with_halo(colour, light, halo, share)
