"""Files of programs: a folder for each world, and safe in a process that knows none."""

import os
import subprocess
import sys
from typing import Any

import pytest

from lensfit import program_files

CALLS_LAPACK = """
import lensfit
import jax.numpy as jnp
from lensfit.programs import kept_program

@kept_program()
def roots(matrix):
    print("traced")
    return jnp.linalg.eigh(matrix)[0]

print(float(roots(jnp.diag(jnp.array([3.0, 2.0])))[0]))
"""


@pytest.fixture
def says(tmp_path):
    """What a new process prints that runs a program which calls LAPACK."""

    def run() -> list[str]:
        done = subprocess.run(
            [sys.executable, "-c", CALLS_LAPACK],
            env={**os.environ, "LENSFIT_CACHE_DIR": str(tmp_path / "cache")},
            capture_output=True,
            text=True,
            timeout=120,
        )
        assert done.returncode == 0, done.stderr
        return done.stdout.split()

    return run


def test_a_new_process_may_call_lapack_in_what_it_did_not_compile(says):
    assert says() == ["traced", "2.0"]
    assert says() == ["2.0"]


def test_changed_source_has_a_folder_of_its_own(monkeypatch):
    folder_of_world: Any = program_files.program_folder.__wrapped__
    before = folder_of_world()
    monkeypatch.setattr(program_files, "_source_digest", lambda: "changed")
    after = folder_of_world()
    assert before != after
    assert before.parent == after.parent


def test_only_the_worlds_used_last_are_kept(tmp_path):
    for age, name in enumerate(("new", "older", "oldest")):
        (tmp_path / name).mkdir()
        os.utime(tmp_path / name, (1e9 - age, 1e9 - age))
    program_files._keep_newest(tmp_path, 2)
    assert {path.name for path in tmp_path.iterdir()} == {"new", "older"}
    program_files._keep_newest(tmp_path / "none", 2)
