"""What the page of a lens and other programs are answered, over HTTP.

=======================  ==========================================================
``GET  api/lens``        the lenses, what they are opened at, controls, photographs
``POST api/field``       point-spread functions over the field, and their errors
``POST api/point``       that of one point in colour, and its deviation
``POST api/through``     that point through focus and through the aperture
``POST api/figures``     distortion, lateral colour, fall-off, breathing, as SVG
``POST api/length``      millimetres of a length as people write it
``GET  api/dots/N``      dots of a photograph beside their model, PNG
``GET  report``          the report of a folder of results
=======================  ==========================================================

A body is JSON: `LensQuery`. Pictures are ``data:`` addresses of PNG.
"""

from typing import Any, ClassVar, Literal, final, get_args

from starlette.requests import Request
from starlette.responses import HTMLResponse, JSONResponse, Response
from starlette.routing import Route

from lensfit.errors import LensfitError
from lensfit.workflow.view.answers import (
    Answer,
    RequestQueue,
    api_routes,
    errors_as_sentences,
    length_answer,
    message_of,
    page_routes,
    png_answer,
)
from lensfit.workflow.view.lens_adjustments import (
    knob_controls,
    require_valid_adjustments,
)
from lensfit.workflow.view.viewed_lens import LensQuery, Tiles, ViewedLens
from lensfit.workflow.view.viewed_results import ViewedResults

PAGE_FILES = {
    "": "workflow/view/lens.html",
    "view.css": "workflow/view/view.css",
    "figures.css": "report/figures.css",
    "lens.js": "workflow/view/lens.js",
    "controls.js": "workflow/view/controls.js",
    "asker.js": "workflow/view/asker.js",
    "letters.js": "workflow/view/letters.js",
}
REPORT_POLICY = (
    "sandbox allow-scripts; default-src 'none'; img-src data:; "
    "style-src 'unsafe-inline'; script-src 'unsafe-inline'; frame-ancestors 'none'"
)
"""A report may come from elsewhere: it shows, and may ask this process nothing."""
_NO_RESULTS = "no folder of results is looked at"


def report_answer(results: ViewedResults) -> Response:
    """The report of a folder of results."""
    headers = {"content-security-policy": REPORT_POLICY}
    return HTMLResponse(results.page(), headers=headers)


@final
class LensServer:
    """Answers about one preset, or two side by side.

    Parameters
    ----------
    lenses : One or two.
    results : The folder that the first came from, if it did.
    """

    def __init__(self, lenses: list[ViewedLens], results: ViewedResults | None = None):
        self.lenses, self.results = lenses, results
        self._in_turn = RequestQueue()

    uploads: ClassVar[dict[str, int]] = {}

    def begin(self) -> None:
        """What the page shows first is quick enough when it is requested."""

    def end(self) -> None:
        """End what goes on."""
        self._in_turn.end()

    @property
    def routes(self) -> list[Route]:
        """Of the application."""
        posts: dict[str, Answer] = {"figures": self._answer("figures")}
        posts |= {name: self._answer(name) for name in get_args(Tiles)}
        posts["length"] = length_answer
        dots, report = map(errors_as_sentences, (self.dots, self.report))
        return [
            *page_routes(PAGE_FILES),
            *api_routes({"lens": self.lens}, posts),
            Route("/api/dots/{place:int}", dots, methods=["GET"]),
            Route("/report", report, methods=["GET"]),
        ]

    async def lens(self, _request: Request) -> Response:
        """The lenses and the controls."""
        results = self.results
        shown = [] if results is None else [one.about for one in results.dots]
        groups = [g for g in knob_controls() if g["name"] != "Look"]
        return JSONResponse(
            {
                "lenses": [one.start() for one in self.lenses],
                "groups": groups,
                "dots": shown,
                "report": results is not None and results.has_page,
            }
        )

    async def dots(self, request: Request) -> Response:
        """Dots of a photograph beside their model."""
        return png_answer(self._results.picture(request.path_params["place"]))

    async def report(self, _request: Request) -> Response:
        """The report, which may ask this process nothing."""
        return report_answer(self._results)

    @property
    def _results(self) -> ViewedResults:
        if self.results is None:
            raise LensfitError(_NO_RESULTS)
        return self.results

    def _least_mm(self, name: Tiles, wanted: LensQuery) -> float:
        """Width that tiles of the other lens have, so that both are on one scale."""
        if not wanted.one_scale:
            return 0.0
        others = [one for k, one in enumerate(self.lenses) if k != wanted.lens]
        try:
            return max((one.width_mm(name, wanted) for one in others), default=0.0)
        except LensfitError:  # which its own column says
            return 0.0

    def _answer(self, name: Literal["figures"] | Tiles) -> Answer:
        async def answer(request: Request) -> Response:
            wanted: LensQuery = await message_of(request, LensQuery)
            if wanted.lens >= len(self.lenses):
                raise LensfitError("there is one lens here", remedy="leave lens out")
            viewed = self.lenses[wanted.lens]
            require_valid_adjustments(viewed.preset, wanted)

            def found() -> Any:
                if name == "figures":
                    return viewed.figures(wanted)
                return getattr(viewed, name)(wanted, self._least_mm(name, wanted))

            lane = f"{name} {wanted.lens}"
            return JSONResponse(await self._in_turn.in_lane(wanted.newest, lane, found))

        return answer
