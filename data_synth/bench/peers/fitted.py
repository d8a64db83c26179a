"""What a user has today, fitted to the same photographs as lensfit, and never to truth.

    gaussians      one for each dot, smooth over the field (`peers.gaussian`)
    disc and mask  a thin lens' disc, clipped towards the corner (`peers.disc`)
    Seidel only    lensfit's fit with defocus, third order, rims and blades, grey

The first two are functions that make lenses, the last is a preset.
"""

from collections.abc import Callable
from functools import partial
from typing import NamedTuple

from data_synth.bench.peers.disc import DiscLens, matched_disc
from data_synth.bench.peers.dots import pictured
from data_synth.bench.peers.gaussian import GaussianLens, gaussian_fields
from data_synth.judged_lens import SpotLens
from lensfit.errors import FitError
from lensfit.fitting.chart_view import View
from lensfit.fitting.lens_states import fit
from lensfit.fitting.wavefront.effort import Effort
from lensfit.fitting.wavefront.term_groups import SEIDEL
from lensfit.preset.schema import Preset
from lensfit.progress import stopwatch
from lensfit.workflow.calibrate import preset_of
from lensfit.workflow.calibration.observe import Observed
from lensfit.workflow.shoot.shoot_records import Shoot

LensMaker = Callable[[float, float], SpotLens]
"""Of f-number and focus distance, mm."""
GAUSSIANS, DISC, SEIDEL_ONLY = "gaussians", "disc and mask", "Seidel only"


class Peer(NamedTuple):
    """A preset or a function that makes lenses, and what its fit took."""

    lens: Preset | LensMaker
    seconds: dict[str, float]


def simple_peers(takes: list[View]) -> dict[str, Peer]:
    """Gaussians, and disc and mask.

    Raises
    ------
    FitError : No photograph of dots states f-number, focus and the chart's distance.
    """
    pictures = pictured(takes)
    if not pictures:
        raise FitError(
            "no photograph of dots states its f-number, focus distance and target "
            "distance",
            remedy="state all three, or leave --peers out",
        )
    widest = min(dots.f_number for dots in pictures)
    first = pictures[0]
    with stopwatch() as for_gaussians:
        fields = gaussian_fields(pictures)
    with stopwatch() as for_disc:
        numbers = matched_disc(pictures)
    known = (numbers, first.focal_length_mm, first.half_diagonal_mm, widest)
    return {
        GAUSSIANS: Peer(partial(GaussianLens, fields), for_gaussians),
        DISC: Peer(partial(DiscLens, *known), for_disc),
    }


def refitted(
    shoot: Shoot,
    observed: list[Observed],
    *,
    without: str = "",
    effort: Effort = Effort.NORMAL,
    seidel_only: bool = False,
) -> Peer:
    """lensfit fitted again to points that were detected before.

    Parameters
    ----------
    without : Image of a take that the fit must not see.

    Raises
    ------
    FitError : Nothing could be fitted.
    """
    seen = [o for o in observed if o.image != without]
    takes = [o.take for o in seen if o.take is not None]
    with stopwatch() as seconds:
        fitted = fit(takes, effort=effort, allowed=SEIDEL if seidel_only else None)
    return Peer(preset_of(shoot, seen, fitted), seconds)
