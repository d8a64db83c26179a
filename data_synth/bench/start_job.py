"""One job in a process of its own, timed from its first import on (`bench.start`).

Told the job's name and the data folder; prints one line of JSON.
"""

import json
import statistics
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

_BEGAN = time.perf_counter()
_RUNS = 3
_COMPILED = "/jax/core/compile/backend_compile_duration"
"""JAX's own name of what a program took to compile."""


def _fit(data: Path) -> Callable[[], Any]:
    from data_synth.bench.sets import chosen_sets, shoot_of
    from data_synth.bench.start import START_SET
    from lensfit.fitting.chief_ray import fit_chief_ray
    from lensfit.progress import silent
    from lensfit.workflow.calibration.observe import observe_shoot

    shoot = shoot_of(chosen_sets(START_SET)[0], data)

    def work() -> Any:
        observed = observe_shoot(shoot, None, silent)
        return fit_chief_ray([one.take for one in observed if one.take is not None])

    return work


def _render(data: Path) -> Callable[[], Any]:
    from data_synth.bench.render.scenes import camera_of_plate, plate_scene
    from lensfit.preset.thin_lens import thin_lens_preset

    camera = camera_of_plate(data)

    def work() -> Any:
        scene = plate_scene(data, thin_lens_preset(camera), camera)
        return scene.render(1e-3)

    return work


def _compile_times() -> list[float]:
    """Grows by what every program takes, from now on."""
    import jax

    found: list[float] = []

    def heard(event: str, duration_secs: float, **_: Any) -> None:
        if event == _COMPILED:
            found.append(duration_secs)

    jax.monitoring.register_event_duration_secs_listener(heard)
    return found


def _main(job: str, data: Path) -> None:
    work = {"fit": _fit, "render": _render}[job](data)
    compiled = _compile_times()
    imported = time.perf_counter()
    seconds = []
    for _ in range(1 + _RUNS):
        began = time.perf_counter()
        work()
        seconds.append(time.perf_counter() - began)
    found = {
        "import_s": imported - _BEGAN,
        "compiled_s": sum(compiled),
        "first_s": seconds[0],
        "steady_s": statistics.median(seconds[1:]),
    }
    sys.stdout.write(json.dumps(found) + "\n")


if __name__ == "__main__":
    _main(sys.argv[1], Path(sys.argv[2]))
