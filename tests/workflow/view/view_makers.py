"""A thin lens, a plate with depth and a server on them, for the tests of the view."""

import http.client
import json
import threading
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple
from urllib.parse import quote

import numpy as np
import pytest
from browser import CHROMIUM, Browser

from lensfit.coords import Window
from lensfit.io.exr import ExrImage, ExrPart, write_exr
from lensfit.plate.apply_options import ApplyOptions
from lensfit.preset.schema import Preset
from lensfit.preset.store import save_preset
from lensfit.preset.thin_lens import ThinCamera, thin_lens_preset
from lensfit.workflow.view.lens_adjustments import StartCommand
from lensfit.workflow.view.loopback_server import loopback_server
from lensfit.workflow.view.plate_server import PlateServer
from lensfit.workflow.view.viewed_plate import ViewedPlate

IN_BROWSER = [
    pytest.mark.slow,
    pytest.mark.skipif(CHROMIUM is None, reason="no chromium on this machine"),
]
SHOWN = "document.getElementById('stage').dataset.shown"
"""Quality of the picture that the page of a plate shows."""
NEAR_M, FAR_M = 1.5, 6.0
HEADER = {
    "lens/focal": 75.0,
    "lens/fstop": 2.0,
    "lens/focus": 2.0,
    "lens/aperture": 36.0,
}


def thin_lens(width: int = 96, height: int = 54) -> Preset:
    return thin_lens_preset(ThinCamera(75.0, 2.0, 2.0, 36.0, width, height))


def write_depth_plate(path: Path, width: int = 96, height: int = 54) -> Path:
    """Stripes: the left half at `NEAR_M`, the right half at `FAR_M`."""
    window = Window.of_size(width, height)
    x, y = np.moveaxis(window.pixel_centres(), -1, 0)
    planes = [np.sin(x), np.cos(1.2 * y), np.sin(x + y)]
    rgb = (0.4 + 0.3 * np.stack(planes, -1)).astype(np.float16)
    channels = {name: rgb[..., i].copy() for i, name in enumerate("RGB")}
    channels["Z"] = np.where(x < width / 2, NEAR_M, FAR_M).astype(np.float32)
    write_exr(path, ExrImage((ExrPart(channels, window, window, HEADER),)))
    return path


def written_lens(folder: Path, preset: Preset | None = None) -> Path:
    path = folder / "thin.json"
    save_preset(preset or thin_lens(), path)
    return path


class Answer(NamedTuple):
    """What a server said."""

    status: int
    headers: dict[str, str]
    content: bytes

    def json(self) -> Any:
        return json.loads(self.content)


class Client:
    """Asks a server, each time by a connection of its own.

    Attributes
    ----------
    address : Of the page, with its token.
    """

    def __init__(self, server: Any, address: str):
        self.server, self.address = server, address
        _, _, self.host, self.token, _ = address.split("/")

    def ask(
        self,
        method: str,
        path: str,
        body: bytes | Iterator[bytes] | None = None,
        headers: Mapping[str, str] | None = None,
    ) -> Answer:
        """Any request, with http.client's headers where none are given."""
        connection = http.client.HTTPConnection(self.host, timeout=120)
        try:
            connection.request(method, path, body, dict(headers or {}))
            answer = connection.getresponse()
            named = {key.lower(): value for key, value in answer.getheaders()}
            return Answer(answer.status, named, answer.read())
        finally:
            connection.close()

    def get(self, name: str) -> Answer:
        """A file of the page, or what an address says."""
        return self.ask("GET", f"/{self.token}/{name}")

    def post(self, name: str, **message: object) -> Answer:
        """What is said of a message."""
        return self.post_bytes(name, json.dumps(message).encode())

    def upload(
        self, name: str, body: bytes | Iterator[bytes], **headers: str
    ) -> Answer:
        """A photograph, handed over."""
        kind = {"content-type": "application/octet-stream"} | headers
        path = f"/{self.token}/api/photograph?name={quote(name)}"
        return self.ask("POST", path, body, kind)

    def post_bytes(self, name: str, body: bytes) -> Answer:
        """The same for a message that may be malformed."""
        headers = {"content-type": "application/json"}
        return self.ask("POST", f"/{self.token}/api/{name}", body, headers)


@contextmanager
def served(server: Any) -> Iterator[Client]:
    """A client of a server, which ends with the block."""
    page = loopback_server(server.routes, 0, server.uploads)
    thread = threading.Thread(target=page.run)
    thread.start()
    try:
        yield Client(server, page.address)
    finally:
        page.server.should_exit = True
        thread.join()
        server.end()


@contextmanager
def plate_client(
    plate: Path, preset: Preset, options: ApplyOptions | None = None
) -> Iterator[Client]:
    viewed = ViewedPlate(preset, str(plate), options or ApplyOptions())
    with served(PlateServer(viewed, StartCommand("thin.json", str(plate)))) as client:
        yield client


@contextmanager
def page_in_browser(client: Client, profile: Path, ready: str) -> Iterator[Browser]:
    """The page of a client, once an expression of it is true."""
    with Browser(profile) as browser:
        browser.open(client.address)
        until(browser, ready, True)
        yield browser


def until(browser: Browser, expression: str, wanted: Any, patience_s: float = 120.0):
    """Wait for an expression of the page to have a value."""
    deadline = time.monotonic() + patience_s
    while (found := browser.run(expression)) != wanted:
        assert time.monotonic() < deadline, f"{expression} is {found!r}"
        time.sleep(0.05)


def enter(browser: Browser, field: str, value: object, event: str = "change") -> None:
    """Give a field, an expression of the page, a value as if typed or slid."""
    browser.run(
        f"{field}.value = {value!r}, {field}.dispatchEvent(new Event({event!r}))"
    )


def mouse(browser: Browser, kind: str, x: float, y: float) -> None:
    """Press, move or release the left button."""
    browser.send(
        "Input.dispatchMouseEvent",
        type=f"mouse{kind}", x=x, y=y, button="left", clickCount=1, buttons=1,
    )  # fmt: skip


def click(browser: Browser, x: float, y: float) -> None:
    mouse(browser, "Pressed", x, y)
    mouse(browser, "Released", x, y)


def box_of(browser: Browser, selector: str) -> list[float]:
    """Left, top, width and height of an element, scrolled into view."""
    return browser.run(
        f"""(() => {{ const one = document.querySelector({selector!r});
            one.scrollIntoView({{ block: "center" }});
            const box = one.getBoundingClientRect();
            return [box.left, box.top, box.width, box.height]; }})()"""
    )


UNNAMED = """[...document.querySelectorAll("input, button, textarea, select")].filter(
    (one) => !(one.labels?.length || one.textContent.trim()
      || one.getAttribute("aria-label"))).map((one) => one.outerHTML)"""
"""Controls that a screen reader cannot name."""


def with_first_photographs_swapped(shoot: str) -> str:
    """A shoot file with its first two photographs in the other order."""
    head, one, two, *rest = shoot.split("[[take]]")
    return "[[take]]".join([head, two, one, *rest])
