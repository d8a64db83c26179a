"""The tracer shares no line with the model it judges: its imports prove it."""

import ast
from pathlib import Path

FOLDER = Path(__file__).parents[2] / "data_synth"
MEASURING = ("bench", "commands")
"""Benchmarks measure lensfit, and commands print: they borrow what they need."""
ALLOWED = {
    "lensfit.atomic",
    "lensfit.coords",
    "lensfit.io.exr",
    "lensfit.io.exr_deep",
    "lensfit.errors",
    "lensfit.atomic_set",
}
"""Writing files, and where a window's pixels are: no optics."""


def lensfit_modules(source: str) -> set[str]:
    """The lensfit modules a source imports."""
    names = set()
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            names.add(node.module or "")
            assert node.level == 0, "absolute imports only, so that they can be read"
    return {name for name in names if name.split(".")[0] == "lensfit"}


def test_data_synth_borrows_files_and_windows_only():
    paths = [
        path
        for path in sorted(FOLDER.rglob("*.py"))
        if path.relative_to(FOLDER).parts[0] not in MEASURING
    ]
    assert paths
    borrowed = {path.name: lensfit_modules(path.read_text()) for path in paths}
    assert {name: b - ALLOWED for name, b in borrowed.items() if b - ALLOWED} == {}


def test_a_planted_import_is_caught():
    planted = "def f():\n    from lensfit.lens import Lens"
    assert not lensfit_modules(planted) <= ALLOWED
