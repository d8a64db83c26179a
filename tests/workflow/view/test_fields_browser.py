"""The fields of the page of a plate in a browser: they show what the picture is made
with, whatever is saved, reset or changed elsewhere."""

import tomllib
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from threading import Event

import pytest
from browser import Browser
from view_makers import (
    HEADER,
    IN_BROWSER,
    SHOWN,
    Client,
    enter,
    page_in_browser,
    plate_client,
    thin_lens,
    until,
    write_depth_plate,
)

from lensfit.io.exr import ExrImage, read_exr, write_exr
from lensfit.workflow.view.viewed_plate import ViewedPlate

pytestmark = IN_BROWSER
READY = f"{SHOWN} === 'full'"
COMMAND = "document.getElementById('command').value"
SAID = "document.getElementById('saved').textContent"
STATUS = "document.getElementById('status').textContent"
NO_PICTURE = f"{STATUS}.startsWith('No picture of this state')"


@pytest.fixture
def opened(client: Client, tmp_path: Path) -> Iterator[Browser]:
    with page_in_browser(client, tmp_path / "profile", READY) as browser:
        yield browser


def field(name: str) -> str:
    return f"document.getElementById('k-{name}')"


def value(browser: Browser, name: str) -> str:
    return browser.run(f"{field(name)}.value")


def type_in(browser: Browser, name: str, text: str) -> None:
    enter(browser, field(name), text)


def press(browser: Browser, button: str) -> None:
    browser.run(f"document.getElementById({button!r}).click()")


def save(browser: Browser) -> str:
    """What is said of it."""
    browser.run("document.getElementById('saved').textContent = ''")
    press(browser, "save")
    until(browser, f"{SAID}.length > 0", True)
    return browser.run(SAID)


def settings(plate: Path) -> dict:
    return tomllib.loads((plate.parent / "lensfit.toml").read_text())


def test_after_a_save_fields_and_picture_agree(opened: Browser, plate: Path):
    type_in(opened, "f_number", "22")
    type_in(opened, "coma_gain", "2")
    assert save(opened).startswith("Saved to")
    press(opened, "reset")
    until(opened, f"{COMMAND}.includes('--f-number')", False)
    assert value(opened, "f_number") == "22"
    assert value(opened, "coma_gain") == "2"
    type_in(opened, "f_number", "2")
    type_in(opened, "coma_gain", "1")
    until(opened, f"{COMMAND}.includes('--f-number=2 --coma-gain=1')", True)
    assert save(opened).startswith("Saved to")
    assert settings(plate) == {"camera": {"f_number": 2}, "knobs": {"coma_gain": 1}}
    assert value(opened, "f_number") == "2"
    assert opened.complaints == []


def test_a_save_without_a_change_says_so(opened: Browser, plate: Path):
    assert save(opened) == "Nothing was changed: no field is turned"
    assert not (plate.parent / "lensfit.toml").exists()


def test_another_page_shows_what_one_saved(
    opened: Browser, client: Client, tmp_path: Path
):
    with page_in_browser(client, tmp_path / "other", READY) as other:
        type_in(opened, "f_number", "22")
        assert save(opened).startswith("Saved to")
        until(other, f"{field('f_number')}.value", "22")
        until(other, READY, True)
        assert save(other).startswith("Nothing was changed")


def test_a_field_follows_the_file_but_not_under_a_hand_that_types(
    opened: Browser, plate: Path
):
    opened.run(f"{field('f_number')}.value = '5'")
    written = "[camera]\nf_number = 8\nfocus_distance_mm = 3000\n"
    (plate.parent / "lensfit.toml").write_text(written)
    until(opened, f"{field('focus_distance_mm')}.value", "3000")
    assert value(opened, "f_number") == "5"
    type_in(opened, "f_number", "5.6")
    until(opened, f"{COMMAND}.includes('--f-number=5.6')", True)


def test_what_counts_before_the_settings_stays_turned(opened: Browser, plate: Path):
    frames = '[[frames]]\nrange = "1001-1002"\nf_number = 8\n'
    (plate.parent / "lensfit.toml").write_text(frames)
    until(opened, f"{field('f_number')}.value", "8")
    type_in(opened, "f_number", "4")
    assert "[[frames]]" in save(opened)
    assert value(opened, "f_number") == "4"
    until(opened, f"{COMMAND}.includes('--f-number=4')", True)
    press(opened, "reset")
    assert value(opened, "f_number") == "8"


def test_a_scrubbed_frame_shows_its_own_values(tmp_path: Path):
    for number in (1001, 1002):
        write_depth_plate(tmp_path / f"plate.{number}.exr")
    frames = '[[frames]]\nrange = "1002"\nf_number = 8\n'
    (tmp_path / "lensfit.toml").write_text(frames)
    with (
        plate_client(tmp_path / "plate.####.exr", thin_lens()) as client,
        page_in_browser(client, tmp_path / "profile", READY) as browser,
    ):
        assert value(browser, "f_number") == "2"
        scrub = "document.getElementById('frame')"
        enter(browser, scrub, 1, "input")
        until(browser, f"{field('f_number')}.value", "8")


@pytest.mark.parametrize(
    ("name", "text", "said"),
    [
        ("f_number", "0", "too small"),
        ("f_number", "-3", "too small"),
        ("f_number", ".01", "too small"),
        ("f_number", "1e9", "too large"),
        ("coma_gain", "1e6", "too large"),
        ("blades", "5.5", "not whole"),
        ("focus_distance_mm", "near", "no length"),
        ("focus_distance_mm", "1500,0", "no length"),
        ("focus_distance_mm", "1.5 parsec", "parsec"),
        ("focus_distance_mm", "0", "too small"),
    ],
)
def test_what_does_not_count_is_said_beside_its_field(
    opened: Browser, plate: Path, name: str, text: str, said: str
):
    used = value(opened, name) or "measured"
    type_in(opened, "ring_brightness", "-0.5")
    type_in(opened, name, text)
    beside = f"document.getElementById('e-{name}')"
    assert save(opened).startswith("Not saved: ")
    sentence = opened.run(f"{beside}.textContent")
    assert said in sentence
    assert sentence.endswith(f". In use: {used}")
    assert not opened.run(f"{beside}.hidden")
    assert opened.run(f"document.activeElement === {field(name)}")
    assert not (plate.parent / "lensfit.toml").exists()
    press(opened, "reset")
    assert opened.run(f"{beside}.hidden")
    assert save(opened).startswith("Nothing was changed")


@pytest.mark.parametrize(
    ("text", "mm"),
    [("1.5m", "1500"), ("5 m", "5000"), ("150 cm", "1500"), ("5 ft", "1524"),
     ("4'11\"", "1498.6"), ("59 1/2 in", "1511.3"),
     ("infinity", "inf"), ("∞", "inf"), ("800", "800")],
)  # fmt: skip
def test_a_distance_may_name_its_unit(opened: Browser, text: str, mm: str):
    type_in(opened, "focus_distance_mm", text)
    until(opened, f"{field('focus_distance_mm')}.value", mm)
    until(opened, f"{COMMAND}.includes('--focus-distance-mm={mm}')", True)


def test_a_process_that_has_ended_is_a_sentence(plate: Path, tmp_path: Path):
    with ExitStack() as ending:
        client = ending.enter_context(plate_client(plate, thin_lens()))
        with page_in_browser(client, tmp_path / "profile", READY) as browser:
            ending.close()
            assert "start lensfit view again" in save(browser)
            error = "document.getElementById('error').textContent"
            until(browser, f"{error}.startsWith('The process of this page')", True)


def test_it_is_said_that_a_picture_is_made(opened: Browser):
    found = opened.run(
        f"""(() => {{ const one = {field("f_number")};
        one.value = 8, one.dispatchEvent(new Event('change'));
        return {STATUS}; }})()"""
    )
    assert found == "Making the picture; the one before is shown …"
    until(opened, f"{STATUS}.startsWith('Full quality, ')", True)


def test_before_the_first_picture_the_plate_is_shown_and_it_is_said(
    client: Client, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    may_go_on, pixels = Event(), ViewedPlate.pixels

    def waiting(*wanted):
        assert may_go_on.wait(120)
        return pixels(*wanted)

    monkeypatch.setattr(ViewedPlate, "pixels", waiting)
    beside = "document.getElementById('stage').dataset.beside === 'plate'"
    with page_in_browser(client, tmp_path, beside) as browser:
        said = "Making the picture; the plate is shown as it is …"
        assert browser.run(STATUS) == said
        shown = "getComputedStyle(document.getElementById('plate')).clipPath"
        assert browser.run(shown) == "none"
        may_go_on.set()
        until(browser, READY, True)
        assert browser.run(shown) != "none"


def test_a_stop_is_opened_by_the_slider(opened: Browser):
    slider = "document.querySelector('#camera .knob input[type=range]')"
    enter(opened, slider, -9, "input")
    assert float(value(opened, "f_number")) == pytest.approx(2**0.5, rel=0.01)
    until(opened, f"{COMMAND}.includes('--f-number=1.41')", True)


def test_notes_stand_where_they_are_seen(opened: Browser, client: Client):
    """Beneath the picture, without scrolling."""
    opened.open(client.address, 1400, 900)
    until(opened, "document.querySelectorAll('#notes li').length > 0", True)
    bottom = "document.getElementById('notes').getBoundingClientRect().bottom"
    assert opened.run(f"{bottom} <= window.innerHeight")


def bare_plate(path: Path, channels: str, header: dict[str, float]) -> Path:
    """A plate that holds and states less."""
    part = read_exr(write_depth_plate(path)).parts[0]
    kept = {name: one for name, one in part.channels.items() if name in channels}
    write_exr(path, ExrImage((replace(part, channels=kept, attributes=header),)))
    return path


ERROR = "document.getElementById('error').textContent"
UNMADE = "document.getElementById('stage').classList.contains('unmade')"


def test_a_plate_without_depth_is_shown_without_depth_of_field(tmp_path: Path):
    plate = bare_plate(tmp_path / "p.exr", "RGB", HEADER)
    with (
        plate_client(plate, thin_lens()) as client,
        page_in_browser(client, tmp_path / "profile", NO_PICTURE) as browser,
    ):
        assert "the box “Depth of field”" in browser.run(ERROR)
        assert "plate is shown as it is" in browser.run(STATUS)
        until(browser, "document.getElementById('plate').naturalWidth > 0", True)
        press(browser, "defocus")
        until(browser, READY, True)
        assert browser.run(ERROR) == ""
        assert not browser.run(UNMADE)
        until(browser, f"{COMMAND}.endsWith('--no-defocus')", True)


def test_what_a_plate_does_not_state_is_requested_in_its_field(tmp_path: Path):
    plate = bare_plate(tmp_path / "p.exr", "RGBZ", {})
    with (
        plate_client(plate, thin_lens()) as client,
        page_in_browser(client, tmp_path / "profile", NO_PICTURE) as browser,
    ):
        needed = "[...document.querySelectorAll('.needed input')].map((one) => one.id)"
        for name, text in (("focus_distance_mm", "2 m"), ("f_number", "2")):
            label = f"document.querySelector('label[for=k-{name}]').textContent"
            until(browser, f"{needed}.includes('k-{name}')", True)
            assert f"the field “{browser.run(label)}”" in browser.run(ERROR)
            type_in(browser, name, text)
        until(browser, READY, True)
        assert browser.run(ERROR) == ""


def test_a_kept_state_stays_what_it_was(opened: Browser):
    beside = "document.getElementById('stage').dataset.beside"
    press(opened, "keep")
    until(opened, beside, "kept")
    type_in(opened, "f_number", "22")
    assert save(opened).startswith("Saved to")
    picture = "document.getElementById('plate').src"
    before = opened.run(picture)
    stops = "document.getElementById('exposure')"
    asked = f"""window.sent = []; window.was = window.fetch;
        window.fetch = (name, one) => {{ window.sent.push([name, one.body]);
            return window.was(name, one); }};
        {stops}.value = 1, {stops}.dispatchEvent(new Event('input'))"""
    opened.run(asked)
    until(opened, f"{picture} !== {before!r}", True)
    kept = """window.sent.filter(([name, body]) => name === "api/render"
        && !JSON.parse(body).newest).map(([, body]) => JSON.parse(body).f_number)"""
    assert opened.run(kept) == [2]
