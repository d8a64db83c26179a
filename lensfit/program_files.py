"""Compiled programs as files in the user's cache folder.

A program fits one source code of lensfit, one version of each library that traces or
compiles it, and one kind of processor; this combination is called a world. Each world
has a folder of its own, and those of the worlds used last are kept. Every file opens
with a checksum.

Format: what `jax.experimental.serialize_executable` writes, pickled. To load it is to
run code, and no other format would change that: the content is machine code. So a file
is read only from a folder that belongs to the user and that nobody else can write or
replace (`lensfit.private_folder`).
"""

import functools
import hashlib
import os
import pickle
import shutil
from contextlib import suppress
from importlib.metadata import version
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
from jax.experimental import serialize_executable

from lensfit._jax import cache_dir
from lensfit.atomic import write_bytes_atomic
from lensfit.errors import LensfitError
from lensfit.private_folder import is_own_file, is_private, made_private

_LIBRARIES = ("jax", "jaxlib", "equinox", "optimistix", "lineax", "numpy")
_MOST_WORLDS = 6
"""Some 30 MB each."""
_CHECKSUM_BYTES = 32


@functools.cache
def program_folder() -> Path | None:
    """Where the programs of this world lie; None where the user wants none kept."""
    chosen = cache_dir("programs")
    root = None if chosen is None else made_private(chosen)
    if root is None:
        return None
    devices = [(d.platform, d.device_kind) for d in jax.local_devices()]
    libraries = [(name, version(name)) for name in _LIBRARIES]
    world = f"{_source_digest()} {libraries} {devices}"
    folder = root / hashlib.sha256(world.encode()).hexdigest()[:16]
    if folder.is_dir():
        with suppress(OSError):
            os.utime(folder)  # in use
    else:
        _keep_newest(root, _MOST_WORLDS - 1)
    return folder


def read_program(path: Path, arguments: Any) -> jax.stages.Compiled | None:
    """The program of a file; None where there is none that can be used.

    Parameters
    ----------
    arguments : Tree of what it is called with, `((), {name: array, ...})`.
    """
    content = _trusted_bytes(path)
    if content is None:
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


def _trusted_bytes(path: Path) -> bytes | None:
    """What a file holds that nobody but the user can have written; None if there is no
    such file."""
    if not is_private(path.parent):
        return None
    try:
        with path.open("rb") as file:
            return file.read() if is_own_file(file.fileno()) else None
    except OSError:
        return None


def write_program(path: Path, program: jax.stages.Compiled) -> None:
    """Keep a program, unless its device cannot, or the folder cannot be written or can
    be by others.

    Raises
    ------
    TypeError : What it returns would not be the same after a file.
    """
    if pickle.loads(pickle.dumps(program.out_tree)) != program.out_tree:
        raise TypeError(
            f"What {path.name} returns is not the same after a file; return arrays in "
            "tuples, not in modules of equinox"
        )
    try:
        # The tree of arguments is not kept: who calls has it, and modules in it would
        # not be the same after a file either.
        payload, _, results = serialize_executable.serialize(program)
    except ValueError:  # says JAX of a device whose programs cannot be written
        return
    shardings = jax.tree.leaves(program.output_shardings)
    devices = max(len(sharding.device_set) for sharding in shardings)
    if not made_private(path.parent):
        return  # nobody would read it
    kept = pickle.dumps((payload, results, devices))
    with suppress(LensfitError):  # a full disk stops no fit
        write_bytes_atomic(path, hashlib.sha256(kept).digest() + kept)


@functools.cache
def _source_digest() -> str:
    package = Path(__file__).parent
    digest = hashlib.sha256()
    for path in sorted(package.rglob("*.py")):
        digest.update(str(path.relative_to(package)).encode())
        digest.update(path.read_bytes())
    return digest.hexdigest()


@functools.cache
def _find_lapack() -> None:
    """JAX looks for LAPACK when it first lowers a call of it; a program that nobody
    lowered in this process would jump into nothing."""
    jax.jit(jnp.linalg.cholesky).lower(jax.ShapeDtypeStruct((1, 1), jnp.float64))


def _keep_newest(folder: Path, count: int) -> None:
    with suppress(OSError):  # another process was faster
        by_age = sorted(folder.glob("*"), key=lambda old: -old.stat().st_mtime)
        for old in by_age[count:]:
            shutil.rmtree(old, ignore_errors=True)
