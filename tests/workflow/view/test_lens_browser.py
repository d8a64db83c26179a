"""The page of a lens in a browser: its point is dragged, and moved by key."""

from collections.abc import Iterator
from pathlib import Path

import pytest
from browser import Browser
from view_makers import (
    IN_BROWSER,
    UNNAMED,
    Client,
    box_of,
    enter,
    mouse,
    page_in_browser,
    served,
    until,
)

from lensfit.preset.store import load_preset
from lensfit.workflow.view.lens_adjustments import LensAdjustments
from lensfit.workflow.view.lens_server import LensServer
from lensfit.workflow.view.viewed_lens import ViewedLens

pytestmark = IN_BROWSER
PRESETS = Path(__file__).parents[3] / "presets"
SPOT = "document.querySelector('.spot').src"
ALERT = "document.querySelector('.column .alert')"
DRAWN = """['point', 'field', 'through', 'figures'].every((name) =>
    document.querySelector('.column')?.dataset[name] !== undefined)"""


@pytest.fixture(scope="module")
def client() -> Iterator[Client]:
    prime = load_preset(PRESETS / "prime_50" / "preset.json")
    with served(LensServer([ViewedLens(prime, "prime", LensAdjustments())])) as asked:
        yield asked


@pytest.fixture(scope="module")
def opened(
    client: Client, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[Browser]:
    profile = tmp_path_factory.mktemp("profile")
    with page_in_browser(client, profile, DRAWN) as browser:
        yield browser


def value(browser: Browser, name: str) -> float:
    return float(browser.run(f"document.getElementById('k-{name}').value"))


def test_the_point_is_dragged_and_moved_by_key(opened: Browser, client: Client):
    before = opened.run(SPOT)
    left, top, width, height = box_of(opened, ".field")
    mouse(opened, "Pressed", left + 0.5 * width, top + 0.5 * height)
    mouse(opened, "Moved", left + 0.7 * width, top + 0.3 * height)
    mouse(opened, "Released", left + 0.7 * width, top + 0.3 * height)
    # Tiles at 0.45 and 0.9 of the way lie a fifth and a third of the sheet off.
    assert value(opened, "x") == pytest.approx(0.45, abs=0.02)
    assert value(opened, "y") == pytest.approx(-0.54, abs=0.02)
    until(opened, f"{SPOT} !== {before!r}", True)
    opened.press("ArrowLeft")
    assert value(opened, "x") == pytest.approx(0.4, abs=0.02)
    said = client.post("point", x=value(opened, "x"), y=value(opened, "y")).json()
    until(opened, f"{SPOT} === {said['picture']!r}", True)


def test_a_turned_lens_is_drawn_and_reset(opened: Browser, client: Client):
    number = "document.getElementById('k-f_number')"
    enter(opened, number, 8)
    x, y = value(opened, "x"), value(opened, "y")
    said = client.post("point", f_number=8, x=x, y=y).json()["picture"]
    until(opened, f"{SPOT} === {said!r}", True)
    opened.run("document.getElementById('reset').click()")
    said = client.post("point").json()["picture"]
    until(opened, f"{SPOT} === {said!r}", True)
    assert opened.run("document.querySelectorAll('.drawn svg').length") == 7


def test_it_is_said_what_is_computed(opened: Browser):
    number = "document.getElementById('k-f_number')"
    working = "document.querySelector('.working').textContent"
    entered = f"{number}.value = 5.6, {number}.dispatchEvent(new Event('change'))"
    assert opened.run(f"{entered}, {working}") == (
        "Computing the point, the field, through focus and aperture, the curves …"
    )
    until(opened, working, "")


def test_drawings_come_though_the_point_is_moved_meanwhile(opened: Browser):
    number = "document.getElementById('k-f_number')"
    curves = "document.querySelector('.column').dataset.figures"
    before = opened.run(curves)
    opened.run(
        f"""{number}.value = 4, {number}.dispatchEvent(new Event('change')),
        document.querySelector('.handle').dispatchEvent(
            new KeyboardEvent('keydown', {{ key: 'ArrowLeft' }}))"""
    )
    until(opened, "document.querySelector('.working').textContent", "")
    assert opened.run(curves) != before


OVERPRINTED = """[...document.querySelectorAll(".drawn svg")].flatMap((svg) => {
    const frame = svg.getBoundingClientRect();
    const letters = [...svg.querySelectorAll("text")];
    const boxes = letters.map((one) => [one.textContent, one.getBoundingClientRect()]);
    const outside = boxes.filter(([, box]) => box.left < frame.left - 1
        || box.right > frame.right + 1 || box.bottom > frame.bottom + 1);
    const pairs = boxes.flatMap(([one, a], k) => boxes.slice(k + 1).filter(([, b]) =>
        Math.min(a.right, b.right) - Math.max(a.left, b.left) > 1
        && Math.min(a.bottom, b.bottom) - Math.max(a.top, b.top) > 3)
        .map(([other]) => one + " on " + other));
    return [...pairs, ...outside.map(([one]) => one + " outside")];
})"""
"""Letters of figures that lie on others, or beside the figure."""


@pytest.mark.parametrize("width", [1400, 800])
def test_no_letters_of_a_figure_lie_on_others(
    opened: Browser, client: Client, width: int
):
    opened.open(client.address, width, 1000)
    until(opened, DRAWN, True)
    assert opened.run(OVERPRINTED) == []


def test_what_cannot_be_is_a_sentence_in_the_column(opened: Browser):
    number = "document.getElementById('k-object_distance_mm')"
    enter(opened, number, 20)
    until(opened, f"{ALERT}.hidden", False)
    assert "no sharp image" in opened.run(f"{ALERT}.textContent")
    opened.run("document.getElementById('reset').click()")
    until(opened, f"{ALERT}.hidden", True)


def test_it_is_named_fits_a_tablet_and_asks_nobody_else(
    opened: Browser, client: Client
):
    assert opened.run(UNNAMED) == []
    opened.open(client.address, 800, 1100)
    until(opened, DRAWN, True)
    assert opened.run("document.documentElement.scrollWidth <= window.innerWidth")
    assert all(one.startswith((client.address, "data:")) for one in opened.requests)


def test_two_lenses_stand_side_by_side(tmp_path: Path):
    lenses = [
        ViewedLens(load_preset(PRESETS / name / "preset.json"), name, LensAdjustments())
        for name in ("prime_50", "vintage_50")
    ]
    with served(LensServer(lenses)) as client, Browser(tmp_path) as browser:
        browser.open(client.address)
        drawn = (
            "[...document.querySelectorAll('.spot')].filter((one) => one.src).length"
        )
        until(browser, drawn, 2)
        lefts = [box_of(browser, f".column:nth-child({k}) .spot")[0] for k in (1, 2)]
        assert lefts[1] > lefts[0] + 200
        working = "[...document.querySelectorAll('.working')].map((o) => o.textContent)"
        until(browser, f"{working}.join('')", "")
        assert browser.run(OVERPRINTED) == []
        assert browser.complaints == []
