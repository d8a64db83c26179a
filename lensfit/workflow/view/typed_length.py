"""Read a length that was typed into a page, as the reader of shoot files does."""

import math
from contextlib import suppress
from typing import Annotated

from msgspec import Meta, Struct
from starlette.requests import Request
from starlette.responses import JSONResponse, Response

from lensfit.errors import LensfitError, ShootError
from lensfit.workflow.shoot.lengths import length_mm
from lensfit.workflow.view.answers import message_of

_KEY = "length"
_DIGITS = 12
"""Of a length, so that 1.1 m is 1100 mm."""


class TypedLength(Struct, frozen=True, forbid_unknown_fields=True):
    """What was typed."""

    typed: Annotated[str, Meta(max_length=200)]


def typed_length_mm(typed: str) -> float:
    """Millimetres of a length with its unit, or of a number without.

    Raises
    ------
    LensfitError : It is no length.
    """
    with suppress(ValueError):
        if math.isfinite(number := float(typed)):
            return number
    try:
        found = length_mm(typed.strip(), _KEY, "")
    except ShootError as error:
        said = error.what.removeprefix(f"{_KEY} = ")
        raise LensfitError(said, remedy=error.remedy) from error
    return float(f"{found:.{_DIGITS}g}")


async def length_answer(request: Request) -> Response:
    """The millimetres, or "inf"."""
    found = typed_length_mm((await message_of(request, TypedLength)).typed)
    return JSONResponse({"mm": "inf" if math.isinf(found) else found})
