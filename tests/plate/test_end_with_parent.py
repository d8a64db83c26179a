"""Workers end with the run that started them, however it ended."""

import os
import signal
import subprocess
import sys
import time

import pytest

RUN = """
import multiprocessing, os, sys, time
from concurrent.futures import ProcessPoolExecutor
from lensfit.plate.frame.end_with_parent import end_with_parent

pool = ProcessPoolExecutor(
    1, multiprocessing.get_context("spawn"), end_with_parent if {watched} else None
)
print(pool.submit(os.getpid).result(), flush=True)
time.sleep(600)
"""


def alive(process: int) -> bool:
    """A zombie that nobody has collected yet is no more."""
    try:
        with open(f"/proc/{process}/stat") as stat:
            return stat.read().rpartition(")")[2].split()[0] != "Z"
    except FileNotFoundError:
        return False


@pytest.mark.skipif(not os.path.isdir("/proc/self"), reason="tells processes by /proc")
@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGTERM])
@pytest.mark.parametrize("watched", [True, False])
def test_a_worker_ends_with_a_killed_run(how, watched):
    text = RUN.format(watched=watched)
    with subprocess.Popen(
        [sys.executable, "-c", text], stdout=subprocess.PIPE, text=True
    ) as run:
        assert run.stdout is not None
        worker = int(run.stdout.readline())
        assert alive(worker)
        run.send_signal(how)
        run.wait(30)
        deadline = time.monotonic() + (30 if watched else 1)
        while alive(worker) and time.monotonic() < deadline:
            time.sleep(0.05)
        left = alive(worker)
        if left:
            os.kill(worker, signal.SIGKILL)
    # The worker that does not watch shows that the test can tell.
    assert left is not watched
