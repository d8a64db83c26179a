"""What the page of a plate and other programs are answered, over HTTP.

=======================  ==========================================================
``GET  api/lens``        what the lens and the plate say, controls, verdict
``POST api/start``       what the lens and the plate say of a frame now
``POST api/render``      a frame: PNG, or the EXR that `lensfit apply` writes
``POST api/plate``       the plate as it is, PNG
``POST api/view``        displays, views and colour spaces of an OpenColorIO config
``POST api/plan``        what `lensfit plan` says
``POST api/focus``       the focus distance of what lies at a pixel
``POST api/command``     the command line that renders what is turned
``POST api/save``        the same into the shot's settings file
``POST api/length``      millimetres of a length as people write it
``POST api/edit``        knobs as a version of the lens in its library (who, why)
=======================  ==========================================================

A body is JSON: what is turned (`LensAdjustments`) and what is asked of it.
"""

from functools import partial
from typing import Annotated, Any, ClassVar, Literal, final

from msgspec import Meta, Struct
from starlette.requests import Request
from starlette.responses import JSONResponse, Response
from starlette.routing import Route

from lensfit.preset.library.edit import Author
from lensfit.report.plain_numbers import plain_distance
from lensfit.workflow.view.answers import (
    Answer,
    RequestQueue,
    api_routes,
    length_answer,
    message_of,
    page_routes,
    png_answer,
)
from lensfit.workflow.view.lens_adjustments import (
    LensAdjustments,
    LibraryLens,
    StartCommand,
    command_line,
    knob_controls,
    require_valid_adjustments,
    save_edit,
)
from lensfit.workflow.view.screen_picture import (
    ENVIRONMENT,
    ViewTransform,
    config_choices,
    config_names,
    screen_png,
)
from lensfit.workflow.view.viewed_plate import Quality, ViewedPlate

PAGE_FILES = {
    "": "workflow/view/plate.html",
    "view.css": "workflow/view/view.css",
    "plate.js": "workflow/view/plate.js",
    "controls.js": "workflow/view/controls.js",
    "colours.js": "workflow/view/colours.js",
    "asker.js": "workflow/view/asker.js",
}
Stops = Annotated[float, Meta(ge=-20, le=20)]


class Query(LensAdjustments, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A query about the adjusted lens."""

    exposure_stops: Stops = 0.0
    view: ViewTransform | None = None
    newest: bool = False


class Render(Query, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A frame that is wanted."""

    quality: Quality = "full"
    format: Literal["png", "exr"] = "png"


class Config(Struct, frozen=True, forbid_unknown_fields=True):
    """An OpenColorIO config that may be chosen."""

    config: Annotated[str, Meta(max_length=200)]


class Edit(LensAdjustments, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Adjustments to be recorded."""

    who: Annotated[str, Meta(max_length=200)]
    why: Annotated[str, Meta(max_length=2000)]


class Focus(LensAdjustments, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A pixel of the frame, from its upper left corner."""

    x: Annotated[float, Meta(ge=0, le=1e6)]
    y: Annotated[float, Meta(ge=0, le=1e6)]


@final
class PlateServer:
    """Answers about a preset on a plate.

    Parameters
    ----------
    started : Words of the command, for the command line that does the same.
    shelved : The lens of the library that this is; None outside one.
    """

    def __init__(
        self,
        viewed: ViewedPlate,
        started: StartCommand,
        shelved: LibraryLens | None = None,
    ):
        self.viewed, self.started, self.shelved = viewed, started, shelved
        self._in_turn = RequestQueue()

    uploads: ClassVar[dict[str, int]] = {}

    def end(self) -> None:
        """End what goes on."""
        self._in_turn.end()

    def begin(self) -> None:
        """Make the first picture while the browser starts, which asks for it then."""
        quality = self.viewed.plate(0).qualities[0]
        self._in_turn.begin(
            quality, lambda: self.viewed.pixels(LensAdjustments(), quality)
        )

    @property
    def routes(self) -> list[Route]:
        """Of the application."""
        answers: dict[str, Answer] = {
            "render": self.render, "plate": self.plate, "plan": self.plan,
            "focus": self.focus, "command": self.command, "save": self.save,
            "edit": self.edit, "view": self.view, "start": self.start,
            "length": length_answer,
        }  # fmt: skip
        return page_routes(PAGE_FILES) + api_routes({"lens": self.lens}, answers)

    async def lens(self, _request: Request) -> Response:
        """The start values of the first frame, the controls and the verdict."""
        preset = self.viewed.preset
        start = await self._in_turn.done(lambda: self.viewed.start(0))
        configs = await self._in_turn.done(config_names)
        verdict = preset.verdict and {
            "level": preset.verdict.level,
            "headline": preset.verdict.headline,
        }
        return JSONResponse(
            {
                "lens": preset.lens.name,
                "verdict": verdict,
                "settings": str(self.viewed.settings_path),
                "shelved": self.shelved and self.shelved.name,
                "groups": knob_controls(),
                "configs": configs,
                "config": ENVIRONMENT if ENVIRONMENT in configs else None,
                **start,
            }
        )

    async def start(self, request: Request) -> Response:
        """The start values of a frame, as the files state them now."""
        query = await self._read(request, Query)
        found = await self._in_turn.done(lambda: self.viewed.start(query.frame))
        return JSONResponse(found)

    async def render(self, request: Request) -> Response:
        """A frame through the lens."""
        query = await self._read(request, Render)
        viewed = self.viewed
        if query.format == "exr":
            exr = await self._in_turn.done(lambda: viewed.frame_exr(query))
            return Response(exr, media_type="image/x-exr")

        def picture() -> bytes:
            pixels = viewed.pixels(query, query.quality)
            return screen_png(pixels, query.exposure_stops, query.view)

        made = await self._in_turn.in_lane(query.newest, query.quality, picture)
        return png_answer(made)

    async def plate(self, request: Request) -> Response:
        """The plate itself."""
        query = await self._read(request, Query)

        def picture() -> bytes:
            pixels = self.viewed.plate_pixels(query.frame)
            return screen_png(pixels, query.exposure_stops, query.view)

        return png_answer(await self._in_turn.done(picture))

    async def view(self, request: Request) -> Response:
        """What an OpenColorIO config offers."""
        name = (await message_of(request, Config)).config
        return JSONResponse(await self._in_turn.done(lambda: config_choices(name)))

    async def plan(self, request: Request) -> Response:
        """Stages, error, seconds and memory."""
        query = await self._read(request, Query)
        plan = partial(self.viewed.plan, query)
        return JSONResponse(await self._in_turn.in_lane(query.newest, "plan", plan))

    async def focus(self, request: Request) -> Response:
        """What is sharp at a pixel."""
        query = await self._read(request, Focus)
        found = await self._in_turn.done(
            lambda: self.viewed.focus_distance_mm(query, query.x, query.y)
        )
        return JSONResponse({"focus_distance_mm": plain_distance(found)})

    async def command(self, request: Request) -> Response:
        """The command line."""
        query = await self._read(request, LensAdjustments)
        return JSONResponse({"command": command_line(self.started, query)})

    async def save(self, request: Request) -> Response:
        """The settings file."""
        query = await self._read(request, LensAdjustments)
        saved = await self._in_turn.done(lambda: self.viewed.save(query))
        path = str(self.viewed.settings_path)
        return JSONResponse({"path": path, **saved._asdict()})

    async def edit(self, request: Request) -> Response:
        """A version of the lens in its library."""
        query = await self._read(request, Edit)
        author = Author(query.who, query.why)
        name = await self._in_turn.done(lambda: save_edit(self.shelved, query, author))
        return JSONResponse({"version": name})

    async def _read(self, request: Request, record: type) -> Any:
        return require_valid_adjustments(
            self.viewed.preset, await message_of(request, record)
        )
