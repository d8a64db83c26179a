"""What `lensfit bench wavefront` fits beside one calibration of each lens."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

import typer

from lensfit.cli.calibrate import EFFORTS

if TYPE_CHECKING:
    from lensfit.workflow.bench.wavefront.beside import Beside


def _known(given: list[str] | None) -> list[str] | None:
    unknown = [effort for effort in given or [] if effort not in EFFORTS]
    if unknown:
        raise typer.BadParameter(f"{unknown[0]!r} is none of {', '.join(EFFORTS)}")
    return given


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
            metavar=" | ".join(EFFORTS),
            help="Seconds and error of the fit at an effort; may be repeated",
            callback=_known,
        ),
    ] = None

    def wanted(self) -> "Beside":
        """With the judge of the ray tracer."""
        from data_synth.judge_spots import judge_spots
        from lensfit.workflow.bench.wavefront.beside import Beside

        leave_out, efforts = tuple(self.leave_out or ()), tuple(self.effort or ())
        return Beside(judge_spots, self.peers, leave_out, efforts)
