"""The page: whole without the network, honest about gaps, and alive in a browser."""

import copy
import re
from html.parser import HTMLParser
from pathlib import Path

import pytest
from report_samples import barrel_report, draw_overlays, entry, failed_take

from lensfit.errors import OutputError
from lensfit.report.heatmap import fall_off_surface
from lensfit.report.report_page import write_report

FIGURES = {
    "comparison": 1,
    "distortion-grid": 1,
    "radial-profile": 1,
    "lateral-colour": 1,
    "fall-off": 1,
    "fall-off-surface": 1,
    "uncertainty": 1,
    "coverage": 1,
    "common-residual": 1,
    "overlay": 2,
    "wipe": 2,
    "left": 2,
    "residual-arrows": 2,
    "residual-histogram": 2,
}


def written(report: dict, folder: Path, size_px: tuple[int, int] = (400, 300)) -> str:
    draw_overlays(report, folder, size_px)
    return write_report(report, folder).read_text(encoding="utf-8")


def figures_in(html: str) -> dict[str, int]:
    keys = re.findall(r'data-figure="([a-z-]+)"', html)
    return {key: keys.count(key) for key in keys}


class _Outline(HTMLParser):
    """Checks that elements nest, and gathers references and scripts."""

    def __init__(self):
        super().__init__()
        self.open: list[str] = []
        self.references: list[str] = []
        self.text: list[str] = []
        self.elements: list[str] = []

    def handle_starttag(self, tag, attrs):
        self.elements.append(tag)
        self.references += [
            v for k, v in attrs if k in ("src", "href", "data", "action")
        ]
        if tag not in ("img", "meta", "input"):
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.text.append(data)


def outline(html: str) -> _Outline:
    parser = _Outline()
    parser.feed(html)
    parser.close()
    assert parser.open == []
    return parser


def test_page_holds_every_figure_once(tmp_path):
    assert figures_in(written(barrel_report(2), tmp_path)) == FIGURES


def test_every_link_in_the_page_leads_somewhere(tmp_path):
    html = written(barrel_report(2), tmp_path)
    links = {one[1:] for one in outline(html).references if one.startswith("#")}
    assert {"take-1", "take-2", "lens", "terms"} <= links
    assert links <= set(re.findall(r' id="([^"]+)"', html))


def test_nothing_in_the_page_points_outside_it(tmp_path):
    html = written(barrel_report(2), tmp_path)
    references = outline(html).references
    assert references
    assert all(one.startswith(("#", "data:image/")) for one in references)
    assert not re.search(r"https?://|@import|url\(", html)
    assert "default-src &#x27;none&#x27;" in html


def test_every_user_string_is_escaped(tmp_path):
    """The same hostile text in every field adds text to the page, never an element."""
    clean = barrel_report(2)
    plain = outline(written(clean, tmp_path)).elements
    hostile = '"><script>alert(1)</script><img src=x onerror=alert(2)>'

    def poison(value, key=""):
        if isinstance(value, dict):
            return {k: poison(v, k) for k, v in value.items()}
        if isinstance(value, list):
            return [poison(one, key) for one in value]
        if isinstance(value, str) and key != "overlay":
            return value + hostile
        return value

    page = outline(written(poison(clean), tmp_path))
    assert page.elements == plain
    assert sum(hostile in text for text in page.text) > 10


OF_TAKES = {"overlay", "wipe", "left", "residual-arrows", "residual-histogram"}
OF_ENTRIES = {
    "distortion-grid",
    "radial-profile",
    "lateral-colour",
    "fall-off",
    "fall-off-surface",
    "uncertainty",
}
OF_THE_FRAME = {"coverage", "common-residual"}
LOST_WITH = {
    "camera": OF_THE_FRAME | {"fall-off-surface"},
    "comparison": {"comparison"},
    "entries": OF_ENTRIES,
    "takes": OF_TAKES | OF_THE_FRAME,
}
"""Figures that cannot be drawn without a part of the report."""


def lost_from(html: str) -> set[str]:
    outline(html)
    return set(FIGURES) - set(figures_in(html))


@pytest.mark.parametrize("key", sorted(barrel_report(1)))
def test_without_any_part_all_other_figures_are_there(tmp_path, key):
    for gap in ("absent", "null"):
        report = barrel_report(1)
        report.pop(key) if gap == "absent" else report.update({key: None})
        html = (
            written(report, tmp_path) if key != "takes" else page_of(report, tmp_path)
        )
        assert lost_from(html) == LOST_WITH.get(key, set())


def page_of(report: dict, folder: Path) -> str:
    return write_report(report, folder).read_text(encoding="utf-8")


@pytest.mark.parametrize("part", ["entries", "takes", "terms", "blur"])
def test_without_any_key_of_a_part_only_figures_of_the_part_are_lost(tmp_path, part):
    for key in barrel_report(1)[part][0]:
        report = barrel_report(1)
        del report[part][0][key]
        lost = lost_from(written(report, tmp_path))
        assert lost <= LOST_WITH.get(part, set()), key
        report = barrel_report(1)
        report[part][0][key] = None
        assert lost_from(written(report, tmp_path)) == lost, key


def test_an_empty_report_is_still_a_page(tmp_path):
    assert "Unnamed lens" in page_of({}, tmp_path)


def test_undefined_numbers_are_gaps_not_words(tmp_path):
    report = barrel_report(1)
    lens = report["entries"][0]
    lens["distortion_grid"]["dx_mm"][0][0] = None
    lens["uncertainty_grid"]["sd_px"][0] = [None] * 25
    lens["radial_profile"]["distortion_percent"][-1] = float("nan")
    lens["focus_distance_mm"] = float("inf")
    report["takes"][0]["residuals"]["dx_px"][3] = None
    html = written(report, tmp_path)
    picture = re.sub(r"base64,[A-Za-z0-9+/=]+", "", html)
    assert not re.search(r"\b(nan|None|null|inf)\b", "".join(outline(picture).text[3:]))
    assert not re.search(r' d="[^"]*nan', picture)
    assert figures_in(html)["uncertainty"] == 1
    assert "focused at ∞" in html


def test_failed_take_is_shown_with_its_reason(tmp_path):
    report = barrel_report(2)
    report["takes"].append(failed_take("tilt", "no dots: over-exposed"))
    html = written(report, tmp_path)
    assert html.count("no dots: over-exposed") == 3  # verdict, table, its own block
    assert "2 of 3" in html


def test_a_lost_overlay_is_said_to_be_lost(tmp_path):
    html = page_of(barrel_report(1), tmp_path)
    assert "overlays/take_1.png could not be read" in html
    assert "overlay" not in figures_in(html)


def test_pictures_of_the_model_that_are_lost_leave_no_wipe(tmp_path):
    report = barrel_report(2)
    draw_overlays(report, tmp_path, (400, 300))
    (tmp_path / "model/take_2_left.jpg").unlink()
    html = page_of(report, tmp_path)
    assert figures_in(html)["wipe"] == figures_in(html)["left"] == 1
    (tmp_path / "model/take_1_model.jpg").write_bytes(b"no picture")
    assert "wipe" not in figures_in(page_of(report, tmp_path))


def test_a_picture_that_could_not_be_drawn_says_why(tmp_path):
    report = barrel_report(2)
    report["takes"][0]["modelled"] = {"failed": "singular <matrix>"}
    html = written(report, tmp_path)
    assert "could not be drawn: singular &lt;matrix&gt;" in html
    assert figures_in(html)["wipe"] == 1


def test_what_the_model_explains_is_never_rounded_to_all_of_it(tmp_path):
    report = barrel_report(1)
    report["takes"][0]["modelled"]["explained"] = 0.99982
    assert "explains 99.98% of" in written(report, tmp_path)


def test_zoom_has_figures_for_each_entry(tmp_path):
    report = barrel_report(2)
    report["entries"].append(entry(85.0, float("inf")))
    report["takes"][1]["focal_length_mm"] = 85.0
    shown = figures_in(written(report, tmp_path))
    assert shown["distortion-grid"] == shown["uncertainty"] == shown["coverage"] == 2


def test_same_report_gives_the_same_bytes(tmp_path):
    report = barrel_report(2)
    first = written(report, tmp_path)
    again = written(copy.deepcopy(report), tmp_path / "other")
    assert first == again


def test_big_overlays_are_shrunk_to_the_budget(tmp_path):
    report = barrel_report(3)
    html = written(report, tmp_path, size_px=(3000, 2000))
    assert len(html) < 2_800_000
    assert figures_in(html)["overlay"] == 3


def test_small_distortion_is_enlarged_and_said_to_be(tmp_path):
    report = barrel_report(1)
    grid = report["entries"][0]["distortion_grid"]
    for key in ("dx_mm", "dy_mm"):
        grid[key] = [[0.01 * value for value in row] for row in grid[key]]
    assert "times too strong" in written(report, tmp_path)
    assert "true to scale" in written(barrel_report(1), tmp_path)


def test_fall_off_on_paper_is_said_to_be_of_the_lighting_too(tmp_path):
    report = barrel_report(1)
    words = "lens and lighting together"
    assert words not in written(report, tmp_path)
    for curve in report["entries"][0]["fall_off"]:
        curve["lighting_too"] = True
    page = written(report, tmp_path)
    assert page.count(words) == 3, "in the verdict and under both figures"


def test_no_light_lost_is_nought_without_a_sign(tmp_path):
    report = barrel_report(1)
    for curve in report["entries"][0]["fall_off"]:
        curve["g"] = [1.00001] * len(curve["g"])
    page = written(report, tmp_path)
    assert "f/1.4 0.00 stops" in page
    assert "-0.00" not in page


def test_light_lost_at_the_centre_is_nought_and_no_power_of_ten():
    """The principal point is hardly beside the middle; hardly anything is lost."""
    report = barrel_report(1)
    state = report["entries"][0] | {"principal_point_mm": [0.001, 0.0]}
    figure = fall_off_surface(state, report["camera"])
    assert figure is not None
    shown = re.findall(r">([^<>]+)</text>", figure.svg)
    assert shown.count("0") == 2, "in the middle of the frame and under its key"
    assert not any("10⁻" in text for text in shown)


def test_page_that_cannot_be_written_is_one_sentence(tmp_path):
    (tmp_path / "report.html").mkdir()
    with pytest.raises(OutputError, match=r"report\.html"):
        write_report(barrel_report(1), tmp_path)


def test_the_time_it_took_is_the_whole_not_the_sum_of_parts_that_overlap(tmp_path):
    report = barrel_report()
    assert sum(report["seconds"].values()) != report["seconds"]["whole"]
    assert f"{report['seconds']['whole']:.3g}\u202fs" in written(report, tmp_path)
