"""Focus on the command line, by pointing at what is to be sharp."""

from dataclasses import dataclass
from typing import Annotated

import typer

_MOST_PX = 1e6


@dataclass(frozen=True)
class FocusGroup:
    """What is in focus, of a plate with depth."""

    focus_at: Annotated[
        str | None,
        typer.Option(
            metavar="X,Y[,X1,Y1]",
            help="Focus on what lies at a pixel of the frame, or (median) in a region",
            rich_help_panel="Camera",
        ),
    ] = None

    def pick(self) -> tuple[float, ...] | None:
        """The pixel or region.

        Raises
        ------
        typer.BadParameter : It is neither.
        """
        if self.focus_at is None:
            return None
        try:
            numbers = tuple(float(word) for word in self.focus_at.split(","))
        except ValueError:
            numbers = ()
        if len(numbers) not in (2, 4) or not all(abs(n) < _MOST_PX for n in numbers):
            raise typer.BadParameter(
                f"{self.focus_at!r} is not X,Y or X0,Y0,X1,Y1", param_hint="--focus-at"
            )
        return numbers
