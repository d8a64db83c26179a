"""End a process when the one that started it ends, however that happens.

A pool whose owner is killed, for instance by a farm's cancel, would otherwise wait for
work for ever: every worker holds both ends of the queue, so that no death closes it.
The file that a worker was writing stays a temporary file, which the next run removes.
"""

import multiprocessing
import os
import threading
from multiprocessing.connection import wait


def end_with_parent() -> None:
    """End this process as soon as its parent is no more; once per process.

    The process is not asked: it may be deep inside compiled code. One that
    `multiprocessing` did not start is left alone.
    """
    parent = multiprocessing.parent_process()
    if parent is not None:
        threading.Thread(target=_watch, args=(parent.sentinel,), daemon=True).start()


def _watch(sentinel: int) -> None:
    wait([sentinel])
    os._exit(1)
