"""The page of a shoot in a browser: from photographs to the report."""

import shutil
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from browser import Browser
from bundled_shoot import DEMO, shoot_text_without_blur
from view_makers import (
    IN_BROWSER,
    UNNAMED,
    Client,
    enter,
    page_in_browser,
    served,
    until,
    with_first_photographs_swapped,
)

from lensfit.preset.store import load_preset
from lensfit.workflow.shoot.shoot_file import load_shoot
from lensfit.workflow.view.lens_adjustments import LensAdjustments
from lensfit.workflow.view.lens_server import LensServer
from lensfit.workflow.view.shoot_server import ShootServer
from lensfit.workflow.view.viewed_lens import ViewedLens
from lensfit.workflow.view.viewed_results import ViewedResults
from lensfit.workflow.view.viewed_shoot import ViewedShoot

pytestmark = IN_BROWSER
STATE = "document.getElementById('calibration').dataset.state"
BORDERS = """new Set(["take0-f_number", "take0-target_distance_mm"].map((name) =>
    getComputedStyle(document.getElementById("f-" + name)).borderTopColor)).size"""
"""Colours of the borders of a refused field and of another."""
FAULT = "document.getElementById('fault')"
REFUSALS = ("status of 409", "status of 422")
"""What the console says of a field that was refused."""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = tmp_path_factory.mktemp("shoot")
    (made / "shoot.toml").write_text(shoot_text_without_blur())
    for take in load_shoot(made / "shoot.toml").takes:
        shutil.copy(DEMO / take.image, made)
    return made


@pytest.fixture(scope="module")
def client(folder: Path) -> Iterator[Client]:
    viewed = ViewedShoot(folder / "shoot.toml", None, folder / "results")
    with served(ShootServer(viewed)) as asked:
        yield asked


@pytest.fixture(scope="module")
def opened(
    client: Client, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[Browser]:
    profile = tmp_path_factory.mktemp("profile")
    ready = "document.querySelectorAll('#form details').length > 3"
    with page_in_browser(client, profile, ready) as browser:
        yield browser


def type_in(browser: Browser, field: str, text: str) -> None:
    enter(browser, f"document.getElementById('{field}')", text)


def test_photographs_are_checked_and_enlarged(opened: Browser, folder: Path):
    count = len(load_shoot(folder / "shoot.toml").takes)
    until(opened, "document.querySelectorAll('.photograph').length", count)
    until(opened, "document.getElementById('next').textContent.length > 10", True)
    opened.run("document.querySelector('.thumb').click()")
    assert opened.run("document.getElementById('large').open")
    wide = "document.querySelector('#large img').naturalWidth"
    until(opened, f"{wide} > 300", True)
    opened.run("document.getElementById('close').click()")
    assert not opened.run("document.getElementById('large').open")


def test_a_photograph_is_dropped_into_the_page(opened: Browser, folder: Path):
    opened.run(
        """(async () => {
            const picture = await (await fetch(
                document.querySelector('.thumb img').src)).blob();
            const data = new DataTransfer();
            data.items.add(new File([picture], 'dropped.png'));
            document.querySelector('.taken').dispatchEvent(
                new DragEvent('drop', { dataTransfer: data, bubbles: true }));
        })()"""
    )
    until(opened, "!!document.querySelector('[data-name=\"dropped.png\"]')", True)
    assert (folder / "dropped.png").stat().st_size > 1000


def test_what_is_wrong_stands_beside_its_field(opened: Browser, folder: Path):
    before = (folder / "shoot.toml").read_text()
    type_in(opened, "f-take0-f_number", "-2")
    until(opened, "document.getElementById('e-take0-f_number').hidden", False)
    assert "number" in opened.run(
        "document.getElementById('e-take0-f_number').textContent"
    )
    assert (folder / "shoot.toml").read_text() == before
    said = opened.run("document.getElementById('e-take0-f_number').textContent")
    _, _, kept = said.partition(". The file keeps ")
    assert float(kept) == load_shoot(folder / "shoot.toml").takes[0].f_number
    assert opened.run(BORDERS) == 2
    type_in(opened, "f-lens-serial", "4711")
    until(opened, "document.getElementById('f-lens-serial').value", "4711")
    deadline = time.monotonic() + 20
    while load_shoot(folder / "shoot.toml").lens.serial != "4711":
        assert time.monotonic() < deadline
        time.sleep(0.05)


def test_photographs_that_changed_places_are_shown_anew(opened: Browser, folder: Path):
    path = folder / "shoot.toml"
    first, second = (take.image for take in load_shoot(path).takes[:2])
    text = path.read_text()
    number = "document.getElementById('f-take0-f_number')"
    opened.run(f"{number}.closest('details').open = true, {number}.focus()")
    opened.run(f"{number}.value = '7'")
    path.write_text(with_first_photographs_swapped(text))
    before = path.read_text()
    opened.run(f"{number}.dispatchEvent(new Event('change'))")
    until(opened, f"{FAULT}.hidden", False)
    said = opened.run(f"{FAULT}.textContent")
    assert first in said
    assert second in said
    assert path.read_text() == before
    image = "document.getElementById('f-take0-image').value"
    assert opened.run(image) == second
    path.write_text(text)
    until(opened, image, first)
    assert opened.run(f"{FAULT}.hidden")


def test_the_form_follows_the_file(opened: Browser, folder: Path):
    path = folder / "shoot.toml"
    text = path.read_text()
    path.write_text(text.replace("[lens]", "[lens"))
    until(opened, f"!{FAULT}.hidden && {FAULT}.textContent.includes('TOML')", True)
    assert opened.run("document.getElementById('start').disabled")
    path.write_text(text)
    until(opened, f"{FAULT}.hidden", True)
    assert not opened.run("document.getElementById('start').disabled")


def test_the_form_follows_the_file_but_not_under_a_hand_that_types(
    opened: Browser, folder: Path
):
    path = folder / "shoot.toml"
    text = path.read_text()
    typing = "document.getElementById('f-lens-name')"
    other = "document.getElementById('f-lens-serial')"
    opened.run(f"{typing}.focus(), {typing}.value = 'typed so far'")
    opened.run(WATCHED)
    path.write_text(text.replace("4711", "4712"))
    until(opened, "window.forms.filter((one) => one.includes('4712')).length > 1", True)
    assert opened.run(f"{typing}.value") == "typed so far"
    assert opened.run(f"{other}.value") == "4711"
    opened.run(f"{typing}.value = {typing}.defaultValue")
    until(opened, f"{other}.value", "4712")
    path.write_text(text)
    until(opened, f"{other}.value", "4711")


WATCHED = """window.forms = [], window.was = window.fetch;
window.fetch = async (...one) => {
    const answer = await window.was(...one);
    if (one[0] === "api/shoot") window.forms.push(await answer.clone().text());
    return answer;
}"""
"""Remember what the page was answered of the file."""


def test_a_calibration_is_cancelled_without_loss_then_ends_in_its_report(
    opened: Browser, client: Client, folder: Path
):
    results = folder / "results"
    results.mkdir()
    (results / "mine.txt").write_text("kept")
    opened.run("document.getElementById('effort').value = 'fastest'")
    opened.run("document.getElementById('start').click()")
    until(opened, "document.querySelectorAll('#stages li').length > 0", True)
    opened.run("document.getElementById('cancel').click()")
    until(opened, STATE, "cancelled")
    assert [one.name for one in results.iterdir()] == ["mine.txt"]
    assert client.get("report").status == 422

    opened.run("document.getElementById('start').click()")
    until(opened, STATE, "running")
    stage = "document.getElementById('outcome').textContent"
    until(opened, f"{stage}.startsWith('Calibrating: ')", True)
    until(opened, STATE, "done", patience_s=600)
    headline = load_preset(results / "preset.json").verdict.headline
    said = opened.run("document.getElementById('outcome').textContent")
    assert said.startswith(headline)
    assert not opened.run("document.getElementById('report').hidden")
    report = client.get("report")
    assert report.content == (results / "report.html").read_bytes()
    assert report.headers["content-security-policy"].startswith("sandbox allow-scripts")
    assert (results / "mine.txt").read_text() == "kept"
    assert [
        one for one in opened.complaints if not any(said in one for said in REFUSALS)
    ] == []


def test_results_are_looked_at_with_their_report(folder: Path, tmp_path: Path):
    results = ViewedResults(folder / "results")
    lens = ViewedLens(load_preset(results.preset), "results", LensAdjustments())
    with served(LensServer([lens], results)) as client, Browser(tmp_path) as browser:
        browser.open(client.address)
        until(browser, "document.getElementById('report').hidden", False)
        browser.open(client.address + "report")
        assert browser.run("document.querySelectorAll('h2').length") > 3
        asked = browser.run("fetch('api/lens').then(() => 'answered', () => 'refused')")
        assert asked == "refused"


def test_controls_are_named_and_a_tablet_holds_the_page(
    opened: Browser, client: Client
):
    assert opened.run(UNNAMED) == []
    opened.open(client.address, 800, 1100)
    until(opened, "document.querySelectorAll('.photograph').length > 3", True)
    assert opened.run("document.documentElement.scrollWidth <= window.innerWidth")
