"""One thread that works for an impatient asker: only the newest request waits.

While a picture is made others may be asked for; each takes the place of the one that
waited before it, which is given up. So there is never more than one picture behind the
one in work, and the last one asked for is always made.
"""

import threading
from collections.abc import Callable
from concurrent.futures import Future
from typing import Any, final


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
        self._changed = threading.Condition()
        self._waiting: tuple[Callable[[], Any], Future] | None = None
        threading.Thread(target=self._work, name=name, daemon=True).start()

    def ask(self, job: Callable[[], Any]) -> Future:
        """The future result of `job`; `Superseded` if a newer one came before it."""
        future: Future = Future()
        with self._changed:
            given_up, self._waiting = self._waiting, (job, future)
            self._changed.notify()
        if given_up is not None and given_up[1].set_running_or_notify_cancel():
            given_up[1].set_exception(Superseded())
        return future

    def _work(self) -> None:
        while True:
            with self._changed:
                while self._waiting is None:
                    self._changed.wait()
                (job, future), self._waiting = self._waiting, None
            if not future.set_running_or_notify_cancel():
                continue
            try:
                future.set_result(job())
            except BaseException as error:  # the asker is told, and the thread goes on
                future.set_exception(error)
            del job, future
