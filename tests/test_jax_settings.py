"""How JAX is told about cores: before it starts, by whoever fits, nobody else."""

import os
import subprocess
import sys

import pytest

from lensfit.cores import available_cores

COUNT = "import jax; print(len(jax.devices()), jax.config.jax_enable_x64)"


def devices(*imports: str, **environment: str) -> list[str]:
    """What JAX says in a process that imports these."""
    lines = [*(f"import {name}" for name in imports), COUNT]
    known = {k: v for k, v in os.environ.items() if k != "JAX_NUM_CPU_DEVICES"}
    done = subprocess.run(
        [sys.executable, "-c", "\n".join(lines)],
        env=known | environment,
        capture_output=True,
        text=True,
        check=True,
    )
    return done.stdout.split()


@pytest.mark.skipif(available_cores() < 2, reason="there is one core")
@pytest.mark.parametrize("job", ["calibrate", "demo"])
def test_a_fit_has_a_device_for_every_core(job):
    """Whatever else is loaded before the fit: presets have been seen to start JAX."""
    count, wide = devices("lensfit.preset.lens_of_entry", f"lensfit.workflow.{job}")
    assert 2 <= int(count) <= 8
    assert wide == "True"


def test_the_renderer_has_one():
    assert devices("lensfit.workflow.apply") == ["1", "True"]


def test_what_the_user_asked_for_stays():
    found = devices("lensfit.workflow.calibrate", JAX_NUM_CPU_DEVICES="1")
    assert found == ["1", "True"]


def test_a_jax_that_runs_already_keeps_its_devices():
    count = "jax.numpy as jnp; jnp.zeros(1)"
    assert devices(count, "lensfit.workflow.calibrate")[0] == "1"


def test_a_program_that_is_kept_by_half_is_compiled_without_a_word(tmp_path):
    """As another process may just be writing it."""
    script = "import lensfit, jax; print(jax.jit(lambda x: x * 3.0)(14.0))"

    def run() -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            [sys.executable, "-c", script],
            env=os.environ | {"LENSFIT_CACHE_DIR": str(tmp_path)},
            capture_output=True,
            text=True,
            check=True,
        )

    assert run().stdout.strip() == "42.0"
    kept = [path for path in tmp_path.rglob("*-cache") if path.is_file()]
    assert kept
    for path in kept:
        path.write_bytes(path.read_bytes()[:20])
    again = run()
    assert again.stdout.strip() == "42.0"
    assert again.stderr == ""
