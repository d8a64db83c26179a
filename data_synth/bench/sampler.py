"""Where the time of a piece of work goes, by looking at it now and then.

A thread looks at the stacks of the other threads every few milliseconds and books the
time since it last looked on the stage of each thread that is at work. A stage is the
innermost file of lensfit on a stack; making JAX programs is a stage of its own,
whoever asked for it. Nothing is instrumented, so what is measured is what users run;
a stage that takes less than a hundredth of the whole is known roughly only.
"""

import sys
import threading
import time
from collections import defaultdict
from collections.abc import Callable
from pathlib import PurePath
from types import FrameType
from typing import Any, NamedTuple

COMPILING = "tracing and compilation"
ELSEWHERE = "elsewhere"
_EVERY_S = 0.004
_WAITING = frozenset({"threading.py", "queue.py", "_base.py"})
"""Files that are innermost in a thread which waits for another one."""
_COMPILERS = frozenset(
    {
        "backend_compile_and_load",
        "backend_compile",
        "compile_or_get_cached",
        "_infer_params",
        "lower_sharding_computation",
        "trace_to_jaxpr",
    }
)


class Sampled(NamedTuple):
    """What the work returned, and the wall seconds of each stage, largest first."""

    result: Any
    seconds: dict[str, float]


def sampled(work: Callable[[], Any]) -> Sampled:
    """Run it, watched.

    Where several threads work at once the time is shared evenly between them, so that
    the stages sum to the wall time.
    """
    seconds: dict[str, float] = defaultdict(float)
    over = threading.Event()
    watcher = threading.Thread(target=_watch, args=(seconds, over), daemon=True)
    watcher.start()
    try:
        result = work()
    finally:
        over.set()
        watcher.join()
    return Sampled(result, dict(sorted(seconds.items(), key=lambda one: -one[1])))


def _watch(seconds: dict[str, float], over: threading.Event) -> None:
    own, last = threading.get_ident(), time.perf_counter()
    while not over.wait(_EVERY_S):
        frames = sys._current_frames()
        now = time.perf_counter()
        stages = [_stage(frame) for ident, frame in frames.items() if ident != own]
        busy = [stage for stage in stages if stage is not None] or [ELSEWHERE]
        for stage in busy:
            seconds[stage] += (now - last) / len(busy)
        last = now


def _stage(frame: FrameType | None) -> str | None:
    """Of a thread; None if it waits for others or is none of lensfit's."""
    if frame is None or PurePath(frame.f_code.co_filename).name in _WAITING:
        return None
    found, compiling = None, False
    while frame is not None:
        path = PurePath(frame.f_code.co_filename)
        compiling |= frame.f_code.co_name in _COMPILERS and "jax" in path.parts
        if found is None and "lensfit" in path.parts and path.name != __file__:
            found = _named(path)
        frame = frame.f_back
    return COMPILING if compiling and found else found


def _named(path: PurePath) -> str:
    """The file from the package on: `rendering/warp`."""
    last = len(path.parts) - 1 - path.parts[::-1].index("lensfit")
    return "/".join(path.parts[last + 1 :]).removesuffix(".py")
