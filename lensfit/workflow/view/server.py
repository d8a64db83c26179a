"""What the page and other programs are answered, over HTTP on this machine alone.

=======================  ==========================================================
``GET  api/lens``        what the lens and the plate say, controls, verdict
``POST api/render``      a frame: PNG in sRGB, or the EXR that `lensfit apply` writes
``POST api/plate``       the plate as it is, PNG
``POST api/plan``        what `lensfit plan` says
``POST api/focus``       the focus distance of what lies at a pixel
``POST api/command``     the command line that renders what is turned
``POST api/save``        the same into the shot's settings file
=======================  ==========================================================

A body is JSON: what is turned (`Turned`) and what is asked of it. What cannot be done
comes back as ``{"error": sentence}`` with status 422. A request that says ``"newest":
true`` waits in a lane of one: a newer one takes its place, and it is answered 204.
"""

import asyncio
import math
import secrets
import socket
from collections.abc import Awaitable, Callable
from concurrent.futures import Future, ThreadPoolExecutor
from functools import partial
from importlib.resources import files
from typing import Annotated, Any, Literal, NamedTuple, final

import uvicorn
from msgspec import Meta
from starlette.applications import Starlette
from starlette.requests import ClientDisconnect, Request
from starlette.responses import JSONResponse, Response
from starlette.routing import Route

from lensfit.errors import LensfitError, OutputError
from lensfit.workflow.view.controls import knob_controls
from lensfit.workflow.view.guard import Guard
from lensfit.workflow.view.latest_wins import LatestWins, Superseded
from lensfit.workflow.view.shown import screen_png
from lensfit.workflow.view.turned import (
    Started,
    Turned,
    command_line,
    read_turned,
)
from lensfit.workflow.view.viewed_plate import ViewedPlate

MOST_WAITING = 8
"""Requests of other programs, which are all answered, one after the other."""
_TOKEN_BYTES = 24
_END_S = 1
PAGE_FILES = {
    "": ("view.html", "text/html"),
    "view.css": ("view.css", "text/css"),
    "view.js": ("view.js", "text/javascript"),
    "controls.js": ("controls.js", "text/javascript"),
    "asker.js": ("asker.js", "text/javascript"),
}
Answer = Callable[[Request], Awaitable[Response]]
Stops = Annotated[float, Meta(ge=-20, le=20)]


class Render(Turned, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A frame that is wanted."""

    quality: Literal["proxy", "full"] = "full"
    format: Literal["png", "exr"] = "png"
    exposure_stops: Stops = 0.0
    newest: bool = False


class Query(Turned, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Anything else about what is turned."""

    exposure_stops: Stops = 0.0
    newest: bool = False


class Focus(Turned, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A pixel of the frame, from its upper left corner."""

    x: Annotated[float, Meta(ge=0, le=1e6)]
    y: Annotated[float, Meta(ge=0, le=1e6)]


@final
class PlateServer:
    """Answers about a preset on a plate.

    Parameters
    ----------
    started : Words of the command, for the command line that does the same.
    """

    def __init__(self, viewed: ViewedPlate, started: Started):
        self.viewed, self.started = viewed, started
        self._lanes = {name: LatestWins(name) for name in ("proxy", "full", "plan")}
        self._in_turn = ThreadPoolExecutor(1, "in-turn")
        self._waiting = 0

    @property
    def routes(self) -> list[Route]:
        """Of the application."""
        answers: dict[str, Answer] = {
            "render": self.render, "plate": self.plate, "plan": self.plan,
            "focus": self.focus, "command": self.command, "save": self.save,
        }  # fmt: skip
        return [
            *page_routes(PAGE_FILES),
            Route("/api/lens", errors_as_sentences(self.lens), methods=["GET"]),
            *(
                Route(f"/api/{name}", errors_as_sentences(answer), methods=["POST"])
                for name, answer in answers.items()
            ),
        ]

    async def lens(self, _request: Request) -> Response:
        """The start values of the first frame, the controls and the verdict."""
        preset = self.viewed.preset
        start = await self._one_after_another(lambda: self.viewed.start(0))
        verdict = preset.verdict and {
            "level": preset.verdict.level,
            "headline": preset.verdict.headline,
        }
        return JSONResponse(
            {
                "lens": preset.lens.name,
                "verdict": verdict,
                "settings": str(self.viewed.settings_path),
                "groups": knob_controls(),
                **start,
            }
        )

    async def render(self, request: Request) -> Response:
        """A frame through the lens."""
        query = await self._read(request, Render)
        viewed = self.viewed
        if query.format == "exr":
            exr = await self._one_after_another(lambda: viewed.frame_exr(query))
            return Response(exr, media_type="image/x-exr")

        def picture() -> bytes:
            return screen_png(viewed.pixels(query, query.quality), query.exposure_stops)

        return _png(await self._in_lane(query.newest, query.quality, picture))

    async def plate(self, request: Request) -> Response:
        """The plate itself."""
        query = await self._read(request, Query)

        def picture() -> bytes:
            pixels = self.viewed.plate_pixels(query.frame)
            return screen_png(pixels, query.exposure_stops)

        return _png(await self._one_after_another(picture))

    async def plan(self, request: Request) -> Response:
        """Stages, error, seconds and memory."""
        query = await self._read(request, Query)
        plan = partial(self.viewed.plan, query)
        return JSONResponse(await self._in_lane(query.newest, "plan", plan))

    async def focus(self, request: Request) -> Response:
        """What is sharp at a pixel."""
        query = await self._read(request, Focus)
        found = await self._one_after_another(
            lambda: self.viewed.focus_distance_mm(query, query.x, query.y)
        )
        return JSONResponse(
            {"focus_distance_mm": "inf" if math.isinf(found) else found}
        )

    async def command(self, request: Request) -> Response:
        """The command line."""
        query = await self._read(request, Turned)
        return JSONResponse({"command": command_line(self.started, query)})

    async def save(self, request: Request) -> Response:
        """The settings file."""
        query = await self._read(request, Turned)
        notes = await self._one_after_another(lambda: self.viewed.save(query))
        return JSONResponse({"path": str(self.viewed.settings_path), "notes": notes})

    async def _read(self, request: Request, record: type) -> Any:
        kind = request.headers.get("content-type", "").partition(";")[0].strip()
        if kind != "application/json":
            raise LensfitError(
                "a message is JSON",
                remedy="send it with Content-Type: application/json",
            )
        return read_turned(await request.body(), record, self.viewed.preset)

    async def _in_lane(self, newest: bool, lane: str, job: Callable[[], Any]) -> Any:
        if not newest:
            return await self._one_after_another(job)
        return await asyncio.wrap_future(self._lanes[lane].ask(job))

    async def _one_after_another(self, job: Callable[[], Any]) -> Any:
        """The result of a job, once those before it are done.

        Raises
        ------
        LensfitError : Too many wait already.
        """
        if self._waiting >= MOST_WAITING:
            raise LensfitError(
                f"{self._waiting} requests wait already", remedy="ask again later"
            )
        self._waiting += 1
        future: Future = self._in_turn.submit(job)
        future.add_done_callback(self._done)
        return await asyncio.wrap_future(future)

    def _done(self, _future: Future) -> None:
        self._waiting -= 1


def page_routes(page_files: dict[str, tuple[str, str]]) -> list[Route]:
    """The files of a page, read beforehand: a path is looked up, never opened."""
    found = []
    for path, (name, kind) in page_files.items():
        content = files("lensfit.workflow.view").joinpath(name).read_bytes()
        found.append(Route(f"/{path}", _constant(content, kind), methods=["GET"]))
    return found


def _constant(content: bytes, kind: str) -> Answer:
    async def answer(_request: Request) -> Response:
        return Response(content, media_type=kind)

    return answer


def _png(content: bytes) -> Response:
    return Response(content, media_type="image/png")


def errors_as_sentences(answer: Answer) -> Answer:
    """The same, which says in a sentence what cannot be done."""

    async def endpoint(request: Request) -> Response:
        try:
            return await answer(request)
        except Superseded:
            return Response(status_code=204)
        except ClientDisconnect:
            return Response(status_code=400)  # nobody is there to read it
        except LensfitError as error:
            return JSONResponse({"error": str(error)}, 422)
        except asyncio.CancelledError:
            return Response(status_code=503)  # the process ends
        except Exception as error:  # whatever it was, the page says it
            said = " ".join(f"{type(error).__name__}: {error}".split())
            return JSONResponse({"error": said}, 500)

    return endpoint


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


class Listening(NamedTuple):
    """A server that has its address and answers nobody yet.

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


def listening(routes: list[Route], port: int) -> Listening:
    """A guarded server on this machine's loopback address.

    Raises
    ------
    OutputError : The port is taken.
    """
    found = loopback_socket(port)
    port, token = found.getsockname()[1], secrets.token_urlsafe(_TOKEN_BYTES)
    config = uvicorn.Config(
        Guard(Starlette(routes=routes), token, port),
        log_level="critical", access_log=False, server_header=False, lifespan="off",
        timeout_graceful_shutdown=_END_S, ws="none", proxy_headers=False,
    )  # fmt: skip
    found.listen()
    address = f"http://127.0.0.1:{port}/{token}/"
    return Listening(uvicorn.Server(config), found, address)
