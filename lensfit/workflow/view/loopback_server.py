"""A server on this machine's loopback address, and the address that opens its page.

It accepts requests of this machine's browser on the page that was opened, and no
others. The server listens to the loopback address, which every program and every page
in any browser of this machine can reach. So every request must

- lie under a path that begins with a random token, which only the opened address has;
- name this very address as its ``Host``, so that no other name that resolves to
  127.0.0.1 (DNS rebinding) serves another page;
- come from no other page: an ``Origin`` or ``Sec-Fetch-Site``, if present, is our own;
- be small.

A request is refused before any of its body is read.
"""

import hmac
import secrets
import socket
from collections.abc import Awaitable, Callable, Mapping, MutableMapping
from typing import Any, NamedTuple, final

import uvicorn
from starlette.applications import Starlette
from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import PlainTextResponse, Response
from starlette.routing import Route

from lensfit.errors import OutputError

Scope = MutableMapping[str, Any]
Receive = Callable[[], Awaitable[MutableMapping[str, Any]]]
Send = Callable[[MutableMapping[str, Any]], Awaitable[None]]
Application = Callable[[Scope, Receive, Send], Awaitable[None]]

MOST_BYTES = 64 * 1024
"""Of a request's body: what is turned takes two thousand."""
_TOO_LARGE = f"a message has at most {MOST_BYTES} bytes"
_POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob: "
    "data:; connect-src 'self'; base-uri 'none'; form-action 'none'; "
    "frame-ancestors 'none'"
)
_HEADERS = {
    "content-security-policy": _POLICY,
    "x-content-type-options": "nosniff",
    "referrer-policy": "no-referrer",
    "cross-origin-resource-policy": "same-origin",
    "cross-origin-opener-policy": "same-origin",
    "cache-control": "no-store",
}


@final
class Guard:
    """An application that receives only permitted requests.

    Parameters
    ----------
    inner : Answers; its paths have no token.
    token : First part of every path.
    port : That the server listens to.
    uploads : Paths that take more than a message, and how many bytes at most.
    """

    def __init__(
        self,
        inner: Application,
        token: str,
        port: int,
        uploads: Mapping[str, int] | None = None,
    ):
        self._inner, self._uploads = inner, uploads or {}
        self._start = f"/{token}/".encode()
        names = ("127.0.0.1", "localhost")
        self._hosts = {f"{name}:{port}".encode() for name in names}
        self._origins = {b"http://" + host for host in self._hosts}

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Refuse, or hand on."""
        if scope["type"] == "lifespan":
            await self._inner(scope, receive, send)
            return
        if scope["type"] != "http":
            return  # a socket that nobody accepts is closed
        refused = self._refusal(scope)
        if refused is not None:
            status, text = refused
            await PlainTextResponse(text, status)(
                scope, receive, _with_closed_headers(send)
            )
            return
        path = scope["path"][len(self._start) - 1 :]
        inner = {**scope, "path": path, "raw_path": path.encode(), "root_path": ""}
        if path in self._uploads:
            counted = _limited_receive(receive, self._uploads[path])
            await self._inner(inner, counted, _with_closed_headers(send))
            return
        body = await _small_body(receive)
        if body is None:
            await PlainTextResponse(_TOO_LARGE, 413)(
                scope, receive, _with_closed_headers(send)
            )
            return
        await self._inner(
            inner, _replayed_body(body, receive), _with_closed_headers(send)
        )

    def _refusal(self, scope: Scope) -> tuple[int, str] | None:
        headers = scope["headers"]
        if [v for k, v in headers if k == b"host"] not in [[h] for h in self._hosts]:
            return 421, "this is not the address that was opened"
        origins = {value for key, value in headers if key == b"origin"}
        sites = {value for key, value in headers if key == b"sec-fetch-site"}
        if not origins <= self._origins or not sites <= {b"same-origin", b"none"}:
            return 403, "another page may not ask"
        path = scope["path"].encode("utf-8", "surrogatepass")
        if not hmac.compare_digest(path[: len(self._start)], self._start):
            return 404, "open the address that lensfit view printed"
        inner = scope["path"][len(self._start) - 1 :]
        most = self._uploads.get(inner, MOST_BYTES)
        for key, value in headers:
            if key == b"content-length" and not _is_within(value, most):
                return 413, f"a message has at most {most} bytes"
        return None


def _is_within(length: bytes, most: int) -> bool:
    return length.isdigit() and len(length) < 12 and int(length) <= most


def _limited_receive(receive: Receive, most: int) -> Receive:
    """The same, which ends as if the line were cut once it brings too much."""
    count = 0

    async def counted() -> MutableMapping[str, Any]:
        nonlocal count
        message = await receive()
        count += len(message.get("body", b""))
        return message if count <= most else {"type": "http.disconnect"}

    return counted


async def _small_body(receive: Receive) -> bytes | None:
    """The body of a request; None as soon as it is too large."""
    body, more = b"", True
    while more:
        message = await receive()
        body += message.get("body", b"")
        more = message["type"] == "http.request" and message.get("more_body", False)
        if len(body) > MOST_BYTES:
            return None
    return body


def _replayed_body(body: bytes, receive: Receive) -> Receive:
    """A body that was read already, and then whatever comes."""
    is_read = False

    async def replayed() -> MutableMapping[str, Any]:
        nonlocal is_read
        if is_read:
            return await receive()
        is_read = True
        return {"type": "http.request", "body": body, "more_body": False}

    return replayed


def _with_closed_headers(send: Send) -> Send:
    """The same, with headers that let a page load nothing from elsewhere; those that an
    answer states itself stay."""

    async def closed(message: MutableMapping[str, Any]) -> None:
        if message["type"] == "http.response.start":
            stated = {name for name, _ in message["headers"]}
            own = [(k.encode(), v.encode()) for k, v in _HEADERS.items()]
            added = [(name, value) for name, value in own if name not in stated]
            message = {**message, "headers": [*message["headers"], *added]}
        await send(message)

    return closed


_TOKEN_BYTES = 24
_END_S = 1
_SAID = {
    404: "there is nothing at this address",
    405: "this address is asked by another method",
}


def loopback_socket(port: int) -> socket.socket:
    """A socket of this machine alone; of any free port if 0.

    Raises
    ------
    OutputError : The port is taken.
    """
    found = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    try:
        found.bind(("127.0.0.1", port))
    except OSError as error:
        found.close()
        raise OutputError(
            f"port {port} cannot be used ({error.strerror})",
            remedy="give another --port, or none",
        ) from error
    return found


class LoopbackServer(NamedTuple):
    """A server that has its address and does not answer yet.

    Attributes
    ----------
    address : That opens it, with its token.
    """

    server: uvicorn.Server
    socket: socket.socket
    address: str

    def run(self) -> None:
        """Answer until the process is interrupted, or the server told to end."""
        self.server.run(sockets=[self.socket])


def loopback_server(
    routes: list[Route], port: int, uploads: Mapping[str, int] | None = None
) -> LoopbackServer:
    """A guarded server on this machine's loopback address.

    Parameters
    ----------
    uploads : As of `Guard`.

    Raises
    ------
    OutputError : The port is taken.
    """
    found = loopback_socket(port)
    port, token = found.getsockname()[1], secrets.token_urlsafe(_TOKEN_BYTES)
    inner = Starlette(
        routes=routes, exception_handlers={HTTPException: _error_response}
    )
    config = uvicorn.Config(
        Guard(inner, token, port, uploads),
        log_level="critical", access_log=False, server_header=False, lifespan="off",
        timeout_graceful_shutdown=_END_S, ws="none", proxy_headers=False,
    )  # fmt: skip
    found.listen()
    address = f"http://127.0.0.1:{port}/{token}/"
    return LoopbackServer(uvicorn.Server(config), found, address)


async def _error_response(_request: Request, error: Exception) -> Response:
    """What the routes refuse by themselves, in a sentence."""
    assert isinstance(error, HTTPException)
    text = _SAID.get(error.status_code, error.detail)
    return PlainTextResponse(text, error.status_code, headers=error.headers)
