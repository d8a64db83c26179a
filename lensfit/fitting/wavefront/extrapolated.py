"""What of the blur was never photographed, and is therefore guessed from the rest.

A wavefront that explains its photographs says little of others where all were taken at
one f-number or on one side of focus: aberrations and defocus make up for each other
there, and part elsewhere.
"""

import numpy as np

from lensfit.fitting.wavefront.gather import Gathered
from lensfit.fitting.wavefront.start import IN_FOCUS_MM, stated_defocus_mm


def guessed_of(gathered: Gathered) -> tuple[str, ...]:
    """One sentence for each kind of setting that nobody photographed."""
    return (*_at_other_stops(gathered), *_beyond_focus(gathered))


def _at_other_stops(gathered: Gathered) -> tuple[str, ...]:
    widest, *others = gathered.f_numbers
    if others:
        return ()
    if all(one.take.f_number is None for one in gathered.shown):
        return (
            "the blur holds for the stop that was photographed, which the preset calls "
            f"f/{widest:g} since nobody stated it: state f_number of each take",
        )
    return (
        f"the blur was photographed at f/{widest:g} alone and is guessed at other "
        "stops: photograph the dots at a second f-number",
    )


def _beyond_focus(gathered: Gathered) -> tuple[str, ...]:
    """By what was stated; where nothing was, the side of focus is in doubt itself."""
    stated_mm = stated_defocus_mm(gathered)
    if not np.isfinite(stated_mm).all():
        return ()
    near, far = np.any(stated_mm > IN_FOCUS_MM), np.any(stated_mm < -IN_FOCUS_MM)
    if near and far:
        return ()
    if not (near or far):
        return (
            "the blur was photographed in focus alone and is guessed out of focus: add "
            "takes focused nearer and farther than the chart",
        )
    return (
        "the blur was photographed on one side of focus alone and is guessed on the "
        "other: add takes focused on the other side of the chart",
    )
