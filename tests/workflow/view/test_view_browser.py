"""The page in a browser: turned by slider, by click and by key, and saved."""

import tomllib
from collections.abc import Iterator
from pathlib import Path

import pytest
from browser import Browser
from view_makers import (
    IN_BROWSER,
    SHOWN,
    UNNAMED,
    Client,
    box_of,
    click,
    enter,
    page_in_browser,
    plate_client,
    thin_lens,
    until,
    write_depth_plate,
)

from lensfit.workflow.view import viewed_plate

pytestmark = IN_BROWSER
WIDTH, HEIGHT = 640, 360


@pytest.fixture(scope="module")
def plate(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("view")
    return write_depth_plate(folder / "plate.1001.exr", WIDTH, HEIGHT)


@pytest.fixture(scope="module")
def client(plate: Path) -> Iterator[Client]:
    with plate_client(plate, thin_lens(WIDTH, HEIGHT)) as asked:
        yield asked


@pytest.fixture(scope="module")
def opened(
    client: Client, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[Browser]:
    profile = tmp_path_factory.mktemp("profile")
    with page_in_browser(client, profile, f"{SHOWN} === 'full'") as browser:
        yield browser


PICTURE = "document.getElementById('made').src"
DIFFERENT = """((made, other) => {
    if (!made.naturalWidth || !other.naturalWidth) return NaN;  // not loaded yet
    const canvas = document.createElement("canvas");
    [canvas.width, canvas.height] = [made.naturalWidth, made.naturalHeight];
    const pen = canvas.getContext("2d");
    const pixels = (image) => {
        pen.drawImage(image, 0, 0, canvas.width, canvas.height);
        return pen.getImageData(0, 0, canvas.width, canvas.height).data.slice();
    };
    const [one, two] = [pixels(made), pixels(other)];
    const away = one.map((value, k) => Math.abs(value - two[k]));
    return away.reduce((sum, value) => sum + value, 0) / away.length;
})(document.getElementById("made"), document.getElementById("plate"))"""
"""Mean difference of both pictures of the wipe, of 255."""
COMMAND = "document.getElementById('command').value"


def test_the_page_is_turned_by_slider_click_and_key_and_saved(
    opened: Browser, client: Client, plate: Path
):
    first = opened.run(PICTURE)
    slider = "document.querySelector('#camera .knob input[type=range]')"
    enter(opened, slider, 2, "input")
    until(opened, f"{COMMAND}.includes('--f-number=4')", True)
    until(opened, f"{PICTURE} !== {first!r} && {SHOWN} === 'full'", True)
    box = box_of(opened, "#made")
    assert box[2] > 300
    click(opened, box[0] + 0.2 * box[2], box[1] + 0.5 * box[3])
    near = client.post("focus", x=0.2 * WIDTH, y=0.5 * HEIGHT).json()
    said = f"--focus-distance-mm={near['focus_distance_mm']:g}"
    until(opened, f"{COMMAND}.includes({said!r})", True)
    until(opened, SHOWN, "full")
    opened.run("document.getElementById('wipe').focus()")
    opened.press("ArrowRight")
    wipe = "document.getElementById('stage').style.getPropertyValue('--wipe')"
    assert opened.run(wipe) == "1%"
    opened.run("document.getElementById('save').click()")
    saved = "document.getElementById('saved').textContent.startsWith('Saved to')"
    until(opened, saved, True)
    found = tomllib.loads((plate.parent / "lensfit.toml").read_text())
    assert found == {
        "camera": {"f_number": 4, "focus_distance_mm": near["focus_distance_mm"]}
    }
    opened.run("document.getElementById('reset').click()")
    until(opened, f"{COMMAND}.includes('--f-number')", False)
    assert opened.complaints == []
    assert all(one.startswith((client.address, "blob:")) for one in opened.requests)


def test_a_large_plate_grows_sharper_until_full(
    plate: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(viewed_plate, "MOST_PIXELS", 5000)
    width = "document.getElementById('made').naturalWidth"
    watched = f"""window.seen = [];
    new MutationObserver(() => window.seen.push([{SHOWN}, {width}])).observe(
        document.getElementById("stage"), {{ attributeFilter: ["data-shown"] }})"""
    with (
        plate_client(plate, thin_lens(WIDTH, HEIGHT)) as client,
        page_in_browser(client, tmp_path, f"{SHOWN} === 'full'") as browser,
    ):
        browser.run(watched)
        number = "document.getElementById('k-f_number')"
        enter(browser, number, 8)
        until(
            browser, "window.seen.length > 0 && window.seen.at(-1)[0] === 'full'", True
        )
        seen = [["proxy", WIDTH // 8], ["finer", WIDTH // 2], ["full", WIDTH]]
        assert browser.run("window.seen") == seen
        assert browser.complaints == []


def test_two_states_are_compared_by_the_wipe(opened: Browser):
    beside = "document.getElementById('stage').dataset.beside"
    plate = opened.run("document.getElementById('plate').src")
    number = "document.getElementById('k-f_number')"
    enter(opened, number, 16)
    until(opened, SHOWN, "full")
    opened.run("document.getElementById('keep').click()")
    until(opened, beside, "kept")
    kept = opened.run("document.getElementById('plate').src")
    assert kept != plate
    until(opened, f"{SHOWN} === 'full' && ({DIFFERENT}) < 1e-9", True)
    opened.run("document.getElementById('reset').click()")
    until(opened, f"{SHOWN} === 'full' && ({DIFFERENT}) > 1", True)
    opened.run("document.getElementById('keep').click()")
    until(opened, beside, "plate")


def test_light_is_shown_by_a_view_of_opencolorio(opened: Browser):
    pytest.importorskip("PyOpenColorIO")
    until(opened, SHOWN, "full")
    srgb = opened.run(PICTURE)
    config = "document.getElementById('config')"
    changed = f"{config}.dispatchEvent(new Event('change'))"
    opened.run(f"{config}.value = {config}.options[1].value, {changed}")
    until(opened, f"{SHOWN} === 'full' && {PICTURE} !== {srgb!r}", True)
    assert opened.run("document.getElementById('display').options.length") > 1
    assert opened.run("document.getElementById('view').value") != ""
    view = opened.run(PICTURE)
    space = "document.getElementById('space')"
    opened.run(f"{space}.selectedIndex = 2, {space}.dispatchEvent(new Event('change'))")
    until(opened, f"{SHOWN} === 'full' && {PICTURE} !== {view!r}", True)
    opened.run(f"{config}.value = '', {changed}")
    until(opened, "document.getElementById('display').disabled", True)


def test_a_bad_config_is_a_sentence_in_the_page(
    opened: Browser, client: Client, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    pytest.importorskip("PyOpenColorIO")
    monkeypatch.setenv("OCIO", str(tmp_path / "gone.ocio"))
    opened.open(client.address)
    until(opened, f"{SHOWN} === 'full'", True)
    said = opened.run("document.getElementById('view-fault').textContent")
    assert "gone.ocio" in said
    assert opened.run("document.getElementById('config').value") == ""
    monkeypatch.delenv("OCIO")
    opened.open(client.address)
    until(opened, f"{SHOWN} === 'full'", True)
    assert opened.run("document.getElementById('view-fault').textContent") == ""


def test_every_control_has_a_name(opened: Browser):
    assert opened.run(UNNAMED) == []
    assert opened.run("document.querySelectorAll('.knob').length") > 40


def test_what_cannot_be_is_a_sentence_in_the_page(opened: Browser):
    number = "document.getElementById('k-blades')"
    enter(opened, number, 2)
    until(opened, "document.getElementById('error').hidden", False)
    assert "3" in opened.run("document.getElementById('error').textContent")
    opened.run("document.getElementById('reset').click()")
    until(opened, "document.getElementById('error').hidden", True)


def test_a_tablet_s_width_holds_the_page(opened: Browser, client: Client):
    opened.open(client.address, 800, 1100)
    wide = "document.documentElement.scrollWidth <= window.innerWidth"
    assert opened.run(wide)
