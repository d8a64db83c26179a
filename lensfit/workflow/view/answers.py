"""Answer the requests of a page: one after the other, with errors as a sentence.

A request with ``"newest": true`` waits in a lane of one: a newer one takes its place,
and the older is answered 204. All others are answered in turn. A request that cannot be
fulfilled is answered ``{"error": sentence}`` with status 422.

While a picture is made others may be requested; each replaces the one that waited
before it, which is dropped. So at most one picture waits behind the one in work, and
the last one requested is always made.

A length that is typed into a page is read as in shoot files.
"""

import asyncio
import math
import threading
import time
from collections.abc import Awaitable, Callable, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
from importlib.resources import files
from typing import Annotated, Any, final

import msgspec
from msgspec import Meta, Struct
from starlette.requests import ClientDisconnect, Request
from starlette.responses import JSONResponse, Response
from starlette.routing import Route

from lensfit._strict import plain_complaint
from lensfit.errors import LensfitError, ShootError, sentence_of
from lensfit.report.plain_numbers import plain_distance
from lensfit.workflow.shoot.crew_notation import length_mm


class Superseded(Exception):
    """A newer request came before this one was begun."""


@final
class LatestWins:
    """A lane with one thread, which ends with the process.

    Parameters
    ----------
    name : Of the thread.
    """

    def __init__(self, name: str):
        self._changed, self._ended = threading.Condition(), False
        self._waiting: tuple[Callable[[], Any], Future] | None = None
        self._thread = threading.Thread(target=self._work, name=name, daemon=True)
        self._thread.start()

    def ask(self, job: Callable[[], Any]) -> Future:
        """The future result of `job`; `Superseded` if a newer one came before it."""
        future: Future = Future()
        with self._changed:
            given_up, self._waiting = self._waiting, (job, future)
            self._changed.notify()
        if given_up is not None and given_up[1].set_running_or_notify_cancel():
            given_up[1].set_exception(Superseded())
        return future

    def end(self) -> None:
        """Begin nothing more."""
        with self._changed:
            given_up, self._waiting, self._ended = self._waiting, None, True
            self._changed.notify()
        if given_up is not None:
            given_up[1].cancel()

    def wait(self, most_s: float) -> None:
        """Until what is in work at the end is done, but no longer than this."""
        self._thread.join(most_s)

    def _work(self) -> None:
        while True:
            with self._changed:
                while self._waiting is None and not self._ended:
                    self._changed.wait()
                if self._waiting is None:
                    return
                (job, future), self._waiting = self._waiting, None
            if not future.set_running_or_notify_cancel():
                continue
            try:
                future.set_result(job())
            except BaseException as error:  # the asker is told, and the thread goes on
                future.set_exception(error)
            del job, future


_END_S = 5.0
"""How long the end waits for what is in work."""
MOST_WAITING = 8
"""Requests of other programs, which are all answered, one after the other."""
Answer = Callable[[Request], Awaitable[Response]]


@final
class RequestQueue:
    """One thread for requests that are all answered, and a lane of one for each kind of
    which only the newest counts."""

    def __init__(self):
        self._lanes: dict[str, LatestWins] = {}
        self._in_turn = ThreadPoolExecutor(1, "in-turn")
        self._waiting = 0

    async def done(self, job: Callable[[], Any]) -> Any:
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
        future.add_done_callback(self._count_finished)
        return await asyncio.wrap_future(future)

    async def newest(self, lane: str, job: Callable[[], Any]) -> Any:
        """The result of a job, unless a newer one took its place in the lane."""
        return await asyncio.wrap_future(self._lane(lane).ask(job))

    async def in_lane(self, newest: bool, lane: str, job: Callable[[], Any]) -> Any:
        """As `newest`, or as `done`."""
        return await (self.newest(lane, job) if newest else self.done(job))

    def begin(self, lane: str, job: Callable[[], Any]) -> None:
        """A background job, before those of the lane."""
        self._lane(lane).ask(job)

    def end(self) -> None:
        """Begin nothing more of what only the newest counts of, and wait a while for
        what is in work: a process that ends within compiled code is aborted."""
        for lane in self._lanes.values():
            lane.end()
        until_s = time.monotonic() + _END_S
        for lane in self._lanes.values():
            lane.wait(max(until_s - time.monotonic(), 0.0))

    def _lane(self, name: str) -> LatestWins:
        if name not in self._lanes:
            self._lanes[name] = LatestWins(name)
        return self._lanes[name]

    def _count_finished(self, _future: Future) -> None:
        self._waiting -= 1


_DESCRIBED = 'correct it; "See it in the browser" of the guide describes messages'


async def message_of(request: Request, record: type) -> Any:
    """The JSON message that a request carries.

    Raises
    ------
    LensfitError : It is none, or malformed; the sentence says where.
    """
    kind = request.headers.get("content-type", "").partition(";")[0].strip()
    if kind != "application/json":
        raise LensfitError(
            "a message is JSON",
            remedy="send it with Content-Type: application/json",
        )
    try:
        return msgspec.json.decode(await request.body(), type=record)
    except msgspec.ValidationError as error:
        said = plain_complaint(str(error), record)
        raise LensfitError(said, remedy=_DESCRIBED) from None
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise LensfitError(
            f"the message is no JSON: {error}", remedy=_DESCRIBED
        ) from None


def page_routes(page_files: Mapping[str, str]) -> list[Route]:
    """The files of a page, read beforehand: a path is looked up, never opened.

    Parameters
    ----------
    page_files : File of this package by the path that it is served under.
    """
    found = []
    for path, name in page_files.items():
        content = files("lensfit").joinpath(name).read_bytes()
        kind = _KINDS[name.rpartition(".")[2]]
        found.append(Route(f"/{path}", _constant(content, kind), methods=["GET"]))
    return found


_KINDS = {"html": "text/html", "css": "text/css", "js": "text/javascript"}


def api_routes(gets: Mapping[str, Answer], posts: Mapping[str, Answer]) -> list[Route]:
    """What is answered under ``api/``, by name; errors as sentences."""
    return [
        Route(f"/api/{name}", errors_as_sentences(answer), methods=[method])
        for method, answers in (("GET", gets), ("POST", posts))
        for name, answer in answers.items()
    ]


def _constant(content: bytes, kind: str) -> Answer:
    async def answer(_request: Request) -> Response:
        return Response(content, media_type=kind)

    return answer


def png_answer(content: bytes) -> Response:
    """A picture."""
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
            status = getattr(error, "status", 422)
            return JSONResponse({"error": str(error)}, status)
        except asyncio.CancelledError:
            return Response(status_code=503)  # the process ends
        except Exception as error:  # whatever it was, the page says it
            return JSONResponse({"error": sentence_of(error)}, 500)

    return endpoint


_KEY = "length"
_DIGITS = 12
"""Of a length, so that 1.1 m is 1100 mm."""


class TypedLength(Struct, frozen=True, forbid_unknown_fields=True):
    """What was typed."""

    typed: Annotated[str, Meta(max_length=200)]


def typed_length_mm(typed: str) -> float:
    """Millimetres of a length with its unit, or of a number without.

    Raises
    ------
    LensfitError : It is no length.
    """
    with suppress(ValueError):
        if math.isfinite(number := float(typed)):
            return number
    try:
        found = length_mm(typed.strip(), _KEY, "")
    except ShootError as error:
        said = error.what.removeprefix(f"{_KEY} = ")
        raise LensfitError(said, remedy=error.remedy) from error
    return float(f"{found:.{_DIGITS}g}")


async def length_answer(request: Request) -> Response:
    """The millimetres, or "inf"."""
    found = typed_length_mm((await message_of(request, TypedLength)).typed)
    return JSONResponse({"mm": plain_distance(found)})
