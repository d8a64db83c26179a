"""A headless Chromium for tests, driven by the DevTools protocol over two pipes.

Messages are JSON objects that end with a zero byte, written to the browser's file
descriptor 3 and read from its 4 (``--remote-debugging-pipe``), so that neither a port
nor a client library is needed.
"""

import base64
import contextlib
import fcntl
import json
import os
import select
import shutil
import signal
import time
from pathlib import Path
from typing import Any

CHROMIUM = next(
    filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))),
    None,
)
_FLAGS = (
    "--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run",
    "--disable-background-networking", "--disable-component-update", "--disable-sync",
    "--disable-dev-shm-usage", "--hide-scrollbars", "--remote-debugging-pipe",
)  # fmt: skip
_PATIENCE_S = 120.0
_CLEAR_OF_STANDARD = 20


class Browser:
    """One page of one browser, closed at the end of a ``with`` block.

    Attributes
    ----------
    complaints : What the page's console, scripts and policies complained of.
    requests : Addresses that the page asked for, without ``data:``.
    """

    def __init__(self, profile: Path):
        self.complaints: list[str] = []
        self.requests: list[str] = []
        self._seen: list[dict[str, Any]] = []
        self._rest, self._count, self._session = b"", 0, None
        theirs_in, self._to = _pipe()
        self._from, theirs_out = _pipe()
        assert CHROMIUM is not None
        command = [CHROMIUM, *_FLAGS, f"--user-data-dir={profile}", "about:blank"]
        silence = os.open(os.devnull, os.O_RDWR)
        moves = [(os.POSIX_SPAWN_DUP2, silence, n) for n in (0, 1, 2)]
        moves += [(os.POSIX_SPAWN_DUP2, theirs_in, 3)]
        moves += [(os.POSIX_SPAWN_DUP2, theirs_out, 4)]
        # Not subprocess: a fork of a process with threads is no longer safe.
        self._process = os.posix_spawn(
            CHROMIUM, command, os.environ, file_actions=moves, setpgroup=0
        )
        for descriptor in (theirs_in, theirs_out, silence):
            os.close(descriptor)

    def __enter__(self) -> "Browser":
        page = next(
            one
            for one in self.send("Target.getTargets")["targetInfos"]
            if one["type"] == "page"
        )
        attached = self.send(
            "Target.attachToTarget", targetId=page["targetId"], flatten=True
        )
        self._session = attached["sessionId"]
        for domain in ("Page", "Runtime", "Log", "Network"):
            self.send(f"{domain}.enable")
        return self

    def __exit__(self, *_: object) -> None:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(self._process, signal.SIGKILL)
        os.waitpid(self._process, 0)
        os.close(self._to)
        os.close(self._from)

    def send(self, method: str, **parameters: Any) -> dict[str, Any]:
        """The answer to one command."""
        self._count += 1
        message = {"id": self._count, "method": method, "params": parameters}
        if self._session:
            message["sessionId"] = self._session
        os.write(self._to, json.dumps(message).encode() + b"\0")
        answer = self._until(lambda one: one.get("id") == message["id"])
        assert "error" not in answer, f"{method}: {answer['error']}"
        return answer["result"]

    def open(self, page: Path | str, width: int = 1400, height: int = 1000) -> None:
        """Load a file or an address and wait until all of it is there."""
        self.send(
            "Emulation.setDeviceMetricsOverride",
            width=width, height=height, deviceScaleFactor=1, mobile=False,
        )  # fmt: skip
        self._seen.clear()
        address = page if isinstance(page, str) else page.as_uri()
        self.send("Page.navigate", url=address)
        if not any(one.get("method") == "Page.loadEventFired" for one in self._seen):
            self._until(lambda one: one.get("method") == "Page.loadEventFired")

    def run(self, expression: str) -> Any:
        """The value of a JavaScript expression on the page."""
        answer = self.send(
            "Runtime.evaluate",
            expression=expression, returnByValue=True, awaitPromise=True,
        )  # fmt: skip
        assert "exceptionDetails" not in answer, answer["exceptionDetails"]
        return answer["result"].get("value")

    def press(self, key: str) -> None:
        """A key of the keyboard, pressed and released; ``key`` as in KeyboardEvent."""
        code = {"ArrowLeft": 37, "ArrowRight": 39, "Home": 36, "End": 35, "Tab": 9}
        for kind in ("keyDown", "keyUp"):
            self.send(
                "Input.dispatchKeyEvent",
                type=kind, key=key, code=key, windowsVirtualKeyCode=code[key],
            )  # fmt: skip

    def picture(self, path: Path, **options: Any) -> None:
        """A screenshot as PNG; `options` as of ``Page.captureScreenshot``."""
        shot = self.send("Page.captureScreenshot", format="png", **options)
        path.write_bytes(base64.b64decode(shot["data"]))

    def _until(self, wanted: Any) -> dict[str, Any]:
        """The first message that is wanted; others are noted on the way."""
        deadline = time.monotonic() + _PATIENCE_S
        while True:
            while b"\0" in self._rest:
                line, self._rest = self._rest.split(b"\0", 1)
                message = json.loads(line)
                self._note(message)
                if wanted(message):
                    return message
            ready, _, _ = select.select([self._from], [], [], 1.0)
            assert time.monotonic() < deadline, "the browser did not answer"
            if ready:
                read = os.read(self._from, 1 << 20)
                assert read, "the browser went away"
                self._rest += read

    def _note(self, message: dict[str, Any]) -> None:
        self._seen.append(message)
        method, found = message.get("method"), message.get("params", {})
        if method == "Runtime.exceptionThrown":
            self.complaints.append(str(found["exceptionDetails"]))
        elif method == "Runtime.consoleAPICalled":
            self.complaints.append(str(found["args"]))
        elif method == "Log.entryAdded":
            self.complaints.append(found["entry"]["text"])
        elif method == "Network.requestWillBeSent":
            address = found["request"]["url"]
            if not address.startswith("data:"):
                self.requests.append(address)


def _pipe() -> tuple[int, int]:
    """Reading and writing end, clear of the numbers that the browser's get."""
    ends = os.pipe()
    moved = [fcntl.fcntl(e, fcntl.F_DUPFD_CLOEXEC, _CLEAR_OF_STANDARD) for e in ends]
    for end in ends:
        os.close(end)
    return moved[0], moved[1]
