"""The report of a folder of results: its JSON, read without trust, and its page.

One HTML file without any outside resource: style sheet and script are inlined, figures
are SVG, pictures are ``data:`` addresses, and a content security policy forbids the
rest. `page` is a pure function of its arguments: the same report gives the same bytes.

The page is made of the report dictionary (schema ``lensfit.report.2``) alone, with the
pictures that it names relative to the folder of results and, for the point-spread
functions, the preset there. A missing picture is reported as missing; nothing else in
the page can fail to load, as nothing is outside the file.

Reports of older schemas are read too.
"""

import math
from collections.abc import Mapping, Sequence
from importlib.resources import files
from pathlib import Path
from typing import Any

from lensfit._strict import read_json_object
from lensfit.atomic import write_text_atomic
from lensfit.errors import LensfitError
from lensfit.preset.store import with_pupil_shift, with_renamed_keys
from lensfit.report.blur import blur_section
from lensfit.report.evidence import corner_deviation_px, numbers, used_takes, value_of
from lensfit.report.kernels import KernelSheet, kernel_sheets
from lensfit.report.markup import Markup, html_document, number, tag
from lensfit.report.pictures import data_addresses, jpeg_address
from lensfit.report.report_sections import (
    coverage_section,
    lens_section,
    takes_section,
    terms_section,
)
from lensfit.report.through import ThroughSheet, through_sheets
from lensfit.report.verdict import verdict_of, verdict_scope
from lensfit.report.wipe import MODEL_PICTURES

_POLICY = "default-src 'none'; img-src data:; style-src 'unsafe-inline'; "
_POLICY += "script-src 'unsafe-inline'"
_SIGNS = {"good": "✓", "note": "·", "caution": "!", "bad": "✕"}


def page(
    report: dict,
    pictures: Mapping[str, str | None],
    kernels: Sequence[KernelSheet] = (),
    through: Sequence[ThroughSheet] = (),
) -> str:
    """The whole report as one HTML document.

    Parameters
    ----------
    report : what ``calibrate`` writes as ``report.json``; optional keys may be absent.
    pictures : ``data:`` address of each picture, by the path that the report names.
    kernels, through : point-spread functions of the states, and through focus and
        aperture, where the preset is at hand.
    """
    sections = [
        numbers_section(report),
        lens_section(report),
        blur_section(report, pictures, kernels, through),
        coverage_section(report),
        takes_section(report, pictures),
        terms_section(report),
        provenance_section(report),
    ]
    main = tag("main", _header(report), *sections, _footer(report))
    title = f"{_lens_name(report)}: lens report"
    body = main, _dialog(), _script()
    return html_document(title, _POLICY, style_sheet(), *body)


def numbers_section(report: dict) -> Markup:
    """The key numbers as cards, and the peers' error beside ours."""
    cards = [
        tag("div", tag("b", value), tag("span", meaning), class_="card")
        for value, meaning in _key_numbers(report)
    ]
    parts = [tag("h2", "Key numbers"), tag("div", *cards, class_="cards")]
    return tag("section", *parts, _comparison(report), id="numbers")


def provenance_section(report: dict) -> Markup:
    """Files, versions, notes and where the time went."""
    parts = [tag("h2", "Where this came from"), _facts_list(report)]
    notes = [tag("li", note) for note in report.get("notes") or []]
    parts += [tag("h3", "Notes"), tag("ul", *notes)] if notes else []
    seconds = {k: v for k, v in (report.get("seconds") or {}).items() if v is not None}
    if seconds:
        parts.append(tag("h3", "Time spent"))
        rows = [
            (name, value, f"{value:.2f}\u202fs", "") for name, value in seconds.items()
        ]
        parts.append(_bars(rows))
    return tag("section", *parts, id="provenance")


def style_sheet() -> str:
    """Of figures and of pages like the report."""
    return _resource("figures.css") + _resource("report.css")


def _resource(name: str) -> str:
    return files("lensfit.report").joinpath(name).read_text(encoding="utf-8")


def _dialog() -> Markup:
    close = tag("button", "×", type="button", aria_label="Close")
    stage = tag("div", tag("img", alt=""), class_="stage")
    return tag("dialog", close, stage, aria_label="Enlarged picture")


def _script() -> Markup:
    return tag("script", Markup(_resource("report.js")))


def _lens_name(report: dict) -> str:
    return str((report.get("lens") or {}).get("name") or "Unnamed lens")


def _header(report: dict) -> Markup:
    lens, camera = report.get("lens") or {}, report.get("camera") or {}
    facts = [f"serial {lens['serial']}"] if lens.get("serial") else []
    facts += [str(camera["model"])] if camera.get("model") else []
    facts += _size_facts(camera)
    facts += [_date(report)] if report.get("created") else []
    links = [
        tag("a", name, href=f"#{key}")
        for key, name in (
            ("numbers", "Numbers"), ("lens", "Lens"), ("blur", "Blur"),
            ("evidence", "Evidence"),
            ("takes", "Takes"), ("terms", "Terms"), ("provenance", "Provenance"),
        )
        if key != "blur" or report.get("blur")
    ]  # fmt: skip
    return tag(
        "header",
        tag("p", "lensfit · lens report", class_="eyebrow"),
        tag("h1", _lens_name(report)),
        tag("p", " · ".join(facts), class_="facts"),
        tag("nav", *links, class_="nav"),
        _verdict(report),
    )


def _size_facts(camera: dict) -> list[str]:
    facts = []
    width, height = camera.get("sensor_width_mm"), camera.get("sensor_height_mm")
    if width and height:
        facts.append(f"{number(width, digits=4)} × {number(height, 'mm', 4)}")
    across, down = camera.get("image_width_px"), camera.get("image_height_px")
    if across and down:
        facts.append(f"{across} × {down} px")
    return facts


def _date(report: dict) -> str:
    return str(report["created"]).replace("T", " ")[:16]


def _verdict(report: dict) -> Markup:
    judged = verdict_of(report)
    first, *rest = judged.reasons
    items = [
        tag("li", one.text, class_=f"tone-{one.tone}", data_sign=_SIGNS[one.tone])
        for one in rest
    ]
    lead = tag("p", first.text, class_="lead")
    scope = tag("p", verdict_scope(judged), class_="scope")
    body = tag("ul", *items) if items else None
    return tag(
        "div",
        lead,
        scope,
        body,
        class_=f"verdict tone-{first.tone}",
        id="verdict",
        data_level=judged.level,
    )


def _key_numbers(report: dict) -> list[tuple[str, str]]:
    entries, takes = report.get("entries") or [], report.get("takes") or []
    corner = _largest([corner_deviation_px(entry) for entry in entries])
    cards = [
        (
            number(report.get("held_out_rms_px"), "px"),
            "rms on points held out of the fit",
        ),
        (number(report.get("rms_px"), "px"), "rms on the fitted points"),
        (number(corner, "px", 2), "1σ of the map in its worst corner"),
        (_strongest(entries), "distortion where it is strongest"),
        (
            number(report.get("points_used")),
            f"points used of {number(report.get('points_detected'))} found",
        ),
        (f"{len(used_takes(report))} of {len(takes)}", "takes used"),
    ]
    overscan = _largest([value_of(entry.get("overscan_percent")) for entry in entries])
    cards.append((number(overscan, "%", 4), "overscan that the CG needs"))
    # Parts overlap: photographs are searched side by side, and `fit` holds its stages.
    whole = (report.get("seconds") or {}).get("whole")
    if whole is not None:
        cards.append((number(float(whole), "s"), "from photographs to preset"))
    return cards


def _largest(values: list[float]) -> float:
    return max((value for value in values if not math.isnan(value)), default=math.nan)


def _strongest(entries: list[dict]) -> str:
    profiles = [(entry.get("radial_profile") or {}) for entry in entries]
    percents = [p for one in profiles for p in numbers(one.get("distortion_percent"))]
    known = [float(p) for p in percents if math.isfinite(p)]
    return number(max(known, key=abs) if known else None, "%")


def _comparison(report: dict) -> Markup:
    comparison = report.get("comparison") or {}
    rows = [("lensfit", report.get("held_out_rms_px"), "")]
    for count in (5, 14):
        value = comparison.get(f"opencv_{count}_held_out_px")
        rows.append((f"OpenCV, {count} parameters", value, "peer"))
    known = [(n, float(v), number(v, "px"), c) for n, v, c in rows if v is not None]
    if len(known) < 2:
        return Markup("")
    title = tag("h4", "Rms on held-out points, the same points for all")
    return tag(
        "figure", title, _bars(known), data_figure="comparison", style="margin-top:28px"
    )


def _bars(rows: list[tuple[str, float, str, str]]) -> Markup:
    largest = max(value for _, value, _, _ in rows) or 1.0
    cells = []
    for name, value, text, class_ in rows:
        fill = tag(
            "i", class_=class_ or None, style=f"width:{100 * value / largest:.1f}%"
        )
        cells += [tag("span", name), tag("div", fill, class_="bar"), tag("span", text)]
    return tag("div", *cells, class_="bars")


def _facts_list(report: dict) -> Markup:
    rows: list[tuple[str, Any]] = [("made", report.get("created"))]
    rows.append(("schema", report.get("schema")))
    rows += list((report.get("versions") or {}).items())
    for kind, names in (report.get("files") or {}).items():
        listed = names if isinstance(names, list | tuple) else [names]
        rows.append((kind, [tag("div", tag("code", name)) for name in listed]))
    pairs = [(tag("dt", k), tag("dd", v)) for k, v in rows if v is not None]
    return tag("dl", *pairs)


def _footer(report: dict) -> Markup:
    version = (report.get("versions") or {}).get("lensfit")
    text = "Made by lensfit" + (f" {version}" if version else "")
    text += (
        ". Pixels count from the outer corner of the top left one; millimetres from "
    )
    text += "the sensor's centre, x right, y down. σ is one standard deviation."
    return tag("footer", text)


SCHEMA = "lensfit.report.2"
_KEYS_OF_1 = {"guessed": "extrapolated"}
_TEXTS_OF_1 = {
    "usual_pupil_walk": "usual_pupil_shift",
    "pupil_walk_at_other_focus": "pupil_shift_at_other_focus",
}


def read_report(path: Path) -> dict[str, Any]:
    """The tables of a report.

    Raises
    ------
    LensfitError : There is none, or it is something else.
    """
    tables = read_json_object(
        path,
        error=LensfitError,
        source='give the folder that "lensfit calibrate" wrote',
        mend="calibrate again",
    )
    if not str(tables.get("schema")).startswith("lensfit.report."):
        raise LensfitError(
            "is JSON but no report of lensfit",
            where=path,
            remedy='give the report.json that "lensfit calibrate" wrote',
        )
    if tables["schema"] == "lensfit.report.1":
        words = with_renamed_keys(with_pupil_shift(tables), _KEYS_OF_1, _TEXTS_OF_1)
        return words | {"schema": SCHEMA}
    return tables


def write_report(report: dict, out_dir: Path) -> Path:
    """Write the self-contained page of a calibration.

    Parameters
    ----------
    report : what ``calibrate`` writes as ``report.json``.
    out_dir : the folder of results; paths in the report start from it.

    Returns
    -------
    Path of the page, ``out_dir/report.html``.
    """
    takes = report.get("takes") or []
    blurred = [t for blur in report.get("blur") or [] for t in blur.get("takes") or []]
    addresses = _addresses([take.get("overlay") for take in takes], out_dir)
    addresses |= _addresses([take.get("picture") for take in blurred], out_dir)
    for said in [take.get("modelled") or {} for take in takes]:
        names = [said.get(key) for key in MODEL_PICTURES]
        named = [name for name in names if name and is_inside(out_dir, name)]
        addresses |= {name: jpeg_address(out_dir / name) for name in named}
    preset = out_dir / "preset.json"
    kernels, through = kernel_sheets(report, preset), through_sheets(report, preset)
    text = page(report, addresses, kernels, through)
    target = out_dir / "report.html"
    write_text_atomic(target, text)
    return target


def is_inside(folder: Path, name: str) -> bool:
    """Whether a report that came from elsewhere names a picture of its own folder."""
    try:
        return (folder / name).resolve().is_relative_to(folder.resolve())
    except (OSError, ValueError):
        return False


def _addresses(names: list[str | None], out_dir: Path) -> dict[str, str | None]:
    named = [name for name in names if name and is_inside(out_dir, name)]
    found = data_addresses([out_dir / name for name in named])
    return dict(zip(named, found, strict=True))
