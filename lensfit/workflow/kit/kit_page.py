"""The page of a kit: which lens to shoot again and why, then every figure of each.

It is a pure function of what kit.json holds, which is written from the record of every
lens. One HTML file without any outside resource; it links to the report of each lens
beside it.
"""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from lensfit.atomic import write_text_atomic
from lensfit.preset.verdict_levels import LEVELS
from lensfit.report.evidence import sentence_list
from lensfit.report.markup import NOTHING, Markup, number, stated_value, tag
from lensfit.report.plain_numbers import distance_of
from lensfit.report.report_sections import distance_text, table_row
from lensfit.workflow.kit.checklist import kit_document
from lensfit.workflow.kit.kit_file import Kit
from lensfit.workflow.kit.lens_record import read_record
from lensfit.workflow.kit.match import matches

Row = dict[str, Any]
_LENSES = (
    "Lens", "Verdict", "Accuracy", "Focal", "Breathing", "Distortion", "Colour",
    "Fall-off", "Blur, centre", "Blur, edge",
)  # fmt: skip
_ABOUT_LENSES = (
    "Accuracy: on points that the fit never saw, or the map's standard deviation in "
    "its worst photographed corner. Breathing: how much larger the lens draws at its "
    "nearest mark than at its farthest. Distortion and fall-off: in the frame's "
    "corner, focused farthest; fall-off in stops at each f-number. Colour: the most "
    "that red or blue is displaced. Blur: width of a point in focus, wide open."
)
_ABOUT_MATCH = (
    "Each lens against the median of its set; marked where the difference shows from "
    "shot to shot."
)
_ABOUT_SCALE = (
    "Where a mark really focuses, from the blur of the dots, besides what all marks of "
    "the lens have in common; marked where it is more than three standard deviations "
    "off."
)
_SIGNIFICANT = 3.0
_LEAST_RELATIVE = 0.01


def kit_page(table: Row) -> str:
    """The whole document.

    Parameters
    ----------
    table : As in kit.json.
    """
    lenses = table["lenses"]
    sections = [
        _again_section(lenses),
        _lenses_section(lenses),
        _match_section(table),
        _scale_section(lenses),
    ]
    main = tag("main", _header(table), *sections)
    return kit_document(f"{table['name']}: lens kit", main)


def must_be_shot_again(lens: Row) -> bool:
    """Whether a lens failed, or is not good for match-moving."""
    if lens["state"] == "failed":
        return True
    level = (lens.get("verdict") or {}).get("level")
    return level is not None and LEVELS.index(level) < LEVELS.index("match-moving")


def summary(lenses: Sequence[Row]) -> str:
    """The headline of a kit."""
    done = [lens for lens in lenses if lens["state"] == "done"]
    again = [lens for lens in lenses if must_be_shot_again(lens)]
    waiting = [lens for lens in lenses if lens["state"] == "waiting"]
    good = len(done) - sum(lens["state"] == "done" for lens in again)
    verb = "is" if good == 1 else "are"
    text = f"{good} of {_lens_count(lenses)} {verb} good for match-moving or better"
    if again:
        text += f"; look at {sentence_list([_title(lens) for lens in again])}"
    if waiting:
        text += f"; {len(waiting)} not calibrated yet"
    return text + "."


def _lens_count(lenses: Sequence[Row]) -> str:
    return "1 lens" if len(lenses) == 1 else f"{len(lenses)} lenses"


def _title(lens: Row) -> str:
    serial = lens.get("serial")
    return f"{lens['name']} s/n {serial}" if serial else str(lens["name"])


def _header(table: Row) -> Markup:
    lenses = table["lenses"]
    bad = any(must_be_shot_again(lens) for lens in lenses)
    waiting = any(lens["state"] == "waiting" for lens in lenses)
    tone = "caution" if bad else "note" if waiting else "good"
    model = (table.get("camera") or {}).get("model")
    facts = [_lens_count(lenses)]
    facts += [str(model)] if model else []
    links = [("again", "Shoot again")] if bad else []
    links += [("lenses", "Lenses")]
    links += [("match", "Match")] if table["sets"] else []
    links += [("scale", "Focus scale")] if _scales(lenses) else []
    return tag(
        "header",
        tag("p", "lensfit · lens kit", class_="eyebrow"),
        tag("h1", table["name"]),
        tag("p", " · ".join(facts), class_="facts"),
        tag("nav", *[tag("a", t, href=f"#{k}") for k, t in links], class_="nav"),
        tag(
            "div",
            tag("p", summary(lenses), class_="lead"),
            class_=f"verdict tone-{tone}",
            id="verdict",
        ),
    )


def _again_section(lenses: Sequence[Row]) -> Markup:
    items = []
    for lens in lenses:
        if not must_be_shot_again(lens):
            continue
        judged = lens.get("verdict") or {}
        why = lens["failed"] or judged.get("headline")
        tone = "bad" if lens["failed"] else judged.get("tone")
        remedy = judged.get("remedy")
        parts = [tag("b", _title(lens)), tag("span", why)]
        parts += [tag("span", f"Do: {remedy}", class_="remedy")] if remedy else []
        items.append(tag("li", *parts, class_=f"tone-{tone}"))
    if not items:
        return Markup("")
    title = tag("h2", "Shoot again, and why")
    return tag("section", title, tag("ul", *items, class_="again"), id="again")


def _lenses_section(lenses: Sequence[Row]) -> Markup:
    head = table_row("th", list(_LENSES), numeric=2)
    rows = [row for lens in lenses for row in _lens_rows(lens)]
    table = tag("table", tag("thead", head), tag("tbody", *rows), class_="kit")
    return tag(
        "section",
        tag("h2", "The lenses"),
        tag("p", _ABOUT_LENSES, class_="facts"),
        tag("div", table, class_="scroll"),
        id="lenses",
    )


def _lens_rows(lens: Row) -> list[Markup]:
    """One for each focal length; the name and verdict stand in the first."""
    name: Any = _title(lens)
    if lens.get("report"):
        name = tag("a", name, href=lens["report"])
    name = [name, tag("small", f"set {lens['lens_set']}") if lens["lens_set"] else None]
    judged = lens.get("verdict") or {}
    state = judged.get("level") or lens["state"]
    tone = judged.get("tone") or ("bad" if lens["failed"] else "note")
    badge = tag("span", state, class_=f"badge tone-{tone}")
    accuracy = number(judged.get("accuracy_px"), "px", 2)
    focals = lens.get("focal_lengths") or [
        {"focal_length_mm": one} for one in lens["focal_lengths_mm"]
    ]
    rows = []
    for k, focal in enumerate(focals):
        first = [name, badge, accuracy] if k == 0 else ["", "", ""]
        cells = [*first, *_figures(lens, focal)]
        marks = [tag("td", first[0], class_="lens"), tag("td", first[1])]
        marks += [tag("td", cell, class_="n") for cell in cells[2:]]
        rows.append(tag("tr", *marks))
    return rows


def _figures(lens: Row, focal: Row) -> list[Any]:
    at = focal["focal_length_mm"]
    widths = [w for w in lens.get("blur_widths") or [] if w["focal_length_mm"] == at]
    width = widths[0] if widths else {}
    falls = [
        tag("div", f"{number(one['corner_stops'], digits=2)} at f/{one['f_number']:g}")
        for one in focal.get("fall_off") or []
    ]
    return [
        stated_value(at, "mm"),
        signed_number(focal.get("breathing_percent"), "%"),
        signed_number(focal.get("distortion_percent"), "%"),
        number(focal.get("lateral_colour_px"), "px", 2),
        ([falls[0], falls[-1]] if len(falls) > 1 else falls) or NOTHING,
        number(width.get("centre_px"), "px", 2),
        number(width.get("edge_px"), "px", 2),
    ]


def signed_number(value: float | None, unit: str) -> str:
    """A number with its sign, or a dash."""
    if value is None:
        return NOTHING
    text = number(value, unit, 2)
    return f"+{text}" if value > 0 else text


def _match_section(table: Row) -> Markup:
    if not table["sets"]:
        return Markup("")
    titles = {lens["folder"]: _title(lens) for lens in table["lenses"]}
    blocks = [_match_block(one, titles) for one in table["sets"]]
    about = tag("p", _ABOUT_MATCH, class_="facts")
    title = tag("h2", "Match between lenses of a set")
    return tag("section", title, about, *blocks, id="match")


def _match_block(one: Row, titles: dict[str, str]) -> Markup:
    figures = one["figures"]
    places = list(
        dict.fromkeys(
            (v["folder"], v["focal_length_mm"]) for f in figures for v in f["values"]
        )
    )
    names = [f"{f['name']}, {f['unit']}" for f in figures]
    head = table_row("th", ["Lens", "Focal", *names], numeric=1)
    rows = []
    for folder, focal_mm in places:
        cells = [
            tag("td", titles[folder]),
            tag("td", stated_value(focal_mm, "mm"), class_="n"),
        ]
        cells += [_match_cell(f, folder, focal_mm) for f in figures]
        rows.append(tag("tr", *cells))
    for name, key in (("median", "median"), ("largest less smallest", "spread")):
        values = [number(f[key], digits=2) for f in figures]
        rows.append(table_row("td", [name, "", *values], numeric=1, class_="left"))
    body = tag("tbody", *rows)
    table = tag("table", tag("thead", head), body, class_="kit match")
    header = tag("header", tag("h3", one["lens_set"]))
    return tag("div", header, tag("div", table, class_="scroll"), class_="block")


def _match_cell(figure: Row, folder: str, focal_mm: float) -> Markup:
    for value in figure["values"]:
        if (value["folder"], value["focal_length_mm"]) == (folder, focal_mm):
            odd = value in figure["odd"]
            return tag(
                "td",
                tag(
                    "span", number(value["value"], digits=2), class_="odd" * odd or None
                ),
                class_="n",
            )
    return tag("td", NOTHING, class_="n")


def _scales(lenses: Sequence[Row]) -> list[Row]:
    return [lens for lens in lenses if lens.get("focus_scale")]


def _scale_section(lenses: Sequence[Row]) -> Markup:
    known = _scales(lenses)
    if not known:
        return Markup("")
    names = ["Lens", "Focal", "Engraved", "Engraved, metric", "Measured", "± 1σ"]
    head = table_row("th", [*names, "Image off by"], numeric=3)
    rows = [
        _scale_row(_title(lens) if k == 0 else "", one)
        for lens in known
        for k, one in enumerate(lens["focus_scale"])
    ]
    return tag(
        "section",
        tag("h2", "Focus scale, engraved against measured"),
        tag("p", _ABOUT_SCALE, class_="facts"),
        tag("div", tag("table", tag("thead", head), tag("tbody", *rows)),
            class_="scroll"),
        id="scale",
    )  # fmt: skip


def _scale_row(title: str, one: Row) -> Markup:
    engraved, measured, spread = (
        distance_of(one[key])
        for key in ("engraved_mm", "measured_mm", "standard_deviation_mm")
    )
    assert engraved is not None
    assert measured is not None
    assert spread is not None
    off_um = 1000 * one["off_mm"]
    wrong = abs(one["off_mm"]) > _SIGNIFICANT * one["off_deviation_mm"]
    wrong &= abs(measured - engraved) > _LEAST_RELATIVE * engraved
    text = tag("span", distance_text(measured), class_="odd" if wrong else None)
    cells = [title, stated_value(one["focal_length_mm"], "mm"), one["engraved"]]
    cells += [distance_text(engraved), text, distance_text(spread)]
    return table_row("td", [*cells, signed_number(off_um, "µm")], numeric=3)


TABLE, PAGE = "kit.json", "kit.html"


def write_kit(kit: Kit, out: Path) -> dict[str, Any]:
    """Write both files into the folder of results, and return what kit.json holds.

    Raises
    ------
    OutputError : They cannot be written.
    """
    table = kit_table(kit, out)
    write_text_atomic(out / TABLE, json.dumps(table, indent=1))
    write_text_atomic(out / PAGE, kit_page(table))
    return table


def kit_table(kit: Kit, out: Path) -> dict[str, Any]:
    """What became of every lens, and how lenses of a set match.

    Raises
    ------
    LensfitError : The plan cannot be made.
    """
    lenses = [_row(kit, folder, out / folder) for folder in kit.lenses]
    return {
        "schema": "lensfit.kit.1",
        "name": kit.name,
        "camera": {"model": kit.camera.model},
        "lenses": lenses,
        "sets": matches(lenses),
    }


def _row(kit: Kit, folder: str, results: Path) -> dict[str, Any]:
    lens, record = kit.lenses[folder], read_record(results)
    row: dict[str, Any] = {
        "folder": folder,
        "name": lens.name,
        "serial": lens.serial,
        "lens_set": lens.lens_set,
        "focal_lengths_mm": list(lens.focal_lengths_mm),
        "state": "waiting",
        "failed": None,
        "report": None,
    }
    if record is None:
        return row
    if record["failed"]:
        return row | {"state": "failed", "failed": record["failed"]}
    return row | {"state": "done", "report": f"{folder}/report.html"} | record["facts"]
