"""A thin lens, a plate with depth and a server on them, for the tests of the view."""

import http.client
import json
import threading
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from lensfit.coords import Window
from lensfit.io.exr import ExrImage, ExrPart, write_exr
from lensfit.preset.schema import Preset
from lensfit.preset.store import save_preset
from lensfit.preset.thin_lens import ThinCamera, thin_lens_preset
from lensfit.workflow.apply_options import ApplyOptions
from lensfit.workflow.view.server import PlateServer, listening
from lensfit.workflow.view.turned import Started
from lensfit.workflow.view.viewed_plate import ViewedPlate

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

    def __init__(self, server: PlateServer, address: str):
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

    def post_bytes(self, name: str, body: bytes) -> Answer:
        """The same for a message that may be malformed."""
        headers = {"content-type": "application/json"}
        return self.ask("POST", f"/{self.token}/api/{name}", body, headers)


@contextmanager
def plate_client(
    plate: Path, preset: Preset, options: ApplyOptions | None = None
) -> Iterator[Client]:
    viewed = ViewedPlate(preset, str(plate), options or ApplyOptions())
    server = PlateServer(viewed, Started("thin.json", str(plate)))
    page = listening(server.routes, 0)
    thread = threading.Thread(target=page.run)
    thread.start()
    try:
        yield Client(server, page.address)
    finally:
        page.server.should_exit = True
        thread.join()
