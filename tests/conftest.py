"""Strictness for every test: float64, no silent promotion, one data folder."""

import functools
import gc
import os
from collections.abc import Iterator
from pathlib import Path

# Before numpy is loaded, for the workers of the tests and what they start as well:
# there is a worker for each core, and threads of OpenBLAS that wait for one another
# cost several times what its small matrices do. Commands limit it to one thread, too.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import jax
import pytest
import typer.testing

from lensfit.programs import make_room_for_programs

jax.config.update("jax_enable_x64", True)
jax.config.update("jax_numpy_rank_promotion", "raise")
jax.config.update("jax_numpy_dtype_promotion", "strict")

# Tracing makes millions of small objects, nearly none of them garbage: as often as
# Python looks for it by itself, a fifth of the processor's time goes there.
gc.set_threshold(50_000, 20, 50)


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark tests that need the data folder, so that they can be run by themselves."""
    for item in items:
        if "data_dir" in getattr(item, "fixturenames", ()):
            item.add_marker("data")


@pytest.fixture(scope="session")
def data_dir() -> Path:
    """The folder of real photographs and oracle data, when this machine has it."""
    folder = os.environ.get("LENSFIT_DATA")
    if not folder:
        pytest.skip("LENSFIT_DATA does not name the data folder")
    return Path(folder)


@pytest.fixture(autouse=True, scope="session")
def _one_command_line() -> Iterator[None]:
    """Typer's runner builds all commands anew for each run of one; here they are built
    once, as in a process of their own."""
    built = functools.cache(typer.main.get_command)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(typer.testing, "_get_command", built)
        yield


@pytest.fixture(autouse=True, scope="module")
def _room_for_programs() -> Iterator[None]:
    yield
    make_room_for_programs()
