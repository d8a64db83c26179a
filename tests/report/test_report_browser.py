"""The page in a browser: alive, offline, readable on a tablet, on paper, and without a
script. Skipped where there is no Chromium."""

from collections.abc import Iterator
from pathlib import Path

import pytest
from browser import CHROMIUM, Browser
from report_samples import barrel_report, draw_overlays

from lensfit.report.report_page import write_report

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="no chromium on this machine")

TAKES = 2
SECTIONS = ["numbers", "lens", "blur", "evidence", "takes", "terms", "provenance"]
CLIP = "getComputedStyle(document.querySelector('.shot.model')).clipPath"
SLIDER = "document.querySelector('.wipe input')"


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("report")
    report = barrel_report(TAKES)
    draw_overlays(report, folder, (1400, 1050))
    return write_report(report, folder)


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    with Browser(tmp_path_factory.mktemp("profile")) as started:
        yield started


@pytest.fixture
def opened(browser: Browser, page: Path) -> Browser:
    browser.complaints.clear()
    browser.requests.clear()
    browser.open(page)
    return browser


def test_everything_is_there_and_nothing_is_asked_for(opened: Browser, page: Path):
    sizes = opened.run(
        """Object.fromEntries([...document.querySelectorAll("section[id]")].map(
            (one) => [one.id, one.getBoundingClientRect().height]))"""
    )
    assert list(sizes) == SECTIONS
    assert all(height > 60 for height in sizes.values())
    small = opened.run(
        """[...document.querySelectorAll("[data-figure]")].filter(
            (one) => one.getBoundingClientRect().height < 60).length"""
    )
    assert small == 0
    loaded = opened.run(
        """[...document.querySelectorAll("img[src]")].every(
            (one) => one.complete && one.naturalWidth > 0)"""
    )
    assert loaded
    assert set(opened.requests) == {page.as_uri()}
    assert opened.complaints == []


def test_the_slider_wipes_by_value_by_key_and_by_finger(opened: Browser):
    assert opened.run(CLIP) == "inset(0px 0px 0px 50%)"
    opened.run(f"{SLIDER}.value = 20, {SLIDER}.dispatchEvent(new Event('input'))")
    assert opened.run(CLIP) == "inset(0px 0px 0px 20%)"
    opened.run(f"{SLIDER}.focus()")
    opened.press("ArrowRight")
    assert opened.run(CLIP) == "inset(0px 0px 0px 21%)"
    opened.press("End")
    assert opened.run(CLIP) == "inset(0px 0px 0px 100%)"
    box = opened.run(
        """(() => { const stage = document.querySelector(".stage");
            stage.scrollIntoView({behavior: "instant", block: "center"});
            const box = stage.getBoundingClientRect();
            return [box.left, box.top, box.width, box.height]; })()"""
    )
    x, y = box[0] + 0.75 * box[2], box[1] + box[3] / 2
    for kind in ("mousePressed", "mouseReleased"):
        opened.send(
            "Input.dispatchMouseEvent", type=kind, x=x, y=y, button="left", clickCount=1
        )
    assert opened.run(CLIP) == "inset(0px 0px 0px 75%)"
    others = opened.run("document.querySelectorAll('.wipe input')[1].value")
    assert others == "50"
    assert opened.complaints == []


def test_the_model_lies_on_the_photograph_also_at_actual_size(opened: Browser):
    """Pixel on pixel, or the wipe would show a shift that is none."""
    boxes = """[...document.querySelectorAll(".wipe:first-child .shot img")]
        .slice(0, 2).map((one) => { const box = one.getBoundingClientRect();
            return [box.left, box.top, box.width, box.height]; })"""
    photograph, model = opened.run(boxes)
    assert photograph == model
    opened.run("document.querySelector('.wiper button').click()")
    photograph, model = opened.run(boxes)
    assert photograph == model
    assert photograph[2] == opened.run(
        "document.querySelector('.shot img').naturalWidth"
    )


def test_an_overlay_is_enlarged_and_closed_again(opened: Browser):
    opened.run("document.querySelector('button.zoom').click()")
    assert opened.run("document.querySelector('dialog').open")
    opened.run("document.querySelector('dialog button').click()")
    assert not opened.run("document.querySelector('dialog').open")


@pytest.mark.parametrize("width", [390, 820, 1400])
def test_nothing_sticks_out_sideways(browser: Browser, page: Path, width: int):
    browser.open(page, width, 1180)
    assert browser.run("document.documentElement.scrollWidth") <= width


def test_paper_gets_three_pictures_in_a_row_and_no_controls(opened: Browser):
    opened.send("Emulation.setEmulatedMedia", media="print")
    try:
        tops = opened.run(
            """[...document.querySelectorAll(".trio:first-of-type img")].slice(0, 3)
                .map((one) => Math.round(one.getBoundingClientRect().top))"""
        )
        lefts = opened.run(
            """[...document.querySelectorAll(".trio:first-of-type img")].slice(0, 3)
                .map((one) => one.getBoundingClientRect().left)"""
        )
        hidden = opened.run(
            "getComputedStyle(document.querySelector('.wiper')).display"
        )
        clip = opened.run(CLIP)
    finally:
        opened.send("Emulation.setEmulatedMedia", media="")
    assert len(tops) == 3
    assert max(tops) - min(tops) <= 2
    assert lefts == sorted(lefts)
    assert lefts[0] < lefts[1] < lefts[2]
    assert (hidden, clip) == ("none", "none")


def test_without_a_script_both_pictures_lie_side_by_side(browser: Browser, page: Path):
    browser.send("Emulation.setScriptExecutionDisabled", value=True)
    try:
        browser.open(page)
        document = browser.send("DOM.getDocument", depth=0)["root"]["nodeId"]
        found = browser.send(
            "DOM.querySelectorAll", nodeId=document, selector=".trio .shot img"
        )["nodeIds"]
        boxes = [
            browser.send("DOM.getBoxModel", nodeId=one)["model"] for one in found[:2]
        ]
    finally:
        browser.send("Emulation.setScriptExecutionDisabled", value=False)
    (left, right), widths = (
        [box["content"][0] for box in boxes],
        [box["width"] for box in boxes],
    )
    assert right >= left + widths[0]
    assert min(widths) > 200
