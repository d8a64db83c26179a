"""A calibration in a process of its own, which can be ended at any moment.

Its results are an atomic output set, so that ending it loses nothing: the results of an
earlier run stay. The page goes on meanwhile.
"""

import multiprocessing
import os
import signal
import threading
import time
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, NamedTuple, final

from lensfit.atomic_set import remove_unfinished
from lensfit.errors import LensfitError, sentence_of
from lensfit.plate.frame.end_with_parent import end_with_parent

_NICE = 5
_DIED = "the calibration's process died; memory may have run out"


@final
class CalibrationRun:
    """One calibration at a time of one shoot.

    Parameters
    ----------
    shoot : The shoot file.
    images : Folder that its photographs count from; its own if None.
    out : Folder of the results.
    """

    def __init__(self, shoot: Path, images: Path | None, out: Path):
        self.shoot, self.images, self.out = shoot, images, out
        self._lock = threading.Lock()
        self._process: Any = None
        self._state: dict[str, Any] = {"state": "idle"}
        self._stages = StageTimes()

    def start(self, effort: str) -> None:
        """Begin.

        Raises
        ------
        LensfitError : One goes on already.
        """
        with self._lock:
            if self._state["state"] == "running":
                raise LensfitError("a calibration goes on already", remedy="cancel it")
            self._state, self._stages = {"state": "running"}, StageTimes()
            context = multiprocessing.get_context("spawn")
            ours, theirs = context.Pipe(duplex=False)
            wanted = self.shoot, self.images, self.out, effort
            self._process = context.Process(
                target=calibrate_and_tell, args=(theirs, *wanted), daemon=True
            )
            self._process.start()
            theirs.close()
        threading.Thread(
            target=self._listen, args=(ours, self._process), daemon=True
        ).start()

    def cancel(self) -> None:
        """End it; what an earlier run wrote stays."""
        with self._lock:
            process, was = self._process, self._state["state"]
            if process is None or was != "running":
                return
            self._state = {"state": "cancelled"}
        process.kill()
        process.join()
        remove_unfinished(self.out)

    def state(self) -> dict[str, Any]:
        """How far it is: "idle", "running", "done", "failed" or "cancelled", and each
        stage."""
        with self._lock:
            running = self._state["state"] == "running"
            return self._state | {"stages": self._stages.facts(running)}

    def _listen(self, pipe: Connection, process: Any) -> None:
        end: dict[str, Any] = {"state": "failed", "error": _DIED}
        try:
            while True:
                kind, what = pipe.recv()
                if kind == "stage":
                    self._stages.tell(*what)
                else:
                    end = {"state": kind, **what}
        except (EOFError, OSError):
            process.join()
        with self._lock:
            if self._process is process and self._state["state"] == "running":
                self._state = end


@final
class StageTimes:
    """How far each stage is, and how long it took so far.

    No time left is told: steps of a fit take from a second to minutes. A stage that
    begins anew, for another state of the lens or with what a later stage corrected, is
    in its next round.
    """

    def __init__(self):
        self._stages: dict[str, _Stage] = {}

    def tell(self, stage: str, done: int, total: int) -> None:
        """As a `lensfit.progress.Progress`."""
        now = time.monotonic()
        before = self._stages.get(stage, _Stage(done, total, now, now))
        if done < before.done:
            before = before._replace(
                began_s=now - (before.last_s - before.began_s), round=before.round + 1
            )
        self._stages[stage] = before._replace(done=done, total=total, last_s=now)

    def facts(self, running: bool) -> list[dict[str, Any]]:
        """Each stage in order: steps done of all, in which round, seconds so far."""
        now = time.monotonic()
        found = []
        for name, one in list(self._stages.items()):
            is_done = bool(one.total) and one.done >= one.total
            until = one.last_s if is_done or not running else now
            found.append(
                {
                    "stage": name, "done": one.done, "total": one.total,
                    "round": one.round, "seconds": until - one.began_s,
                }
            )  # fmt: skip
        return found


class _Stage(NamedTuple):
    """Steps of a stage, and when it was reported.

    Attributes
    ----------
    began_s : As if its rounds had followed each other without a pause.
    """

    done: int
    total: int
    began_s: float
    last_s: float
    round: int = 1


def calibrate_and_tell(
    pipe: Connection, shoot: Path, images: Path | None, out: Path, effort: str
) -> None:
    """The life of the process: how far it is, and what became of it."""
    end_with_parent()
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # who started it hears it, and ends it
    if hasattr(os, "nice"):
        os.nice(_NICE)  # the page comes first
    from lensfit.workflow.calibrate import calibrate
    from lensfit.workflow.shoot.shoot_file import load_shoot

    def progress(stage: str, done: int, total: int) -> None:
        pipe.send(("stage", (stage, done, total)))

    try:
        report = calibrate(
            load_shoot(shoot, images), out, progress=progress, effort=effort
        )
    except LensfitError as error:
        pipe.send(("failed", {"error": str(error)}))
        return
    except Exception as error:  # the page says it
        pipe.send(("failed", {"error": sentence_of(error)}))
        return
    failed = [f"{t['image']}: {t['failed']}" for t in report["takes"] if t["failed"]]
    verdict = {key: report["verdict"][key] for key in ("headline", "level")}
    pipe.send(("done", verdict | {"failed": failed}))
