"""Compiled programs that the next process runs at once.

JAX's own cache spares the next process the compilation, but not tracing and lowering:
to find the key of a program, JAX traces the Python code and lowers the result, which
for the large programs of a fit takes seconds each. Here the key is known before any
tracing: lensfit's source code and the libraries' versions (`program_files`), JAX's
settings, the static arguments, and shape and type of every array. Any other input to
the traced function, such as an environment variable, would not change the key, so a
function must read nothing else.

What cannot be kept (calls from within other programs, arrays sharded over devices,
static arguments without a lasting name) runs as under `jax.jit`. A file that does not
run here costs its time and nothing else.
"""

import functools
import hashlib
import inspect
import math
from collections.abc import Callable, Hashable, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from threading import Lock
from typing import Any, Generic, NamedTuple, TypeVar

import jax
import numpy as np
from jax.core import Tracer

from lensfit.program_files import program_folder, read_program, write_program

_R = TypeVar("_R")
_SETTINGS = (
    "jax_enable_x64",
    "jax_numpy_dtype_promotion",
    "jax_numpy_rank_promotion",
    "jax_default_matmul_precision",
    "jax_debug_nans",
)
"""Those that change what is traced."""
_MOST_MAPS = 20_000
"""Linux gives a process 65,530 memory maps, and every compiled program takes some."""
_NO_PROGRAMS = "jax_disable_jit"
_LEAST_SECONDS = "jax_persistent_cache_min_compile_time_secs"
_compiling = Lock()
_kept: list["KeptProgram[Any]"] = []


def kept_program(
    *, static_argnames: Iterable[str] = ()
) -> Callable[[Callable[..., _R]], "KeptProgram[_R]"]:
    """Like `jax.jit`, for large functions at the top of a module.

    The function returns arrays, in tuples or dictionaries if more than one.

    Parameters
    ----------
    static_argnames : As for `jax.jit`; their `repr` must say all there is to them, as
        that of a dataclass does. A function counts as its name.
    """
    return lambda function: KeptProgram(function, tuple(static_argnames))


def make_room_for_programs() -> None:
    """`forget_programs` before they are too many for one process."""
    maps = Path("/proc/self/maps")
    if not maps.exists() or maps.read_bytes().count(b"\n") > _MOST_MAPS:
        forget_programs()


def forget_programs() -> None:
    """Let go of all programs of this process, JAX's too; files stay."""
    for program in _kept:
        program.forget()
    jax.clear_caches()


class _Call(NamedTuple):
    """What decides which program runs; the same for the same program."""

    settings: tuple[Any, ...]
    static: tuple[tuple[str, Any], ...]
    tree: Any
    kinds: tuple[Any, ...]


class KeptProgram(Generic[_R]):
    """A function that runs as compiled programs; see `kept_program`."""

    def __init__(self, function: Callable[..., _R], static: tuple[str, ...]):
        functools.update_wrapper(self, function)
        self._function = function
        self._static = static
        self._signature = inspect.signature(function)
        self._jitted = jax.jit(function, static_argnames=static)
        self._ready: dict[Hashable, Callable[..., Any] | None] = {}
        self._one_at_a_time = Lock()
        _kept.append(self)

    def __call__(self, *args: Any, **kwargs: Any) -> _R:
        given = self._signature.bind(*args, **kwargs).arguments
        static = {name: given[name] for name in self._static if name in given}
        arrays = {name: v for name, v in given.items() if name not in static}
        leaves, tree = jax.tree.flatten(arrays)
        if getattr(jax.config, _NO_PROGRAMS) or not all(map(_is_plain, leaves)):
            return self._jitted(**given)
        settings = tuple(getattr(jax.config, name) for name in _SETTINGS)
        kinds = tuple(map(jax.typeof, leaves))
        call = _Call(settings, tuple(static.items()), tree, kinds)
        with self._one_at_a_time:
            if call not in self._ready:
                self._ready[call] = self._kept_or_compiled(call, arrays)
            program = self._ready[call]
        return self._jitted(**given) if program is None else program(**arrays)

    def forget(self) -> None:
        """Let go of the programs of this process."""
        with self._one_at_a_time:
            self._ready.clear()

    def _kept_or_compiled(
        self, call: _Call, arrays: dict[str, Any]
    ) -> Callable[..., Any] | None:
        """The kept program, or one compiled now and kept; None where none can be."""
        folder, key = program_folder(), _program_key(call)
        if folder is None or key is None:
            return None
        name = f"{self._function.__module__}.{self._function.__qualname__}"
        digest = hashlib.sha256(f"{name} {key}".encode()).hexdigest()[:32]
        path = folder / f"{self._function.__name__}-{digest}"
        read = read_program(path, jax.tree.structure(((), arrays)))
        if read is not None:
            return self._checked_program(read, call)
        program = self._compiled_program(call, arrays, digest)
        write_program(path, program)
        return program

    def _checked_program(
        self, read: Callable[..., Any], call: _Call
    ) -> Callable[..., Any]:
        """A program from a file; where it does not run here, it is traced after all."""

        def run(**arrays: Any) -> Any:
            try:
                return read(**arrays)
            except jax.errors.JaxRuntimeError:
                self._ready[call] = None
                return self._jitted(**dict(call.static), **arrays)

        return run

    def _compiled_program(
        self, call: _Call, arrays: dict[str, Any], digest: str
    ) -> jax.stages.Compiled:
        def named(**arrays: Any) -> Any:
            return self._function(**dict(call.static), **arrays)

        named.__name__ = f"{self._function.__name__}_{digest}"
        with _not_in_jax_cache():
            return jax.jit(named).lower(**arrays).compile()


@contextmanager
def _not_in_jax_cache() -> Iterator[None]:
    """JAX's own cache keeps nothing meanwhile: it would only be a copy, and what JAX
    has read from there it cannot write again."""
    with _compiling:
        before = getattr(jax.config, _LEAST_SECONDS)
        jax.config.update(_LEAST_SECONDS, math.inf)
        try:
            yield
        finally:
            jax.config.update(_LEAST_SECONDS, before)


def _is_plain(leaf: Any) -> bool:
    """Whether a program compiled for its shape and type alone can take it."""
    if isinstance(leaf, Tracer):
        return False
    if isinstance(leaf, jax.Array):
        return len(leaf.devices()) == 1
    return isinstance(leaf, (np.ndarray, np.generic, bool, int, float))


def _program_key(call: _Call) -> str | None:
    """The same text in every process for the same call; None where there is no such."""
    arrays = [(k.shape, str(k.dtype), k.weak_type) for k in call.kinds]
    static = [(name, _name_of(value)) for name, value in call.static]
    key = f"{call.settings} {static} {call.tree} {arrays}"
    return None if " at 0x" in key else key


def _name_of(value: Any) -> str:
    if inspect.isfunction(value):
        return f"{value.__module__}.{value.__qualname__}"
    return repr(value)
