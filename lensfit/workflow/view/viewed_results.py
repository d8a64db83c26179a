"""Data of the page of a folder of results: dots beside their model, and the report.

A report names pictures; only those inside its folder are shown, and only under numbers.
"""

import shlex
from pathlib import Path
from typing import Any, NamedTuple, final

from lensfit.bounded import read_bounded
from lensfit.errors import ImageError, ShootError
from lensfit.report.report_page import is_inside, read_report
from lensfit.workflow.calibration.results_folder import PRESET, REPORT

PAGE, SHOOT = "report.html", "shoot.toml"
_LARGEST_BYTES = 64 * 2**20
_GONE = 'calibrate again, or write the page anew with "lensfit report"'


class Dots(NamedTuple):
    """The fitted dots of a photograph.

    Attributes
    ----------
    about : The photograph, its state and how far the model is from it.
    picture : Photograph, model and what is left, or the photograph with what was found.
    """

    about: dict[str, Any]
    picture: Path


@final
class ViewedResults:
    """Results of `lensfit calibrate`.

    Raises
    ------
    LensfitError : The folder holds no report.
    """

    def __init__(self, folder: Path):
        self.folder = folder
        _require_results(folder)
        report = read_report(folder / REPORT)
        self.dots = tuple(_dots(report, folder))
        self.has_page = (folder / PAGE).is_file()

    @property
    def preset(self) -> Path:
        """The file of the lens."""
        return self.folder / PRESET

    def picture(self, place: int) -> bytes:
        """A picture of `dots`.

        Raises
        ------
        ImageError : There is none.
        """
        if place >= len(self.dots):
            raise ImageError(f"there is no picture {place}", where=self.folder)
        return _content(self.dots[place].picture)

    def page(self) -> bytes:
        """The report.

        Raises
        ------
        ImageError : It is gone.
        """
        return _content(self.folder / PAGE)


def _require_results(folder: Path) -> None:
    """Name the shoot file, where a folder holds that in place of results.

    Raises
    ------
    ShootError : It does.
    """
    shoot = folder / SHOOT
    if shoot.is_file() and not (folder / REPORT).exists():
        raise ShootError(
            f"holds a shoot ({SHOOT}) and no results",
            where=folder,
            remedy=f"lensfit view {shlex.quote(str(shoot))}",
        )


def _content(path: Path) -> bytes:
    return read_bounded(path, _LARGEST_BYTES, error=ImageError, remedy=_GONE)


def _dots(report: dict[str, Any], folder: Path) -> list[Dots]:
    """Of every photograph whose blur was fitted, with its state."""
    takes = {take.get("image"): take for take in report.get("takes") or []}
    found = []
    for blur in report.get("blur") or []:
        for one in blur.get("takes") or []:
            name, take = one.get("picture"), takes.get(one.get("image")) or {}
            if not name or not is_inside(folder, name):
                continue
            about = {
                key: take.get(key)
                for key in (
                    "focal_length_mm", "f_number", "focus_distance_mm",
                    "target_distance_mm",
                )
            }  # fmt: skip
            about |= {key: one.get(key) for key in ("image", "dots", "misfit")}
            found.append(Dots(about, folder / name))
    return found
