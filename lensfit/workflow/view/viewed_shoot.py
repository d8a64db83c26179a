"""Data of the page of a shoot: its photographs, its file, its calibration.

Each photograph is checked as it arrives, as `lensfit check` does.
"""

import tempfile
import threading
from collections.abc import Callable, Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any, NamedTuple, final

from lensfit.errors import LensfitError, ShootError, sentence_of
from lensfit.workflow.check.check_records import Check
from lensfit.workflow.check.photographs import new_photographs
from lensfit.workflow.check.sentences import plan_sentence, sentences
from lensfit.workflow.check.session import CheckSession
from lensfit.workflow.inspect import inspect_images
from lensfit.workflow.shoot.draft import drafted_take, write_draft_shoot
from lensfit.workflow.shoot.shoot_records import Shoot
from lensfit.workflow.view.calibration_run import CalibrationRun
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


class CheckedPhotograph(NamedTuple):
    """A photograph and its check.

    Attributes
    ----------
    check : None where it could not be read.
    failed : Why not.
    """

    path: Path
    check: Check | None
    failed: str | None


@final
class CheckedPhotographs:
    """A thread that checks what lies in a folder and what arrives there.

    Parameters
    ----------
    folder : Of the photographs.
    pictures : Where a picture of each check is drawn.
    shoot : The plan; None where there is none yet.
    """

    def __init__(self, folder: Path, pictures: Path, shoot: Shoot | None):
        self.folder = folder
        self._session = CheckSession(shoot, pictures)
        self._found: dict[Path, CheckedPhotograph] = {}
        self._busy: Path | None = None
        self._failed: str | None = None
        self._ended = threading.Event()
        threading.Thread(target=self._work, name="checks", daemon=True).start()

    def plan_is(self, shoot: Shoot | None) -> None:
        """Another plan counts from now on."""
        self._session.shoot = shoot

    def end(self) -> None:
        """Look no more."""
        self._ended.set()

    def state(self) -> dict[str, Any]:
        """Every photograph with its check, the plan, and what is being checked."""
        found = enumerate(list(self._found.values()))
        there = [(k, one) for k, one in found if one.path.is_file()]
        plan = self._session.plan
        return {
            "folder": str(self.folder.absolute()),
            "photographs": [_facts(k, one) for k, one in there],
            "checking": None if self._busy is None else self._busy.name,
            "plan": [asdict(view) for view in plan],
            "next": plan_sentence(plan) if plan else None,
            "failed": self._failed,
        }

    @property
    def checks(self) -> dict[Path, Check]:
        """Of photographs that could be read and are there, in the order of their
        arrival."""
        found = list(self._found.values())
        return {
            one.path: one.check
            for one in found
            if one.check is not None and one.path.is_file()
        }

    def picture(self, place: int) -> Path | None:
        """The picture of a check."""
        found = list(self._found.values())
        check = found[place].check if place < len(found) else None
        return None if check is None else check.picture

    def _work(self) -> None:
        try:
            for path in self._photographs():
                self._busy = path
                self._found[path] = self._checked_photograph(path)
                self._busy = None
        except LensfitError as error:
            self._failed = str(error)

    def _photographs(self):
        """Views of the plan that lie elsewhere, and the folder's own."""
        shoot = self._session.shoot
        for path in [] if shoot is None else map(shoot.image_path, shoot.takes):
            if path.is_file() and path.parent.resolve() != self.folder.resolve():
                yield path
        yield from new_photographs(self.folder, lambda: not self._ended.is_set())

    def _checked_photograph(self, path: Path) -> CheckedPhotograph:
        try:
            return CheckedPhotograph(path, self._session.check(path), None)
        except LensfitError as error:
            return CheckedPhotograph(path, None, str(error))
        except Exception as error:  # one photograph must not end the watch
            return CheckedPhotograph(path, None, sentence_of(error))


def _facts(place: int, one: CheckedPhotograph) -> dict[str, Any]:
    check = one.check
    facts: dict[str, Any] = {"name": one.path.name, "failed": one.failed}
    if check is None:
        return facts | {"level": "bad", "view": None, "lines": [], "problems": []}
    return facts | {
        "level": check.level,
        "view": check.take,
        "lines": [list(line) for line in sentences(check)],
        "problems": [asdict(problem) for problem in check.problems],
        "picture": None if check.picture is None else f"api/picture/{place}",
        "points": check.points,
        "covered": None if check.coverage is None else check.coverage.share,
    }


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
