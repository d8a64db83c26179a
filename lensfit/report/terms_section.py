"""The report's table of candidate terms: kept or left out, and why.

A term that several states of the lens have is one row, with a line for each state in
which its value or its reason differs.
"""

from typing import Any

from lensfit.report.markup import (
    NOTHING,
    Markup,
    number_with_deviation,
    stated,
    tag,
)
from lensfit.report.plain_numbers import distance_of
from lensfit.report.report_sections import distance_text, table_row

_MOST_VALUES = 6
"""Of one term; of more the largest is shown, all are in the JSON."""
_ABOUT = (
    "A term is kept only if it improves held-out error and BIC, and its effect is "
    "larger than the photographs' noise."
)


def terms_section(report: dict) -> Markup:
    """The table of what was modelled and what was left out."""
    rows = _gathered(report.get("terms") or [])
    if not rows:
        return Markup("")
    several = len({_state(term) for group in rows for term in group} - {""}) > 1
    head = table_row("th", ["Term", "", "Value ± 1σ", "Why"])
    body = tag("tbody", *(_row(group, several) for group in rows))
    table = tag("table", tag("thead", head), body, class_="terms")
    return tag(
        "section",
        tag("h2", "What was modelled, what was left out"),
        tag("p", _ABOUT, class_="facts"),
        tag("div", table, class_="scroll"),
        id="terms",
    )


def _gathered(terms: list[dict]) -> list[list[dict]]:
    """Terms of one name and fate together, those kept first."""
    groups: dict[tuple[str, bool], list[dict]] = {}
    for term in terms:
        mine = groups.setdefault((str(term.get("name")), bool(term.get("kept"))), [])
        # States that share a wavefront each name its terms.
        if not any(_term_fields(term) == _term_fields(other) for other in mine):
            mine.append(term)
    return sorted(groups.values(), key=lambda group: not group[0].get("kept"))


def _term_fields(term: dict) -> list[Any]:
    return [term.get(key) for key in ("value", "standard_deviation", "reason")]


def _row(group: list[dict], several: bool) -> Markup:
    """`several`: whether the lens has more than one state, which must be named."""
    kept = bool(group[0].get("kept"))
    badge = tag(
        "span",
        "kept" if kept else "left",
        class_=f"badge tone-{'good' if kept else 'note'}",
    )
    values = [
        part
        for term in group
        if term.get("value") is not None
        for part in (_state(term) if several else None, *_values(term))
    ]
    reasons = [
        tag("div", _state(term) if several else None, term.get("reason"))
        for term in group
    ]
    cells = [
        tag("td", tag("code", group[0].get("name"))),
        tag("td", badge),
        tag("td", *(values or [NOTHING]), class_="value"),
        tag("td", *reasons),
    ]
    return tag("tr", *cells, class_=None if kept else "left")


def _state(term: dict) -> Markup:
    """Of which state of the lens a line speaks; nothing where it speaks of all."""
    focus = distance_of(term.get("focus_distance_mm"))
    if focus is None:
        return Markup("")
    at = f"focused at {distance_text(focus)}"
    if term.get("focal_length_mm") is not None:
        at = f"{stated(term['focal_length_mm'], 'mm')} {at}"
    return tag("small", f"{at}: ")


def _values(term: dict) -> list[Markup]:
    value, deviation = term["value"], term.get("standard_deviation")
    unit = term.get("unit") or ""
    values = value if isinstance(value, list | tuple) else [value]
    deviations = [deviation] * len(values)
    if isinstance(deviation, list | tuple) and len(deviation) == len(values):
        deviations = list(deviation)
    pairs = list(zip(values, deviations, strict=True))
    # Steps of a family that were not taken are zero, and known to be.
    pairs = [pair for pair in pairs if pair[0] or pair[1]] or pairs
    if len(pairs) > _MOST_VALUES:
        largest = max(pairs, key=lambda pair: abs(pair[0]))
        about = f"{len(pairs)} values, the largest"
        return [tag("div", about), tag("div", number_with_deviation(*largest, unit))]
    return [tag("div", number_with_deviation(v, sd, unit)) for v, sd in pairs]
