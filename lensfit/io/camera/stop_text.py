"""How cameras write a stop: "1.4 + 7/10", "T 2 3/10", "T2.3", "F5.6".

A number as engraved, and tenths (or thirds) of a stop that the iris is closed beyond
it; each stop is a factor of sqrt 2. T-stops count transmitted light and are a little
larger than the f-number, which counts geometry.
"""

import re

from lensfit.errors import CameraError

_STOP = re.compile(
    r"\s*(?P<kind>[TtFf])?\s*/?\s*(?P<mark>\d+(?:\.\d+)?|\.\d+)"
    r"(?:\s*\+?\s+(?P<top>\d{1,3})\s*/\s*(?P<bottom>\d{1,3}))?\s*"
)


def stop(text: str, entry: str) -> tuple[str | None, float]:
    """The letter of a stop, "T", "F" or None, and its number.

    Raises
    ------
    CameraError : The text is no stop.
    """
    match = _STOP.fullmatch(text) if len(text) < 64 else None
    if match is None or match["bottom"] == "0":
        shown = " ".join(text.split())[:40]
        raise CameraError(f"{entry} is {shown!r} and should be a stop, such as T2.8")
    closed = int(match["top"]) / int(match["bottom"]) if match["top"] else 0.0
    kind = match["kind"]
    return kind and kind.upper(), float(match["mark"]) * 2 ** (closed / 2)


def stop_of_linear_iris(value: float) -> float:
    """T-stop of ARRI's linear iris: 1000 is T1, and every 1000 more closes a stop."""
    return 2 ** (min(max(value, -1e5), 1e5) / 2000 - 0.5)
