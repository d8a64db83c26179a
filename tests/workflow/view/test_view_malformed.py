"""Two thousand requests with something wrong: each is refused in a sentence.

Bytes, shapes, types and values of messages; paths, hosts and origins; uploads; and what
is not even HTTP. The process goes on, and nothing of it is in a log.
"""

import json
import logging
import socket
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from view_makers import (
    Answer,
    Client,
    plate_client,
    served,
    thin_lens,
    write_depth_plate,
)

from lensfit.workflow.view.loopback_server import MOST_BYTES
from lensfit.workflow.view.shoot_server import LARGEST_BYTES, ShootServer
from lensfit.workflow.view.viewed_shoot import ViewedShoot

REQUESTS = 2_000
JSON = {"content-type": "application/json"}
GOOD = {"frame": 0, "f_number": 2.8, "knobs": {"coma_gain": 1.0}}
OF_A_PLATE = (
    "command", "save", "focus", "plan", "render", "plate", "edit", "view", "start",
    "length",
)  # fmt: skip
OF_A_SHOOT = ("field", "target", "remove", "draft", "calibrate", "cancel")
WRONG = {
    "frame": ["x", [], None, True, {}, -1, 1.5, 1e308, 10**30],
    "f_number": ["1", [], True, {}, 0, -5, 1e308, 10**400],
    "focus_distance_mm": ["near", "-inf", [], {}, -1, 0, 1e308],
    "knobs": [
        1, [], None, "x", {"coma": 1}, {"blades": 2}, {"blades": 5.5},
        {"coma_gain": "1"}, {"coma_gain": 10**400}, {"coma_gain": -(10**30)},
        {"coma_gain": {}}, {"filter_image": 1}, {"bloom_gain": 1e300},
    ],
}  # fmt: skip
UNREAD = ("NaN", "Infinity", "-Infinity", "1e400", "1" + "0" * 5000, "0x1", "01")
"""Numbers that JSON, or any float, has not."""
AWAY = ("..", "../..", "%2e%2e", "..%2f..", "..\\", ".", "", "%00", "~", "file:")
TARGETS = ("etc/passwd", "plate_server.py", "plate.html", "shoot.toml", "api")
HOSTS = ("evil.example", "127.0.0.1", "localhost:1", "[::1]", "", "127.0.0.1.nip.io")
ORIGINS = ("https://evil.example", "null", "http://127.0.0.1", "http://localhost:1")


def body_of(rng: np.random.Generator) -> bytes:
    """A message with something wrong."""
    kind = rng.integers(7)
    if kind == 0:
        return rng.bytes(int(rng.integers(1, 300)))
    if kind == 1:
        text = json.dumps(GOOD).encode()
        return text[: int(rng.integers(1, len(text) - 1))]
    if kind == 2:
        deep = int(rng.integers(2, 5_000))
        return b'{"knobs":' * deep + b"1" + b"}" * deep
    if kind == 3:
        key = str(rng.choice([*WRONG]))
        return json.dumps(GOOD | {key: pick(rng, WRONG[key])}).encode()
    if kind == 4:
        name = "".join(map(chr, rng.integers(32, 0xD7FF, 12)))
        return json.dumps(GOOD | {name: 1}).encode()
    if kind == 5:
        return json.dumps([GOOD] * int(rng.integers(1, 50))).encode()
    number = pick(rng, UNREAD)
    return json.dumps(GOOD | {"f_number": "@"}).replace('"@"', number).encode()


def pick(rng: np.random.Generator, choices):
    return choices[int(rng.integers(len(choices)))]


def message(rng: np.random.Generator, plate: Client, shoot: Client) -> Answer:
    if rng.integers(3):
        return plate.post_bytes(pick(rng, OF_A_PLATE), body_of(rng))
    return shoot.post_bytes(pick(rng, OF_A_SHOOT), body_of(rng))


def traversal(rng: np.random.Generator, plate: Client, shoot: Client) -> Answer:
    steps = [pick(rng, AWAY) for _ in range(int(rng.integers(1, 9)))]
    path = "/".join([*steps, pick(rng, TARGETS)])
    return pick(rng, (plate, shoot)).get(path)


def elsewhere(rng: np.random.Generator, plate: Client, shoot: Client) -> Answer:
    """By another name, or from another page."""
    wrong = {"Host": pick(rng, HOSTS)} if rng.integers(2) else {
        pick(rng, ("Origin", "origin")): pick(rng, ORIGINS)
    }  # fmt: skip
    client = pick(rng, (plate, shoot))
    return client.ask("POST", f"/{client.token}/api/save", b"{}", JSON | wrong)


def without_the_token(rng: np.random.Generator, plate: Client, shoot: Client) -> Answer:
    client = pick(rng, (plate, shoot))
    letters = [*client.token]
    letters[int(rng.integers(len(letters)))] = pick(rng, "!*$")
    return client.ask("POST", f"/{''.join(letters)}/api/save", b"{}", JSON)


def upload(rng: np.random.Generator, _plate: Client, shoot: Client) -> Answer:
    """Of a name that leads away, is none of a photograph, or is too large."""
    if rng.integers(3) == 0:
        most = pick(rng, (str(LARGEST_BYTES + 1), "9" * 30, "1e3", "-1"))
        return shoot.upload("far.png", b"", **{"Content-Length": most})
    steps = [pick(rng, ("..", "/etc", "a", "C:\\", "\x00")) for _ in range(3)]
    ends = ("x.exr", "x.toml", ".x.exr", "x", "")
    return shoot.upload("/".join([*steps, pick(rng, ends)]), b"x")


def oversize(rng: np.random.Generator, plate: Client, shoot: Client) -> Answer:
    size = MOST_BYTES + int(rng.integers(1, 1000))
    client = pick(rng, (plate, shoot))
    return client.post_bytes("command", b"{}".ljust(size))


def bytes_of_no_request(
    rng: np.random.Generator, plate: Client, _shoot: Client
) -> Answer:
    host, _, port = plate.host.partition(":")
    with socket.create_connection((host, int(port)), 30) as line:
        line.sendall(b"\x00" + rng.bytes(int(rng.integers(1, 200))) + b"\r\n\r\n")
        line.shutdown(socket.SHUT_WR)
        heard = b"".join(iter(lambda: line.recv(4096), b""))
    head, _, text = heard.partition(b"\r\n\r\n")
    return Answer(int(head.split()[1]), {}, text)


KINDS: list[tuple[Callable[..., Answer], float]] = [
    (message, 0.55), (traversal, 0.12), (elsewhere, 0.1), (upload, 0.1),
    (without_the_token, 0.05), (bytes_of_no_request, 0.05), (oversize, 0.03),
]  # fmt: skip


@pytest.fixture
def clients(tmp_path: Path) -> Iterator[tuple[Client, Client]]:
    plate = write_depth_plate(tmp_path / "plate.exr")
    shoot = tmp_path / "shoot"
    shoot.mkdir()
    viewed = ViewedShoot(shoot / "shoot.toml", None, shoot / "results")
    with plate_client(plate, thin_lens()) as one, served(ShootServer(viewed)) as two:
        yield one, two


def refused(answer: Answer) -> bool:
    """In a sentence."""
    said = answer.content.decode()
    if answer.headers.get("content-type") == "application/json":
        said = json.loads(said)["error"]
    words = said.split()
    return (
        400 <= answer.status < 500
        and len(words) > 2
        and "\n" not in said
        and "Traceback" not in said
    )


def test_two_thousand_wrong_requests_are_each_refused_in_a_sentence(
    clients, tmp_path: Path, caplog: pytest.LogCaptureFixture, capfd
):
    caplog.set_level(logging.DEBUG)
    rng = np.random.default_rng(20)
    makers, weights = zip(*KINDS, strict=True)
    before = {path for path in tmp_path.rglob("*")}
    for index in range(REQUESTS):
        make = makers[int(rng.choice(len(makers), p=weights))]
        try:
            answer = make(rng, *clients)
        except (ConnectionResetError, BrokenPipeError):
            assert make is oversize  # cut off before all of it was sent
            continue
        assert refused(answer), (index, make.__name__, answer)
    for client in clients:
        assert client.get("").status == 200
    assert clients[0].post("command", f_number=4.0).status == 200
    assert clients[1].get("api/calibration").json()["state"] == "idle"
    assert {path for path in tmp_path.rglob("*")} == before
    heard = "".join([caplog.text, *capfd.readouterr()])
    assert "Traceback" not in heard
    assert "Error" not in heard
