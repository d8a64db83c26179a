"""The sections of the report on the lens, its takes and its candidate terms.

Each function turns one part of the report's dictionary into HTML, and gives nothing
when that part is absent: an old or partial report still makes a page.

Candidate terms are a table: kept or left out, and why. A term that several
states of the lens have is one row, with a line for each state in which its value or its
reason differs.
"""

import math
from collections.abc import Mapping
from typing import Any

from lensfit.report.evidence import image_size_px, takes_by_focal
from lensfit.report.markup import (
    NOTHING,
    Markup,
    number,
    number_with_deviation,
    stated_value,
    tag,
)
from lensfit.report.plain_numbers import distance_of
from lensfit.report.plots import coverage, entry_figures, take_figures
from lensfit.report.svg import Figure
from lensfit.report.wipe import wipe_figures


def lens_section(report: dict) -> Markup:
    """Every entry of the preset with its figures."""
    entries = report.get("entries") or []
    if not entries:
        return Markup("")
    camera = report.get("camera") or {}
    blocks = [_entry_block(entry, camera) for entry in entries]
    return tag("section", tag("h2", "The lens"), *blocks, id="lens")


def coverage_section(report: dict) -> Markup:
    """Where the points were, one pair of figures for each focal length."""
    groups = takes_by_focal(report)
    blocks = []
    for focal, takes in groups.items():
        figures = coverage(takes, image_size_px(report))
        if not figures:
            continue
        title = tag("h3", _focal_name(focal)) if len(groups) > 1 else None
        head = tag("header", title) if title else None
        blocks.append(tag("div", head, _figure_grid(figures), class_="block"))
    if not blocks:
        return Markup("")
    return tag("section", tag("h2", "The evidence"), *blocks, id="evidence")


def takes_section(report: dict, pictures: Mapping[str, str | None]) -> Markup:
    """A table of all takes, then each with its overlay and residuals.

    Parameters
    ----------
    report : the report's dictionary.
    pictures : ``data:`` address of each overlay, by the path the report names.
    """
    takes = report.get("takes") or []
    if not takes:
        return Markup("")
    size_px = image_size_px(report)
    blocks = [
        _take_block(index, take, size_px, pictures) for index, take in enumerate(takes)
    ]
    title = tag("h2", "Take by take")
    return tag("section", title, _takes_table(takes), *blocks, id="takes")


def figure_html(figure: Figure) -> Markup:
    """A figure with its title and caption."""
    return tag(
        "figure",
        tag("h4", figure.title),
        figure.svg,
        tag("figcaption", figure.caption) if figure.caption else None,
        data_figure=figure.key,
    )


def _figure_grid(figures: list[Figure]) -> Markup:
    return tag("div", *map(figure_html, figures), class_="figures")


def _focal_name(focal_length_mm: float | None) -> str:
    return (
        "Focal length not stated"
        if focal_length_mm is None
        else stated_value(focal_length_mm, "mm")
    )


def _entry_block(entry: dict, camera: dict) -> Markup:
    focus = entry.get("focus_distance_mm")
    name = stated_value(entry.get("focal_length_mm"), "mm")
    if focus is not None:
        name += f", focused at {distance_text(float(focus))}"
    figures = entry_figures(entry, camera)
    header = tag(
        "header", tag("h3", name), tag("p", _entry_facts(entry), class_="facts")
    )
    return tag("div", header, _figure_grid(figures), class_="block entry")


def _entry_facts(entry: dict) -> str:
    facts = []
    if entry.get("principal_distance_mm") is not None:
        distance = number(entry["principal_distance_mm"], "mm", 5)
        facts.append(f"principal distance {distance}")
    for key, name in (
        ("principal_point_mm", "principal point"),
        ("distortion_centre_mm", "distortion centre"),
    ):
        if entry.get(key):
            x, y = entry[key]
            facts.append(f"{name} ({number(x, digits=2)}, {number(y, digits=2)}) mm")
    if entry.get("monotone") is not None:
        facts.append("invertible" if entry["monotone"] else "folds")
    if entry.get("round_trip_max_px") is not None:
        facts.append(f"round trip {number(entry['round_trip_max_px'], 'px', 2)}")
    if entry.get("overscan_percent") is not None:
        facts.append(f"overscan {number(entry['overscan_percent'], '%', 4)}")
    return " · ".join(facts)


def distance_text(distance_mm: float) -> str:
    """A distance in millimetres, or in metres from one metre on."""
    if math.isinf(distance_mm):
        return number(distance_mm)
    if distance_mm >= 1000:
        return stated_value(distance_mm / 1000, "m")
    return stated_value(distance_mm, "mm")


def table_row(
    cell: str, values: list[Any], numeric: int = 99, class_: str = ""
) -> Markup:
    """A table's row of `cell` elements; from column `numeric` on they are numbers."""
    cells = [
        tag(cell, value, class_="n" if index >= numeric else None)
        for index, value in enumerate(values)
    ]
    return tag("tr", *cells, class_=class_ or None)


def _takes_table(takes: list[dict]) -> Markup:
    names = ["Take", "Target", "Focal", "Stop", "Focus", "Chart at", "Used / found"]
    head = table_row("th", [*names, "Rms", "Held out"], numeric=2)
    rows = [_take_row(index, take) for index, take in enumerate(takes)]
    table = tag("table", tag("thead", head), tag("tbody", *rows), class_="takes")
    return tag("div", table, class_="scroll")


def _take_row(index: int, take: dict) -> Markup:
    link = tag("a", take_name(take), href=f"#take-{index + 1}")
    if take.get("failed"):
        reason = tag("td", f"left out: {take['failed']}", colspan=8, class_="failure")
        return tag("tr", tag("td", link), reason)
    state = [stated_value(take.get("focal_length_mm"), "mm"), stop_text(take)]
    for key in ("focus_distance_mm", "target_distance_mm"):
        state.append(
            NOTHING if take.get(key) is None else distance_text(float(take[key]))
        )
    used = f"{number(take.get('points_used'))} / {number(take.get('points_detected'))}"
    errors = [number(take.get(k), "px") for k in ("rms_px", "held_out_rms_px")]
    return table_row("td", [link, take.get("target"), *state, used, *errors], numeric=2)


def take_name(take: dict) -> str:
    """What a take is called in the report."""
    return str(take.get("name") or take.get("image") or "unnamed take")


def stop_text(take: dict) -> str:
    """The f-number of a take."""
    stop = take.get("f_number")
    return NOTHING if stop is None else f"f/{stated_value(round(stop, 1))}"


def _take_block(
    index: int,
    take: dict,
    size_px: tuple[float, float],
    pictures: Mapping[str, str | None],
) -> Markup:
    figures = [figure_html(figure) for figure in take_figures(take, size_px)]
    overlay = _overlay(take, pictures)
    notes = [tag("p", note) for note in take.get("notes") or []]
    if take.get("failed"):
        notes.insert(0, tag("p", f"Left out: {take['failed']}", class_="failure"))
    facts = [str(take["image"])] if take.get("image") else []
    if take.get("rms_px") is not None:
        facts.append(f"{number(take['rms_px'], 'px')} rms")
    header = tag(
        "header",
        tag("h3", take_name(take)),
        tag("p", " · ".join(facts), class_="facts"),
    )
    grid = tag("div", overlay, *figures, class_="figures")
    wipe = wipe_figures(take, take_name(take), pictures)
    parts = [header, *notes, wipe, grid]
    return tag("div", *parts, class_="block take", id=f"take-{index + 1}")


def _overlay(take: dict, pictures: Mapping[str, str | None]) -> Markup:
    named = take.get("overlay")
    if not named:
        return Markup("")
    address = pictures.get(named)
    if address is None:
        return tag("p", f"The overlay {named} could not be read.", class_="facts")
    name = take_name(take)
    picture = tag("img", src=address, alt=f"What was found on {name}")
    label = f"Enlarge the overlay of {name}"
    button = tag("button", picture, type="button", class_="zoom", aria_label=label)
    return tag(
        "figure",
        tag("h4", "What was found"),
        button,
        tag("figcaption", "Detected points drawn on the photograph; click to enlarge."),
        data_figure="overlay",
    )


_MOST_VALUES = 6
"""Of one term; of more the largest is shown, all are in the JSON."""
_ABOUT = (
    "A term is kept if BIC and held-out error are clearly better with it, of the map "
    "only if its effect is larger than the photographs' noise; or for the reason given."
)


def terms_section(report: dict) -> Markup:
    """The table of what was modelled and what was left out."""
    rows = _gathered_terms(report.get("terms") or [])
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


def _gathered_terms(terms: list[dict]) -> list[list[dict]]:
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
        at = f"{stated_value(term['focal_length_mm'], 'mm')} {at}"
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
