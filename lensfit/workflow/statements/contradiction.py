"""A statement of a shoot that its photographs contradict.

The record that reports and verdicts read. A module with a better residual of a
statement (the fit itself, with statements as priors) uses the same record.
"""

from dataclasses import asdict, dataclass
from typing import Any, Literal, final

Kind = Literal[
    "pitch", "focal_length", "target_distance", "side_of_focus", "f_number", "encoding",
    "lens_identity", "blurred_view", "repeated_exposure", "unconfirmed", "statements",
    "photograph_size", "aspect", "target", "exchanged", "exposure",
]  # fmt: skip
Limit = Literal["match-moving", "undistortion", "look", "unusable"]


@final
@dataclass(frozen=True)
class Contradiction:
    """What was stated, what the photographs agree with, and what to do.

    Attributes
    ----------
    kind : One word for programs.
    limit : The best that such a shoot can be used for.
    text : One sentence without its full stop, the cause first.
    remedy : The one thing to do.
    statement : The key of the shoot file, and of which table.
    stated, agrees_with : Value as stated, and with which the photographs agree; None
        where the statement is no number.
    explained : Part of the misfit of all statements that releasing this one explains;
        None where no misfit was computed.
    images : Photographs that it is about.
    """

    kind: Kind
    limit: Limit
    text: str
    remedy: str
    statement: str | None = None
    stated: float | None = None
    agrees_with: float | None = None
    explained: float | None = None
    images: tuple[str, ...] = ()

    def as_json(self) -> dict[str, Any]:
        """In types that JSON knows."""
        return asdict(self) | {"images": list(self.images)}
