"""The report's section on blur: how well the dots' shape is explained, and the kernels.

As elsewhere in the report a part that is absent is left out; a report without blur has
no such section.
"""

from collections.abc import Mapping, Sequence
from typing import Any

from lensfit.report.blur_rules import targets_of
from lensfit.report.evidence import value_of
from lensfit.report.kernels import GAMMA, MOST_SHEETS, KernelSheet, KernelState
from lensfit.report.markup import (
    NOTHING,
    Markup,
    number,
    number_with_deviation,
    stated_value,
    tag,
)
from lensfit.report.pictures import ENLARGED, png_address
from lensfit.report.plain_numbers import distance_of
from lensfit.report.report_sections import (
    distance_text,
    stop_text,
    table_row,
    take_name,
)
from lensfit.report.through import ThroughSheet, through_figures

_ABOUT = (
    "Misfit is the error of the image of a target (a dot, a corner), relative (L2, "
    "median); if held out: what it would be had the fit not seen that photograph. "
    "Defocus is besides what all takes have in common; positive where the lens was "
    "focused nearer than the chart."
)
_KERNELS = (
    "Kernels: green, at the middle of the frame, half way and near its edge, as the "
    f"frame lies. Light to the power {GAMMA:g}, each tile against its own peak."
)
_EXPECTED = (
    "Expected error: of the shape of a whole kernel, a shift not counted, relative "
    "(L2), one standard deviation, from what the photographs leave open about the "
    "blur; at the middle of the frame and near its edges and corners, as it lies."
)
_TARGETS = (
    "{targets}: green. Top: the photograph, from the middle of the field (left) "
    "outward. Middle: the model. Bottom: the residual, {enlarged} times stronger "
    "about grey."
)


def blur_section(
    report: dict,
    pictures: Mapping[str, str | None],
    kernels: Sequence[KernelSheet],
    through: Sequence[ThroughSheet] = (),
) -> Markup:
    """Table of takes, kernels and dots of every focal length; nothing without blur.

    Parameters
    ----------
    report : the report's dictionary.
    pictures : ``data:`` address of each picture, by the path the report names.
    kernels : of all states, from `kernels.kernel_sheets`.
    through : of all focal lengths, from `through.through_sheets`.
    """
    blocks = [
        _block(one, report, pictures, kernels, through)
        for one in report.get("blur") or []
    ]
    if not blocks:
        return Markup("")
    about = [tag("p", _ABOUT, class_="facts")]
    if not kernels:
        missing = "No kernels are drawn: preset.json is not beside this report."
        about.append(tag("p", missing, class_="facts"))
    if len(kernels) == MOST_SHEETS:
        most = f"Kernels are drawn for the first {MOST_SHEETS} states only."
        about.append(tag("p", most, class_="facts"))
    return tag("section", tag("h2", "Blur"), *about, *blocks, id="blur")


def _block(
    blur: dict,
    report: dict,
    pictures: Mapping[str, str | None],
    kernels: Sequence[KernelSheet],
    through: Sequence[ThroughSheet],
) -> Markup:
    focal = blur.get("focal_length_mm")
    name = "Focal length not stated" if focal is None else stated_value(focal, "mm")
    known = {take.get("image"): take for take in report.get("takes") or []}
    takes = [known.get(one.get("image"), {}) | one for one in blur.get("takes") or []]
    header = tag("header", tag("h3", name), tag("p", _facts(blur), class_="facts"))
    parts = [header, _hardly_seen(blur), _table(blur, takes)]
    mine = [one for one in kernels if one.state.focal_length_mm == focal]
    parts += _states(mine, takes, pictures)
    for sheet in through:
        if sheet.focal_length_mm == focal:
            parts += through_figures(sheet)
    return tag("div", *parts, class_="block blur")


def _states(
    kernels: list[KernelSheet], takes: list[dict], pictures: Mapping[str, str | None]
) -> list[Markup]:
    """The kernels of each state beside the dots that were photographed in it."""
    left, rows = list(takes), []
    for sheet in kernels:
        here = [take for take in left if _is_of(take, sheet.state)]
        left = [take for take in left if take not in here]
        dots = [_dots_figure(take, pictures) for take in here]
        rows.append([_kernel_figure(sheet), *filter(None, dots)])
    rest = list(filter(None, [_dots_figure(take, pictures) for take in left]))
    rows += [rest] if rest else []
    shown = [tag("div", *row, class_="figures state") for row in rows]
    if not shown:
        return []
    targets = targets_of(takes)
    title = f"Point-spread functions over the frame, and the {targets} photographed"
    about = [tag("p", _KERNELS, class_="facts")] if kernels else []
    if any(sheet.expected_error is not None for sheet in kernels):
        about.append(tag("p", _EXPECTED, class_="facts"))
    if any(pictures.get(take.get("picture") or "") for take in takes):
        what = _TARGETS.format(targets=targets.capitalize(), enlarged=ENLARGED)
        about.append(tag("p", what, class_="facts"))
    return [tag("h4", title), *about, *shown]


def _is_of(take: dict, state: KernelState) -> bool:
    """Whether a take shows this state; one of unknown chart distance shows any."""
    focus, target = (
        distance_of(take.get(key))
        for key in ("focus_distance_mm", "target_distance_mm")
    )
    same = (
        take.get("f_number") or state.f_number
    ) == state.f_number and focus == state.focus_distance_mm
    return same and target in (None, state.object_distance_mm)


def _facts(blur: dict) -> str:
    side = "known" if blur.get("sign_known") else "not known"
    targets = targets_of(blur.get("takes") or [])
    facts = [f"side of focus {side}"]
    if blur.get("blades") is not None:
        count = blur["blades"]
        facts.append(f"{count} blades" if count else "pupil assumed to be round")
    if blur.get("held_out_misfit") is not None:
        facts.append(f"{_percent(blur['held_out_misfit'])} on {targets} held out")
    if blur.get("converged") is False:
        facts.append("did not converge")
    return " · ".join(facts)


def _hardly_seen(blur: dict) -> Markup:
    names = [str(name).replace("_", " ") for name in blur.get("not_seen") or []]
    if not names:
        return Markup("")
    text = (
        "Weakly determined by these photographs, so not to be relied on: "
        f"{', '.join(names)}."
    )
    return tag("p", text)


def _table(blur: dict, takes: list[dict]) -> Markup:
    names = ["Take", "Stop", "Focus", "Chart at", "Defocus ± 1σ"]
    names += [targets_of(takes).capitalize(), "Misfit", "If held out"]
    head = table_row("th", names, numeric=1)
    rows = [table_row("td", _row(blur, take), numeric=1) for take in takes]
    table = tag("table", tag("thead", head), tag("tbody", *rows), class_="takes")
    return tag("div", table, class_="scroll")


def _row(blur: dict, take: dict) -> list[Any]:
    return [
        take_name(take),
        stop_text(take),
        _distance(take.get("focus_distance_mm")),
        _distance(take.get("target_distance_mm")),
        _defocus(blur, take),
        number(take.get("dots")),
        _percent(take.get("misfit")),
        _percent(take.get("held_out_misfit")),
    ]


def _distance(plain_mm: float | str | None) -> str:
    distance = distance_of(plain_mm)
    return NOTHING if distance is None else distance_text(distance)


def _percent(share: float | None) -> str:
    return number(None if share is None else 100.0 * share, "%", 2)


def _defocus(blur: dict, take: dict) -> str:
    """Of the group that the take belongs to: its own, or that of focus and chart; less
    what all takes have in common, where distances were stated."""
    state = [take.get(key) for key in ("focus_distance_mm", "target_distance_mm")]
    for group in blur.get("defocus") or []:
        shared = [group.get("focus_distance_mm"), group.get("target_distance_mm")]
        own = group.get("image") is not None and group["image"] == take.get("image")
        if own or (group.get("image") is None and shared == state):
            known = group.get("from_stated") or group
            value_um, deviation_um = (
                1000.0 * value_of(known.get(key))
                for key in ("defocus_mm", "standard_deviation_mm")
            )
            return number_with_deviation(value_um, deviation_um, "µm")
    return NOTHING


def _kernel_figure(sheet: KernelSheet) -> Markup:
    state = sheet.state
    title = stop_text({"f_number": state.f_number})
    if state.focus_distance_mm is not None:
        title += f", focused at {distance_text(state.focus_distance_mm)}"
    title += f", point at {distance_text(state.object_distance_mm)}"
    scale = f"A tile is {number(sheet.width_px, 'px')} wide, the bar "
    scale += f"{stated_value(sheet.bar_px, 'px')}."
    address = png_address(sheet.png)
    picture = tag("img", src=address, alt=f"Point-spread functions, {title}")
    caption = tag("figcaption", scale)
    parts = [tag("h5", title), picture, caption, _expected_errors(sheet)]
    return tag("figure", *parts, data_figure="kernels")


def _expected_errors(sheet: KernelSheet) -> Markup:
    """A small table that lies as the frame does; nothing if unknown."""
    if sheet.expected_error is None:
        return Markup("")
    rows = [
        tag("tr", *[tag("td", _percent(v)) for v in row])
        for row in sheet.expected_error
    ]
    about = tag("caption", "Expected error of a kernel, 1σ")
    return tag("table", about, tag("tbody", *rows), class_="expected")


def _dots_figure(take: dict, pictures: Mapping[str, str | None]) -> Markup:
    address = pictures.get(take.get("picture") or "")
    if address is None:
        return Markup("")
    title = take_name(take)
    picture = tag(
        "img", src=address, alt=f"{targets_of([take]).capitalize()} of {title}"
    )
    return tag("figure", tag("h5", title), picture, data_figure="dots")
