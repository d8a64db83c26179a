"""Photographs of a folder, each checked as it arrives, as `lensfit check` does."""

import threading
from dataclasses import asdict
from pathlib import Path
from typing import Any, NamedTuple, final

from lensfit.errors import LensfitError, sentence_of
from lensfit.workflow.check.check_records import Check
from lensfit.workflow.check.sentences import plan_sentence, sentences
from lensfit.workflow.check.session import CheckSession
from lensfit.workflow.check.watched_folder import new_photographs
from lensfit.workflow.shoot.shoot_records import Shoot


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
                self._found[path] = self._checked(path)
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

    def _checked(self, path: Path) -> CheckedPhotograph:
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
