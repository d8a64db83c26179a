"""The controls of knobs, derived from the definitions of the knobs.

A knob added to `lensfit.preset.knobs` appears in the page by itself, with the limits,
the text and the group that it has there.
"""

from typing import Any

import msgspec

from lensfit.preset.knobs import GROUP_OF, NEUTRAL, Knobs
from lensfit.workflow.view.lens_adjustments import FILES

_TITLES = {"aberration": "Aberrations", "bokeh": "Bokeh", "look": "Look"}
_NAMED = {
    "f_number": "f-number",
    "t_number": "T-number",
    "roi": "Where to look: [x0, y0, x1, y1] (px)",
    "asymmetric": "Every other row shifted (true or false)",
    "squares": "Squares: [columns, rows]",
    "marks": "Marks: [columns, rows]",
    "dictionary": "ArUco dictionary",
    "marker_ratio": "Marker side / square side",
    "encoding": "Encoding of light",
}
"""Quantities that their key does not name plainly."""
_UNITS = {
    "mm": "mm", "um": "µm", "percent": "%", "deg": "°", "kelvin": "K", "stops": "stops",
}  # fmt: skip
_WIDEST = 30_000.0
"""Range beyond which a slider says nothing, and a number is typed."""
_USUAL_GAIN = (-1.0, 3.0)
"""Gains may be a hundred; a slider that long could not be set."""


def knob_controls() -> list[dict[str, Any]]:
    """Groups of knobs, each with its name and its knobs.

    Of a knob: its name, a label, what it does, least and most value, the neutral one
    (None: as measured), whether it counts (whole numbers), and the ends of a slider,
    which has none where a number must be typed.
    """
    schema = msgspec.json.schema(Knobs)["$defs"]
    groups = []
    for group in Knobs.__struct_fields__:
        record = type(getattr(NEUTRAL, group)).__name__
        properties = schema[record]["properties"]
        knobs = [
            _control(name, properties[name])
            for name in properties
            if GROUP_OF[name] == group and name not in FILES
        ]
        groups.append({"name": _TITLES.get(group, group.title()), "knobs": knobs})
    return groups


def _control(name: str, schema: dict[str, Any]) -> dict[str, Any]:
    choices = schema.get("anyOf", [schema])
    number = next(one for one in choices if one["type"] in ("number", "integer"))
    least, most = number.get("minimum"), number.get("maximum")
    neutral = schema.get("default")
    return {
        "name": name,
        "label": label_of(name),
        "text": number.get("description") or schema.get("description") or "",
        "least": least,
        "most": most,
        "neutral": neutral,
        "whole": number["type"] == "integer",
        "slider": _slider(name, neutral, least, most),
    }


def label_of(name: str) -> str:
    """A quantity as people call it, with its unit."""
    if name in _NAMED:
        return _NAMED[name]
    *words, last = name.split("_")
    if words and last in _UNITS:
        return f"{' '.join(words).capitalize()} ({_UNITS[last]})"
    return " ".join((*words, last)).capitalize()


def _slider(
    name: str, neutral: Any, least: float | None, most: float | None
) -> tuple[float, float] | None:
    if neutral is None or least is None or most is None or most - least > _WIDEST:
        return None
    if name.endswith("_gain") and most > _USUAL_GAIN[1]:
        return max(least, _USUAL_GAIN[0]), _USUAL_GAIN[1]
    return least, most
