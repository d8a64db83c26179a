"""Compiled programs that the next process runs at once.

JAX's own cache spares the next process the compilation, but not the way there: to know
which program it looks for, JAX traces the Python code and lowers what it traced, which
for the large programs of a fit takes seconds each. Here a program is kept under what
decides it before any tracing: lensfit's source code, the versions of the libraries that
trace and compile it, JAX's settings, the static arguments, and shape and type of every
array. A change of any of these makes another name; nothing is ever looked up wrongly.

What cannot be kept (calls from within other programs, arrays dealt over devices, no
folder to keep it in) runs as under `jax.jit`. So does what was kept and fails: a
file that another version of a library wrote, or that was damaged, costs its time and
nothing else.
"""

import functools
import hashlib
import inspect
import math
import os
import pickle
import shutil
from collections.abc import Callable, Hashable, Iterable, Iterator
from contextlib import contextmanager, suppress
from importlib.metadata import version
from pathlib import Path
from threading import Lock
from typing import Any, Generic, TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jax.experimental import serialize_executable

from lensfit._jax import cache_dir
from lensfit.atomic import write_bytes_atomic
from lensfit.errors import LensfitError

_R = TypeVar("_R")
_LIBRARIES = ("jax", "jaxlib", "equinox", "optimistix", "lineax", "numpy")
_SETTINGS = (
    "jax_enable_x64",
    "jax_numpy_dtype_promotion",
    "jax_numpy_rank_promotion",
    "jax_default_matmul_precision",
    "jax_debug_nans",
)
_MOST_WORLDS = 6
"""Versions of lensfit and its libraries whose programs are kept, some 30 MB each."""
_CHECKSUM_BYTES = 32
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
        key = (tuple(static.items()), tree, tuple(map(_kind, leaves)))
        with self._one_at_a_time:
            if key not in self._ready:
                self._ready[key] = self._obtained(static, arrays, key)
        program = self._ready.get(key)
        if program is None:
            return self._jitted(**given)
        try:
            return program(**arrays)
        except jax.errors.JaxRuntimeError:
            # Kept by another world, whatever its name says.
            self._ready[key] = None
            return self._jitted(**given)

    def forget(self) -> None:
        """Let go of the programs of this process."""
        with self._one_at_a_time:
            self._ready.clear()

    def _obtained(
        self, static: dict[str, Any], arrays: dict[str, Any], key: Hashable
    ) -> Callable[..., Any] | None:
        """The kept program, or one compiled now and kept; None where none can be."""
        folder, told = _folder(), _told(key)
        if folder is None or told is None:
            return None
        name = f"{self._function.__module__}.{self._function.__qualname__}"
        digest = hashlib.sha256(f"{name} {told}".encode()).hexdigest()[:32]
        path = folder / f"{name.rpartition('.')[2]}-{digest}"
        program = _read(path, jax.tree.structure(((), arrays)))
        if program is None:
            program = self._compiled(static, arrays, digest)
            _write(path, program)
        return program

    def _compiled(
        self, static: dict[str, Any], arrays: dict[str, Any], digest: str
    ) -> jax.stages.Compiled:
        def named(**arrays: Any) -> Any:
            return self._function(**static, **arrays)

        named.__name__ = f"{self._function.__name__}_{digest}"
        with _not_in_jax_cache():
            program = jax.jit(named).lower(**arrays).compile()
        if pickle.loads(pickle.dumps(program.out_tree)) != program.out_tree:
            raise TypeError(
                f"{self._function.__name__}: what it returns is not the same after a "
                "file; return arrays in tuples, not in modules of equinox"
            )
        return program


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


def _kind(leaf: Any) -> Hashable:
    return jax.typeof(leaf)


def _told(key: Any) -> str | None:
    """The same text in every process for the same key; None where there is no such."""
    static, tree, kinds = key
    arrays = [(k.shape, str(k.dtype), k.weak_type) for k in kinds]
    values = [(name, _name_of(value)) for name, value in static]
    told = f"{values} {tree} {arrays}"
    return None if " at 0x" in told else told


def _name_of(value: Any) -> str:
    if inspect.isfunction(value):
        return f"{value.__module__}.{value.__qualname__}"
    return repr(value)


@functools.cache
def _folder() -> Path | None:
    """Where programs of this lensfit, these libraries and this machine lie."""
    root = cache_dir()
    if root is None:
        return None
    settings = [(name, getattr(jax.config, name)) for name in _SETTINGS]
    devices = [(d.platform, d.device_kind) for d in jax.local_devices()]
    libraries = [(name, version(name)) for name in _LIBRARIES]
    world = f"{_source_digest()} {libraries} {settings} {devices}"
    folder = root.parent.parent / "programs" / root.name
    folder = folder / hashlib.sha256(world.encode()).hexdigest()[:16]
    if folder.is_dir():
        with suppress(OSError):
            os.utime(folder)  # in use
    else:
        _keep_newest(folder.parent, _MOST_WORLDS - 1)
    return folder


@functools.cache
def _source_digest() -> str:
    package = Path(__file__).parent
    digest = hashlib.sha256()
    for path in sorted(package.rglob("*.py")):
        digest.update(str(path.relative_to(package)).encode())
        digest.update(path.read_bytes())
    return digest.hexdigest()


def _keep_newest(folder: Path, count: int) -> None:
    with suppress(OSError):  # another process was faster
        by_age = sorted(folder.glob("*"), key=lambda old: -old.stat().st_mtime)
        for old in by_age[count:]:
            shutil.rmtree(old, ignore_errors=True)


def _read(path: Path, arguments: Any) -> jax.stages.Compiled | None:
    """The program of a file; `arguments` is the tree of what it is called with."""
    try:
        content = path.read_bytes()
    except OSError:
        return None
    checksum, kept = content[:_CHECKSUM_BYTES], content[_CHECKSUM_BYTES:]
    if hashlib.sha256(kept).digest() != checksum:
        return None
    _find_lapack()
    try:
        payload, results, devices = pickle.loads(kept)
        return serialize_executable.deserialize_and_load(
            payload, arguments, results, execution_devices=jax.devices()[:devices]
        )
    except Exception:  # whatever goes wrong in a foreign file, it is compiled again
        return None


@functools.cache
def _find_lapack() -> None:
    """JAX looks for LAPACK when it first lowers a call of it; a program that nobody
    lowered in this process would jump into nothing."""
    jax.jit(jnp.linalg.cholesky).lower(jax.ShapeDtypeStruct((1, 1), jnp.float64))


def _write(path: Path, program: jax.stages.Compiled) -> None:
    """Keep it if that is possible: a full disk, or a program that cannot be kept, stops
    no fit."""
    try:
        # The tree of arguments is not kept: who calls has it, and some modules in it
        # are not themselves any more after a file.
        payload, _, results = serialize_executable.serialize(program)
        shardings = jax.tree.leaves(program.output_shardings)
        devices = max(len(sharding.device_set) for sharding in shardings)
        kept = pickle.dumps((payload, results, devices))
        write_bytes_atomic(path, hashlib.sha256(kept).digest() + kept)
    except (LensfitError, ValueError, NotImplementedError, pickle.PicklingError):
        return
