"""What `lensfit bench wavefront` fits beside one calibration of each lens."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

import typer

from lensfit.cli._door import each_of
from lensfit.cli._options import EFFORT_HELP, EFFORTS

if TYPE_CHECKING:
    from data_synth.bench.wavefront.beside import Beside


@dataclass(frozen=True)
class BesideGroup:
    """Peers, takes left out, efforts."""

    peers: Annotated[
        bool,
        typer.Option(
            "--peers",
            help="Gaussians, a masked disc and Seidel terms from the same photographs",
        ),
    ] = False
    leave_out: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME|each",
            help="Fit again without a take, judged there; may be repeated",
        ),
    ] = None
    effort: Annotated[
        list[str] | None,
        typer.Option(
            metavar=EFFORT_HELP,
            help="Seconds and error of the fit at an effort; may be repeated",
            callback=each_of(EFFORTS),
        ),
    ] = None

    def wanted(self) -> "Beside":
        """With the judge of the ray tracer."""
        from data_synth.bench.wavefront.beside import Beside
        from data_synth.judge_spots import judge_spots

        leave_out, efforts = tuple(self.leave_out or ()), tuple(self.effort or ())
        return Beside(judge_spots, self.peers, leave_out, efforts)
