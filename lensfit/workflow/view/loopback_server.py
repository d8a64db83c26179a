"""A server on this machine's loopback address, and the address that opens its page."""

import secrets
import socket
from collections.abc import Mapping
from typing import NamedTuple

import uvicorn
from starlette.applications import Starlette
from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import PlainTextResponse, Response
from starlette.routing import Route

from lensfit.errors import OutputError
from lensfit.workflow.view.guard import Guard

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
