"""Who may not ask is refused, whatever is asked, and the process goes on."""

import socket
from collections.abc import Iterator

import pytest
from view_makers import Client, plate_client, thin_lens, write_depth_plate

from lensfit.workflow.view.loopback_server import MOST_BYTES

JSON = {"content-type": "application/json"}


@pytest.fixture(scope="module")
def client(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Client]:
    plate = write_depth_plate(tmp_path_factory.mktemp("view") / "plate.exr")
    with plate_client(plate, thin_lens()) as asked:
        yield asked


@pytest.fixture(autouse=True)
def _alive(client: Client) -> Iterator[None]:
    yield
    assert client.get("").status == 200
    assert client.post("command").status == 200


def test_the_socket_listens_to_this_machine_alone(client: Client):
    port = int(client.host.partition(":")[2])
    assert client.host.startswith("127.0.0.1:")
    for address in {i[4][0] for i in socket.getaddrinfo(socket.gethostname(), port)}:
        if address.startswith("127.") or ":" in str(address):
            continue
        with socket.socket() as other:
            other.settimeout(5)
            assert other.connect_ex((address, port)) != 0


def test_every_path_needs_the_token(client: Client):
    wrong = client.token[:-1] + ("A" if client.token[-1] != "A" else "B")
    for start in ("", "/", f"/{wrong}", f"/{client.token[:-1]}", "/x"):
        for name in ("", "plate.js", "api/lens"):
            assert client.ask("GET", f"{start}/{name}").status == 404
        answer = client.ask("POST", f"{start}/api/save", b"{}", JSON)
        assert answer.status == 404
    assert len(client.token) >= 32


@pytest.mark.parametrize(
    "host", ["evil.example", "evil.example:80", "127.0.0.1", "127.0.0.1:1", "", "::1"]
)
def test_another_host_is_refused(client: Client, host: str):
    headers = {"Host": host} | JSON
    assert client.ask("GET", f"/{client.token}/", None, headers).status in (400, 421)
    path = f"/{client.token}/api/save"
    assert client.ask("POST", path, b"{}", headers).status in (400, 421)


@pytest.mark.parametrize(
    "headers",
    [
        {"Origin": "https://evil.example"},
        {"Origin": "null"},
        {"Origin": "http://127.0.0.1:1"},
        {"Origin": "http://127.0.0.1"},
        {"Sec-Fetch-Site": "cross-site"},
        {"Sec-Fetch-Site": "same-site"},
    ],
)
def test_another_page_is_refused(client: Client, headers: dict[str, str]):
    path = f"/{client.token}/api/command"
    assert client.ask("POST", path, b"{}", JSON | headers).status == 403
    assert client.ask("GET", f"/{client.token}/", None, headers).status == 403


def test_the_page_itself_may_ask(client: Client):
    own = {"Origin": f"http://{client.host}", "Sec-Fetch-Site": "same-origin"}
    path = f"/{client.token}/api/command"
    assert client.ask("POST", path, b"{}", JSON | own).status == 200


@pytest.mark.parametrize(
    "path",
    [
        "../../../../etc/passwd",
        "..%2f..%2fetc%2fpasswd",
        "%2e%2e/%2e%2e/pyproject.toml",
        "plate.html",
        "plate_server.py",
        "./plate.js/../plate_server.py",
        "plate.js%00.png",
        "//etc/passwd",
        "api/../../plate_server.py",
        "file:///etc/passwd",
        "api/lens/../../plate.html",
    ],
)
def test_no_path_leads_out_of_the_page_s_files(client: Client, path: str):
    assert client.get(path).status == 404


def test_nothing_else_may_be_asked(client: Client):
    for method in ("PUT", "DELETE", "PATCH", "OPTIONS", "TRACE"):
        answer = client.ask(method, f"/{client.token}/api/save", b"{}", JSON)
        assert answer.status == 405
    assert client.ask("GET", f"/{client.token}/api/save").status == 405


def status_of(client: Client, body: bytes | Iterator[bytes], **headers: str) -> int:
    """Of a command; 413 too where the line was cut before all of it was sent."""
    path = f"/{client.token}/api/command"
    try:
        return client.ask("POST", path, body, JSON | headers).status
    except (ConnectionResetError, BrokenPipeError):
        return 413


def test_an_oversize_body_is_refused_stated_or_not(client: Client):
    assert status_of(client, b"{}" + b" " * (MOST_BYTES - 2)) == 200
    assert status_of(client, b"{}" + b" " * (MOST_BYTES - 1)) == 413
    assert status_of(client, (b" " * 9000 for _ in range(8))) == 413
    assert status_of(client, (piece for piece in (b"{", b"}"))) == 200
    for length in ("9" * 30, "-1", "ten"):
        assert status_of(client, b"{}", **{"Content-Length": length}) in (400, 413)


def test_a_form_of_another_page_is_no_message(client: Client):
    for kind in ("text/plain", "application/x-www-form-urlencoded", ""):
        answer = client.ask(
            "POST", f"/{client.token}/api/save", b"{}", {"content-type": kind}
        )
        assert answer.status == 422


def test_the_page_may_load_nothing_from_elsewhere(client: Client):
    for name in ("", "plate.js", "api/lens", "no-such-thing"):
        headers = client.get(name).headers
        assert headers["content-security-policy"].startswith("default-src 'none'")
        assert headers["x-content-type-options"] == "nosniff"
        assert headers["referrer-policy"] == "no-referrer"
        assert "access-control-allow-origin" not in headers


def test_no_page_names_a_file(client: Client):
    for value in ("/etc/passwd", 1):
        answer = client.post("render", knobs={"filter_image": value})
        assert answer.status == 422


@pytest.mark.parametrize(
    "message",
    [
        {"knobs": {"coma": 1}},
        {"knobs": {"blades": 2}},
        {"knobs": {"coma_gain": 1e9}},
        {"knobs": {"coma_gain": 10**400}},
        {"f_number": -1},
        {"f_number": 0},
        {"focus_distance_mm": "near"},
        {"frame": 7},
        {"frame": -1},
        {"exposure_stops": 1e9},
        {"quality": "best"},
        {"path": "/etc/passwd"},
    ],
)
def test_what_cannot_be_is_a_sentence(client: Client, message: dict):
    answer = client.post("render", **message)
    assert answer.status == 422
    said = answer.json()["error"]
    assert said
    assert "\n" not in said
    assert "Traceback" not in said
