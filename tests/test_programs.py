"""Programs that are kept run without being traced; what cannot be kept runs anyway."""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from lensfit import programs
from lensfit.programs import KeptProgram, forget_programs

traced = []


class Pair(NamedTuple):
    first: jax.Array
    second: jax.Array


def twice(value):
    return 2 * value


def thrice(value):
    return 3 * value


def weighed(pair, weight, function=twice):
    """Notes that it was traced."""
    traced.append(function)
    return Pair(function(pair.first) * weight, jnp.sum(pair.second))


class Module(eqx.Module):
    value: jax.Array


def in_module(value):
    return Module(value)


def program():
    """As a process has it that has just begun."""
    return KeptProgram(weighed, ("function",))


PAIR = Pair(jnp.arange(3.0), jnp.ones((2, 2)))


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    monkeypatch.setattr(programs, "program_folder", lambda: tmp_path)
    monkeypatch.setattr(programs, "_kept", [])
    traced.clear()
    return tmp_path


def test_another_process_runs_it_without_tracing():
    first = program()(PAIR, 1.5)
    assert len(traced) == 1
    again = program()(PAIR, 2.0)
    assert len(traced) == 1
    np.testing.assert_array_equal(again.first, 2.0 * first.first / 1.5)
    assert again.second == 4.0


@pytest.mark.parametrize(
    "other",
    [
        lambda: (PAIR._replace(first=jnp.arange(4.0)), 1.5),
        lambda: (PAIR._replace(first=jnp.arange(3, dtype=jnp.float32)), 1.5),
        lambda: (PAIR, np.float64(1.5)),
        lambda: (PAIR, 1.5, thrice),
    ],
)
def test_other_shapes_types_and_static_arguments_are_other_programs(other, folder):
    program()(PAIR, 1.5)
    found = program()(*other())
    assert len(traced) == 2
    assert len(list(folder.iterdir())) == 2
    expected = weighed(*other())
    np.testing.assert_allclose(found.first, expected.first)


def test_a_damaged_file_is_compiled_again(folder):
    program()(PAIR, 1.5)
    (path,) = folder.iterdir()
    whole = path.read_bytes()
    for damaged in (whole[:100], b"", whole[:-1] + bytes([whole[-1] ^ 1])):
        path.write_bytes(damaged)
        traced.clear()
        assert program()(PAIR, 1.5).second == 4.0
        assert len(traced) == 1
        assert program()(PAIR, 1.5).second == 4.0
        assert len(traced) == 1, "the file was not mended"


def test_a_program_that_does_not_run_here_is_traced(monkeypatch):
    def fails(**_):
        raise jax.errors.JaxRuntimeError("NOT_FOUND: function fusion.1")

    monkeypatch.setattr(programs, "read_program", lambda *_: fails)
    mine = program()
    assert mine(PAIR, 1.5).second == 4.0
    assert mine(PAIR, 1.5).second == 4.0
    assert len(traced) == 1


def test_modules_cannot_be_results():
    with pytest.raises(TypeError, match="is not the same after a file"):
        KeptProgram(in_module, ())(jnp.ones(1))


def test_it_can_be_mapped_and_differentiated(folder):
    slope = jax.grad(lambda w: jnp.sum(program()(PAIR, w).first))(1.0)
    assert slope == 6.0
    mapped = jax.vmap(lambda w: program()(PAIR, w).first)(jnp.arange(2.0))
    np.testing.assert_array_equal(mapped[1], [0.0, 2.0, 4.0])
    assert list(folder.iterdir()) == []


def test_nothing_is_kept_without_a_folder_or_of_what_has_no_lasting_name(
    monkeypatch, folder
):
    class Nameless:
        def __call__(self, value):
            return value

    assert program()(PAIR, 1.0, Nameless()).second == 4.0
    assert list(folder.iterdir()) == []
    monkeypatch.setattr(programs, "program_folder", lambda: None)
    assert program()(PAIR, 1.0).second == 4.0
    assert list(folder.iterdir()) == []


def test_a_folder_that_cannot_be_written_stops_nothing(monkeypatch, folder):
    (folder / "file").write_text("")
    monkeypatch.setattr(programs, "program_folder", lambda: folder / "file")
    assert program()(PAIR, 1.0).second == 4.0


def test_forgotten_programs_are_read_again():
    mine = program()
    mine(PAIR, 1.5)
    forget_programs()
    assert mine(PAIR, 1.5).second == 4.0
    assert len(traced) == 1


def test_other_settings_of_jax_are_other_programs(folder):
    program()(PAIR, 1.5)
    with jax.default_matmul_precision("bfloat16"):
        program()(PAIR, 1.5)
    assert len(traced) == 2
    assert len(list(folder.iterdir())) == 2


def test_what_was_compiled_now_may_fail_as_it_likes(monkeypatch):
    def fails(**_):
        raise jax.errors.JaxRuntimeError("RESOURCE_EXHAUSTED: out of memory")

    mine = program()
    monkeypatch.setattr(mine, "_compiled_program", lambda *_: fails)
    monkeypatch.setattr(programs, "write_program", lambda *_: None)
    with pytest.raises(jax.errors.JaxRuntimeError, match="out of memory"):
        mine(PAIR, 1.5)
    assert traced == []


def test_nothing_is_compiled_where_jax_may_not():
    with jax.disable_jit():
        assert program()(PAIR, 1.5).second == 4.0
    assert len(traced) == 1
