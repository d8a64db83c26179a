"""Compiled programs are loaded only from folders that nobody else can write."""

import hashlib
import os
import pickle
import subprocess
import sys
from pathlib import Path

import pytest
from typer.testing import CliRunner

from lensfit._jax import cache_dir
from lensfit.cli.main import app
from lensfit.private_folder import is_private, made_private

pytestmark = pytest.mark.skipif(not hasattr(os, "geteuid"), reason="needs users")

PROGRAM = """
import lensfit, jax
import jax.numpy as jnp
from lensfit.programs import kept_program

@kept_program()
def doubled(values):
    return 2 * values

print(float(doubled(jnp.ones(3)).sum()), jax.config.jax_compilation_cache_dir)
"""


class Planted:
    """Runs code when it is unpickled, as anything pickled may."""

    def __init__(self, marker: Path):
        self.marker = marker

    def __reduce__(self):
        return (Path.touch, (self.marker,))


@pytest.fixture
def run(tmp_path):
    """A new process that uses kept programs: what it computed, and JAX's folder."""

    def start() -> list[str]:
        clean = {k: v for k, v in os.environ.items() if not k.startswith("JAX_")}
        done = subprocess.run(
            [sys.executable, "-c", PROGRAM],
            env=clean | {"LENSFIT_CACHE_DIR": str(tmp_path / "cache")},
            capture_output=True,
            text=True,
            timeout=120,
        )
        assert done.returncode == 0, done.stderr
        return done.stdout.split()

    return start


def planted(cache: Path, marker: Path) -> Path:
    """The folder of the programs, each of them replaced by one that leaves a marker,
    with a checksum of its own that is right."""
    kept = [p for p in (cache).rglob("programs/*/*/*") if p.is_file()]
    assert kept
    content = pickle.dumps(Planted(marker))
    for path in kept:
        path.write_bytes(hashlib.sha256(content).digest() + content)
    return kept[0].parent


def open_to_group(folder: Path) -> None:
    folder.chmod(0o770)


def open_to_all(folder: Path) -> None:
    folder.chmod(0o757)


def of_another_user(folder: Path) -> None:
    os.chown(folder, 12345, -1)


def with_files_of_another(folder: Path) -> None:
    for path in folder.iterdir():
        os.chown(path, 12345, -1)


def a_link(folder: Path) -> None:
    folder.rename(folder.with_name("elsewhere"))
    folder.symlink_to(folder.with_name("elsewhere"))


needs_root = pytest.mark.skipif(
    hasattr(os, "geteuid") and os.geteuid() != 0, reason="only root gives files away"
)


@pytest.mark.slow
@pytest.mark.parametrize(
    "opened",
    [
        None,
        open_to_group,
        open_to_all,
        a_link,
        pytest.param(of_another_user, marks=needs_root),
        pytest.param(with_files_of_another, marks=needs_root),
    ],
)
def test_a_planted_program_does_not_run(tmp_path, run, opened):
    assert run()[0] == "6.0"
    marker = tmp_path / "marker"
    folder = planted(tmp_path / "cache", marker)
    if opened is not None:
        opened(folder)
    assert run()[0] == "6.0"
    # In a private folder it would: there the file is the user's own.
    assert marker.exists() == (opened is None)


def test_jax_keeps_nothing_where_others_write(tmp_path, run):
    _, folder = run()
    assert is_private(Path(folder))
    assert folder.startswith(str(tmp_path))
    Path(folder).chmod(0o777)
    assert run() == ["6.0", "None"]


@pytest.mark.parametrize("mode", [0o777, 0o757, 0o1777, 0o755])
def test_nothing_is_kept_where_others_can_put_another_folder(tmp_path, mode):
    """Unless the folder around is sticky, as /tmp is: there names stay safe."""
    around = tmp_path / "shared"
    around.mkdir()
    around.chmod(mode)
    assert bool(made_private(around / "own" / "leaf")) == (mode in (0o1777, 0o755))


@needs_root
def test_a_folder_of_another_user_serves_nobody_else(tmp_path):
    around = tmp_path / "theirs"
    around.mkdir()
    assert made_private(around / "leaf")
    os.chown(around, 12345, -1)
    assert not made_private(around / "leaf")
    (tmp_path / "link").symlink_to(tmp_path)  # what is used is the real path
    assert made_private(tmp_path / "link" / "a" / "b") == tmp_path / "a" / "b"


def test_commands_say_that_programs_are_not_kept(tmp_path, monkeypatch):
    (tmp_path / "cache").mkdir()
    (tmp_path / "cache").chmod(0o777)
    monkeypatch.setenv("LENSFIT_CACHE_DIR", str(tmp_path / "cache"))
    for kind in ("jax", "programs"):
        folder = cache_dir(kind)
        assert folder is not None
        folder.mkdir(parents=True, mode=0o700)
    import jax

    assert jax
    done = CliRunner().invoke(app, ["preset", "show", "none.json"])
    notes = [line for line in done.stderr.splitlines() if "note" in line]
    assert len(notes) == 1
    assert "written by others" in notes[0]
    assert "LENSFIT_CACHE_DIR" in notes[0]
    (tmp_path / "cache").chmod(0o755)
    done = CliRunner().invoke(app, ["preset", "show", "none.json"])
    assert "note" not in done.stderr


def test_folders_are_made_private_whatever_the_mask(tmp_path):
    before = os.umask(0)
    try:
        folder = tmp_path / "shared" / "own" / "leaf"
        assert made_private(folder)
    finally:
        os.umask(before)
    assert folder.stat().st_mode & 0o777 == 0o700
    folder.chmod(0o720)
    assert not made_private(folder)
    assert not is_private(tmp_path / "none")
    (tmp_path / "file").touch()
    assert not made_private(tmp_path / "file" / "below")
