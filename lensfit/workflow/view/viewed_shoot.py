"""Data of the page of a shoot: its photographs, its file, its calibration."""

import tempfile
import threading
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, final

from lensfit.errors import ShootError
from lensfit.workflow.check.check_records import Check
from lensfit.workflow.inspect import inspect_images
from lensfit.workflow.shoot.draft import drafted_take, write_draft_shoot
from lensfit.workflow.shoot.shoot_records import Shoot
from lensfit.workflow.view.calibration_run import CalibrationRun
from lensfit.workflow.view.checked_photographs import CheckedPhotographs
from lensfit.workflow.view.shoot_form import (
    Place,
    add_take,
    add_target,
    form_of,
    loaded_shoot,
    remove_table,
    require_named,
    set_field,
)
from lensfit.workflow.view.viewed_results import ViewedResults


@final
class ViewedShoot:
    """A shoot file, which may not be there yet, and the folder of its photographs.

    Parameters
    ----------
    path : The shoot file.
    images : Folder that its photographs count from; its own if None.
    out : Folder for the results of a calibration.
    """

    def __init__(self, path: Path, images: Path | None, out: Path):
        self.path, self.images, self.out = path, images, out
        self._changing = threading.Lock()
        self._pictures = tempfile.TemporaryDirectory(prefix="lensfit-view-")
        self.checked = CheckedPhotographs(
            self.folder, Path(self._pictures.name), self._shoot()
        )
        self.run = CalibrationRun(path, images, out)

    @property
    def folder(self) -> Path:
        """Of the photographs."""
        return self.images or self.path.parent

    def end(self) -> None:
        """Watch no more, and end a calibration that goes on."""
        self.checked.end()
        self.run.cancel()
        self._pictures.cleanup()

    def form(self) -> dict[str, Any]:
        """The shoot file as a form, as it is now; where it is none, what is wrong.

        Photographs are compared from now on with the plan that it states.
        """
        about = {"path": str(self.path.absolute()), "out": str(self.out.absolute())}
        about |= {"is_there": self.path.is_file()}
        if not self.path.is_file():
            self.checked.plan_is(None)
            return about | {"tables": [], "fault": None, "notes": [], "unconfirmed": []}
        form, shoot = form_of(self.path, self.images)
        if shoot is not None:  # else the last plan holds
            self.checked.plan_is(shoot)
        return about | form

    def set_field(self, where: Place, typed: str, named: str | None = None) -> None:
        """Set a key of the file.

        Parameters
        ----------
        named : As of `require_named`.

        Raises
        ------
        LensfitError : It cannot be that, or another table stands there now.
        """
        self._change(set_field, where, typed, still=(where, named))

    def add_target(self) -> None:
        """One more chart in the file.

        Raises
        ------
        LensfitError : The file cannot be changed.
        """
        self._change(add_target)

    def remove(self, table: str, place: int, named: str | None = None) -> None:
        """A chart or a photograph out of the file.

        Parameters
        ----------
        named : As of `require_named`.

        Raises
        ------
        LensfitError : The file cannot be changed, or another table stands there now.
        """
        meant = Place(table, place, None), named
        self._change(remove_table, table, place, still=meant)

    def draft(self) -> list[str]:
        """A shoot file from the photographs, or those that it lacks into it.

        Returns
        -------
        Names of photographs that were left out, as no chart was found on them.

        Raises
        ------
        LensfitError : There is no photograph that it lacks, or the file cannot be
            written.
        """
        with self._changing:
            lacking = self._lacking()
            if not lacking:
                raise ShootError(
                    "there is no photograph that the shoot file lacks",
                    where=self.folder,
                    remedy="drop some into the page, or put them there",
                )
            targets = {path: self._target_of(check) for path, check in lacking.items()}
            left_out = [path.name for path, name in targets.items() if name is None]
            wanted = {path: name for path, name in targets.items() if name is not None}
            if not wanted:
                raise ShootError(
                    f"no chart was found on {', '.join(left_out)}",
                    where=self.folder,
                    remedy="shoot again, add the chart to the shoot file, or write the "
                    "photograph into it by hand",
                )
            self._write(wanted)
            return left_out

    def _write(self, targets: Mapping[Path, str]) -> None:
        """Photographs of these charts, into the shoot file or into a new one."""
        inspections, errors = inspect_images(list(targets), charts=True)
        if errors:
            raise errors[0]
        if not self.path.is_file():
            write_draft_shoot(self.path, inspections)
            return
        for one in inspections:
            lines = drafted_take(one, self.path.parent, targets[one.path])
            add_take(self.path, self.images, lines)

    def _target_of(self, check: Check) -> str | None:
        """The chart that a photograph shows: the usual one of its kind; None where none
        was found. Before there is a shoot file nobody said what to look for."""
        shoot = self._shoot()
        if shoot is None:
            return ""
        of_kind = [n for n, one in shoot.targets.items() if one.kind == check.kind]
        if not check.points or not of_kind:
            return None
        used = [take.target for take in shoot.takes]
        return max(of_kind, key=used.count)

    def results(self) -> ViewedResults:
        """Of the last calibration.

        Raises
        ------
        LensfitError : There are none.
        """
        return ViewedResults(self.out)

    def _lacking(self) -> dict[Path, Check]:
        shoot = self._shoot()
        if shoot is None:
            if self.path.is_file():
                raise ShootError(
                    "has a fault, which comes first",
                    where=self.path,
                    remedy="mend what the form says",
                )
            known = set()
        else:
            known = {shoot.image_path(take).resolve() for take in shoot.takes}
        checks = self.checked.checks
        return {p: one for p, one in checks.items() if p.resolve() not in known}

    def _shoot(self) -> Shoot | None:
        return loaded_shoot(self.path, self.images) if self.path.is_file() else None

    def _change(
        self,
        change: Callable[..., None],
        *wanted: Any,
        still: tuple[Place, str | None] | None = None,
    ) -> None:
        """The file by a function of `shoot_form`; one change after the other.

        Parameters
        ----------
        still : A table and its name, which must stand there.
        """
        with self._changing:
            if still is not None:
                require_named(self.path, *still)
            change(self.path, self.images, *wanted)
