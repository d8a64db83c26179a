"""What the page of a shoot and other programs are answered, over HTTP.

===========================  ======================================================
``GET  api/shoot``           the shoot file as a form, with what is wrong in it
``GET  api/checks``          every photograph with its check, and what to shoot next
``GET  api/picture/N``       what was found on a photograph, PNG
``GET  api/calibration``     how far it is: each stage, and its seconds so far
``POST api/photograph``      a photograph (``?name=``), written into the folder
``POST api/field``           set a key of the shoot file
``POST api/target, remove``  a chart more; a chart or photograph less
``POST api/draft``           photographs that the file lacks, into it; `left_out` are
                             those on which no chart of the file was found
``POST api/calibrate``       start a calibration
``POST api/cancel``          end it; earlier results stay
``GET  report``              the report at the end
===========================  ======================================================

The name of a photograph that a page hands over is a plain file name of a photograph;
nothing is ever replaced; a file appears when the last of it is there.
"""

import os
import tempfile
from collections.abc import AsyncIterator, Callable
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, final

from msgspec import Meta, Struct
from starlette.requests import Request
from starlette.responses import JSONResponse, Response
from starlette.routing import Route

from lensfit.bounded import read_bounded
from lensfit.errors import ImageError, LensfitError, OutputError
from lensfit.workflow.check.photographs import SUFFIXES
from lensfit.workflow.view.answers import (
    Answer,
    RequestQueue,
    api_routes,
    errors_as_sentences,
    message_of,
    page_routes,
    png_answer,
)
from lensfit.workflow.view.lens_server import report_answer
from lensfit.workflow.view.shoot_form import (
    MovedTableError,
    Place,
    beside_field,
    place_of_error,
)
from lensfit.workflow.view.viewed_shoot import ViewedShoot

LARGEST_BYTES = 2**30
_LONGEST_NAME = 200


def photograph_path(folder: Path, name: str) -> Path:
    """Where a photograph of that name will lie.

    Raises
    ------
    ImageError : That is no name of a photograph, or there is one already.
    """
    is_plain = name == Path(name).name and "\\" not in name and name.isprintable()
    if not is_plain or name.startswith(".") or len(name) > _LONGEST_NAME:
        raise ImageError(f"{name[:80]!r} is no plain file name")
    if Path(name).suffix.lower() not in SUFFIXES:
        known = ", ".join(sorted(SUFFIXES))
        raise ImageError("is no photograph", where=name, remedy=f"give one of {known}")
    path = folder / name
    if path.exists():
        raise ImageError(
            "is there already", where=path, remedy="give the photograph another name"
        )
    return path


async def keep_photograph(path: Path, content: AsyncIterator[bytes]) -> None:
    """Write what arrives; nothing of it stays where it ends before its time.

    Raises
    ------
    OutputError : It cannot be written.
    """
    try:
        handle, temporary = tempfile.mkstemp(dir=path.parent, prefix=".arriving.")
    except OSError as error:
        raise _cannot(path, error) from error
    try:
        with os.fdopen(handle, "wb") as file:
            async for piece in content:
                file.write(piece)
        os.chmod(temporary, 0o644)
        os.link(temporary, path)  # never in place of another
    except OSError as error:
        raise _cannot(path, error) from error
    finally:
        os.unlink(temporary)


def _cannot(path: Path, error: OSError) -> OutputError:
    return OutputError(f"cannot be written ({error.strerror})", where=path)


PAGE_FILES = {
    "": "workflow/view/shoot.html",
    "view.css": "workflow/view/view.css",
    "shoot.js": "workflow/view/shoot.js",
    "asker.js": "workflow/view/asker.js",
}
_LARGEST_PICTURE_BYTES = 64 * 2**20
_Name = Annotated[str, Meta(max_length=60)]
_Named = Annotated[str, Meta(max_length=4000)]
"""Of the chart, or the image of the photograph, that a form showed there."""
_Count = Annotated[int, Meta(ge=0, le=100_000)]


class Field(Struct, frozen=True, forbid_unknown_fields=True):
    """A key of the shoot file and what was typed into its field."""

    table: _Name
    key: _Name
    typed: Annotated[str, Meta(max_length=4000)]
    place: _Count | None = None
    named: _Named | None = None


class Table(Struct, frozen=True, forbid_unknown_fields=True):
    """A chart or a photograph of the shoot file."""

    table: _Name
    place: _Count
    named: _Named | None = None


class Calibrate(Struct, frozen=True, forbid_unknown_fields=True):
    """How a calibration is wanted."""

    effort: Literal["fastest", "fast", "normal", "best"] = "normal"


class EmptyMessage(Struct, frozen=True, forbid_unknown_fields=True):
    """A message without content; its address is enough."""


@final
class ShootServer:
    """Answers about a shoot."""

    uploads: ClassVar[dict[str, int]] = {"/api/photograph": LARGEST_BYTES}

    def __init__(self, viewed: ViewedShoot):
        self.viewed = viewed
        self._in_turn = RequestQueue()

    @property
    def routes(self) -> list[Route]:
        """Of the application."""
        gets: dict[str, Answer] = {
            "shoot": self.shoot, "checks": self.checks,
            "calibration": self.calibration,
        }  # fmt: skip
        posts: dict[str, Answer] = {
            "photograph": self.photograph, "field": self.field, "target": self.target,
            "remove": self.remove, "draft": self.draft, "calibrate": self.calibrate,
            "cancel": self.cancel,
        }  # fmt: skip
        picture, report = map(errors_as_sentences, (self.picture, self.report))
        return [
            *page_routes(PAGE_FILES),
            *api_routes(gets, posts),
            Route("/api/picture/{place:int}", picture, methods=["GET"]),
            Route("/report", report, methods=["GET"]),
        ]

    def begin(self) -> None:
        """What the page shows first is quick enough when it is requested."""

    def end(self) -> None:
        """End what goes on."""
        self._in_turn.end()
        self.viewed.end()

    async def shoot(self, _request: Request) -> Response:
        """The form."""
        return JSONResponse(await self._in_turn.done(self.viewed.form))

    async def checks(self, _request: Request) -> Response:
        """The photographs."""
        return JSONResponse(self.viewed.checked.state())

    async def calibration(self, _request: Request) -> Response:
        """How far it is."""
        return JSONResponse(self.viewed.run.state())

    async def picture(self, request: Request) -> Response:
        """What was found on a photograph."""
        path = self.viewed.checked.picture(request.path_params["place"])
        if path is None:
            raise ImageError("there is no picture of this photograph")
        said = "check the photograph again"
        content = read_bounded(
            path, _LARGEST_PICTURE_BYTES, error=ImageError, remedy=said
        )
        return png_answer(content)

    async def photograph(self, request: Request) -> Response:
        """A photograph that was dropped into the page."""
        kind = request.headers.get("content-type", "")
        if kind != "application/octet-stream":
            raise LensfitError("a photograph is sent as application/octet-stream")
        name = request.query_params.get("name", "")
        path = photograph_path(self.viewed.folder, name)
        await keep_photograph(path, request.stream())
        return JSONResponse({"path": str(path)})

    async def field(self, request: Request) -> Response:
        """A key of the file; what is wrong with it comes with its place."""
        sent: Field = await message_of(request, Field)
        where = Place(sent.table, sent.place, sent.key)
        try:
            await self._in_turn.done(
                lambda: self.viewed.set_field(where, sent.typed, sent.named)
            )
        except MovedTableError:
            raise
        except LensfitError as error:
            at = place_of_error(error)._asdict()
            said = beside_field(error, self.viewed.path)
            return JSONResponse({"error": said, **at}, 422)
        return await self.shoot(request)

    async def target(self, request: Request) -> Response:
        """A chart more."""
        await self._done(request, EmptyMessage, lambda _: self.viewed.add_target())
        return await self.shoot(request)

    async def remove(self, request: Request) -> Response:
        """A chart or photograph less; its file stays."""
        await self._done(
            request,
            Table,
            lambda one: self.viewed.remove(one.table, one.place, one.named),
        )
        return await self.shoot(request)

    async def draft(self, request: Request) -> Response:
        """Photographs that the file lacks."""
        await message_of(request, EmptyMessage)
        left_out = await self._in_turn.done(self.viewed.draft)
        form = await self._in_turn.done(self.viewed.form)
        return JSONResponse(form | {"left_out": left_out})

    async def calibrate(self, request: Request) -> Response:
        """Begin."""
        run = self.viewed.run
        await self._done(request, Calibrate, lambda one: run.start(one.effort))
        return await self.calibration(request)

    async def cancel(self, request: Request) -> Response:
        """End; earlier results stay."""
        await self._done(request, EmptyMessage, lambda _: self.viewed.run.cancel())
        return await self.calibration(request)

    async def _done(
        self, request: Request, record: type, job: Callable[[Any], None]
    ) -> None:
        """What a message wants, once what was wanted before is done."""
        message = await message_of(request, record)
        await self._in_turn.done(lambda: job(message))

    async def report(self, _request: Request) -> Response:
        """The report of the last calibration."""
        return report_answer(await self._in_turn.done(self.viewed.results))
