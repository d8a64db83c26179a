"""Names of the accuracy settings, described in `lensfit.fitting.wavefront.effort`.

That module is not imported for the help alone.
"""

from typing import Annotated

import typer

from lensfit.cli._door import one_of

EFFORTS = ("fastest", "fast", "normal", "best")
EFFORT_HELP = " | ".join(EFFORTS)
EFFORTS_OR_NONE = ("none", *EFFORTS)
EFFORT_OR_NONE_HELP = (
    "Speed against error of the blur; none leaves it out: "
    + " | ".join(EFFORTS_OR_NONE)
)
EffortOption = Annotated[
    str, typer.Option(help=EFFORT_OR_NONE_HELP, callback=one_of(EFFORTS_OR_NONE))
]
