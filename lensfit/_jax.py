"""The one place that configures JAX: double precision and a compilation cache.

A lens is fitted to hundredths of a pixel over thousands of points, so lensfit computes
in float64, and JAX defaults to float32. The choice must be made before the first array,
so `lensfit/__init__.py` makes it when any part of lensfit is imported. It costs nothing
there: a JAX that is not loaded yet is configured through its environment variables, one
that is loaded through its configuration. It holds for the whole process: arrays of
other libraries made afterwards default to float64 too (give their dtype where that
matters).

Compiled programs are kept in the user's cache folder, so that only the first run on a
machine compiles them. The environment variable LENSFIT_CACHE_DIR names another folder;
when it is empty nothing is kept. In it each user has a folder that nobody else can
write; where that is impossible nothing is kept either. A cache already chosen through
JAX's own settings is left alone, unless others can write it: a program is code.

A fit is sharded over the cores of the processor, and JAX counts these as devices only
if that is set before it starts. The renderer uses one device: its programs are large,
and several run at a time.
"""

import hashlib
import os
import platform
import sys
import warnings
from contextlib import suppress
from pathlib import Path

from lensfit.cores import available_cores
from lensfit.private_folder import is_open_to_others, made_private, user_id

CACHE_VARIABLE = "LENSFIT_CACHE_DIR"
_JAX_CACHE_VARIABLE = "JAX_COMPILATION_CACHE_DIR"
_MOST_CORES = 8
"""More have too few dots each; every device costs memory."""
_HALF_WRITTEN = "Error (reading|writing) persistent compilation cache entry"
_UNSET = {"jax_compilation_cache_dir": (None, ""), "jax_num_cpu_devices": (-1,)}
"""What settings are as long as nobody chose them, of those that a user may choose."""


def configure_jax() -> None:
    """Turn on float64 and the persistent compilation cache; harmless if repeated."""
    _set_unless_chosen("jax_enable_x64", True, overrule=True)
    _refuse_open_cache()
    chosen = cache_dir("jax")
    folder = None if chosen is None else made_private(chosen)
    if folder is not None:
        _set_unless_chosen("jax_compilation_cache_dir", str(folder))
        # All of them: a run has hundreds of small ones, seconds together.
        _set_unless_chosen("jax_persistent_cache_min_compile_time_secs", 0.0)
        # JAX writes them in place. What another process has written by half is
        # compiled here, which is nobody's concern.
        warnings.filterwarnings("ignore", _HALF_WRITTEN, UserWarning)


_refused: list[str] = []
"""Caches of JAX's own settings that others can write."""


def _refuse_open_cache() -> None:
    """Take from JAX a cache that its user chose, and that others can write."""
    jax = sys.modules.get("jax")
    if jax is not None and hasattr(jax, "config"):
        chosen = jax.config.jax_compilation_cache_dir
    else:
        chosen = os.environ.get(_JAX_CACHE_VARIABLE)
    # A cache in a bucket has no folder of this machine.
    if not chosen or "://" in chosen or not is_open_to_others(Path(chosen)):
        return
    _refused.append(chosen)
    os.environ.pop(_JAX_CACHE_VARIABLE, None)  # nor shall workers take it
    if jax is not None and hasattr(jax, "config"):
        jax.config.update("jax_compilation_cache_dir", None)


def cache_dir(kind: str) -> Path | None:
    """Folder for programs kept by JAX or by lensfit ("jax" or "programs"), or None when
    the environment asks for none.

    Programs compiled for one processor may not run on another, and farm nodes share
    home folders, so each kind of processor gets a folder of its own; and so does each
    user, who trusts no program of another's (`lensfit.private_folder`).
    """
    chosen = os.environ.get(CACHE_VARIABLE)
    if chosen is None:
        import platformdirs

        chosen = platformdirs.user_cache_dir("lensfit", appauthor=False)
    if not chosen:
        return None
    own = user_id()
    whose = Path(chosen) if own is None else Path(chosen) / f"u{own}"
    return whose / kind / _processor()


def cache_note() -> str | None:
    """What to say where no compiled programs are kept since others could plant some."""
    if _refused:
        return (
            f"{_JAX_CACHE_VARIABLE} is not used: {_refused[0]}, or a folder around it, "
            "can be written by others; give it a folder of your own"
        )
    for folder in (cache_dir("jax"), cache_dir("programs")):
        if folder is not None and is_open_to_others(folder):
            return (
                f"compiled programs are not kept: {folder}, or a folder around it, can "
                f"be written by others; give {CACHE_VARIABLE} a folder of your own"
            )
    return None


def count_cores() -> None:
    """Ask for a device per core, unless JAX runs already or its user has asked."""
    with suppress(RuntimeError):  # it runs already, with the devices it has
        _set_unless_chosen("jax_num_cpu_devices", min(available_cores(), _MOST_CORES))


def _set_unless_chosen(
    name: str, value: bool | float | str, *, overrule: bool = False
) -> None:
    """Tell JAX one setting, unless its user has chosen otherwise."""
    jax = sys.modules.get("jax")
    if jax is not None and hasattr(jax, "config"):
        may_set = name not in _UNSET or getattr(jax.config, name) in _UNSET[name]
        if overrule or may_set:
            jax.config.update(name, value)
    elif overrule:
        os.environ[name.upper()] = str(value)
    else:
        os.environ.setdefault(name.upper(), str(value))


def _processor() -> str:
    """A short name for this kind of processor and what instructions it has."""
    try:
        with Path("/proc/cpuinfo").open(encoding="utf-8") as lines:
            features = next(
                (line for line in lines if line.startswith(("flags", "Features"))), ""
            )
    except OSError:
        features = platform.processor()
    digest = hashlib.sha256(features.encode()).hexdigest()[:8]
    return f"{platform.machine()}-{digest}"
