"""The take list of a kit on paper: a page for each lens, a box for each view.

One HTML file without any outside resource, made to be printed.
"""

from importlib.resources import files

from lensfit.report.markup import NOTHING, Markup, html_document, stated_value, tag
from lensfit.report.report_page import style_sheet
from lensfit.report.report_sections import distance_text, table_row
from lensfit.workflow.kit.kit_file import Kit
from lensfit.workflow.kit.kit_plan import TILT_DEG, KitView, LensPlan

_POLICY = "default-src 'none'; style-src 'unsafe-inline'"
_COLUMNS = (
    "", "Slate", "Focal", "Stop", "Focus mark", "Chart", "Shutter", "Light", "Blur",
    "Remarks",
)  # fmt: skip
_BOX = "☐"


def checklist(kit: Kit, plans: list[LensPlan]) -> str:
    """The whole document.

    Parameters
    ----------
    plans : Of the lenses to shoot, in order.
    """
    sheets = [_sheet(kit, plan, k, len(plans)) for k, plan in enumerate(plans, 1)]
    main = tag("main", _header(kit, plans), *sheets)
    return kit_document(f"{kit.name}: take list", main)


def kit_document(title: str, main: Markup) -> str:
    """A page of a kit, in the style of reports and what a kit's pages add to it."""
    kit = files("lensfit.workflow.kit").joinpath("kit.css")
    style = style_sheet() + kit.read_text(encoding="utf-8")
    return html_document(title, _POLICY, style, main, class_="sheets")


def duration_text(seconds: float) -> str:
    """Hours and minutes."""
    minutes = max(1, round(seconds / 60))
    hours, rest = divmod(minutes, 60)
    return f"{hours} h {rest:02d} min" if hours else f"{rest} min"


def shutter_text(seconds: float | None) -> str:
    """As a camera has it: 1/48 s, 2.5 s."""
    if seconds is None:
        return NOTHING
    return f"1/{1 / seconds:.0f}\u202fs" if seconds < 0.3 else f"{seconds:.1f}\u202fs"


def chart_text(view: KitView) -> str:
    """How the chart stands."""
    if view.tilted is None:
        return "square"
    return f"tilted {TILT_DEG:.0f}° {view.tilted}"


def _header(kit: Kit, plans: list[LensPlan]) -> Markup:
    views = sum(len(plan.views) for plan in plans)
    time = duration_text(sum(plan.seconds for plan in plans))
    facts = [f"{len(plans)} lenses", f"{views} views", f"about {time}"]
    if kit.exposure is not None:
        metered = f"metered {shutter_text(kit.exposure.shutter_s)}"
        metered += f" at f/{kit.exposure.f_number:g}"
        iso = kit.exposure.iso
        facts.append(metered if iso is None else f"{metered}, ISO {iso:g}")
    return tag(
        "header",
        tag("p", "lensfit · take list", class_="eyebrow"),
        tag("h1", kit.name),
        tag("p", " · ".join(facts), class_="facts"),
    )


def _sheet(kit: Kit, plan: LensPlan, number_of: int, count: int) -> Markup:
    lens = plan.lens
    distances = dict.fromkeys(distance_text(one) for one in plan.target_distance_mm)
    facts = [
        f"lens {number_of} of {count}",
        *([f"set {lens.lens_set}"] if lens.lens_set else []),
        f"chart “{plan.target}” at {', '.join(distances)} from the sensor",
        f"{len(plan.views)} views",
        f"about {duration_text(plan.seconds)}",
        f"folder {plan.folder}",
    ]
    head = table_row("th", list(_COLUMNS), numeric=99)
    rows = [table_row("td", _row(view)) for view in plan.views]
    return tag(
        "section",
        tag("h2", lens.title),
        tag("p", " · ".join(facts), class_="facts"),
        *[tag("p", note, class_="warning") for note in plan.notes],
        tag("table", tag("thead", head), tag("tbody", *rows), class_="checklist"),
        class_="sheet",
    )


def _row(view: KitView) -> list[object]:
    stops = round(view.exposure_stops, 1)
    light = f"{stops:+.1f} stops".replace("-", "−") if stops else "as first"
    blur = NOTHING if view.blur_px is None else f"{view.blur_px:.1f}\u202fpx"
    return [
        tag("span", _BOX, class_="box"),
        tag("code", view.slate),
        stated_value(view.focal_length_mm, "mm"),
        f"f/{view.f_number:g}",
        view.mark,
        chart_text(view),
        shutter_text(view.shutter_s),
        light,
        f"{blur}, overlapping" if view.overlapping else blur,
        "",
    ]
