"""House rules that a linter does not know: the tree, docstrings, sizes, no print."""

import ast
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from lensfit import errors

ROOT = Path(__file__).parents[1]
TOP_LEVEL = {
    "README.md",
    "pyproject.toml",
    "lensfit",
    "data_synth",
    "tests",
    "notebooks",
    "presets",
}
LONGEST_FILE = 450
LONGEST_FUNCTION = 45
# msgspec (20 ms) is not: the options of knobs are made from their definitions.
HEAVY = (
    "numpy",
    "jax",
    "cv2",
    "scipy",
    "skimage",
    "matplotlib",
    "OpenEXR",
    "equinox",
)

ERRORS = {name for name, one in vars(errors).items() if isinstance(one, type)}
WORD = re.compile(r"\w+").findall

library_files = pytest.mark.parametrize(
    "path",
    sorted([*(ROOT / "lensfit").rglob("*.py"), *(ROOT / "data_synth").rglob("*.py")]),
    ids=lambda path: str(path.relative_to(ROOT)),
)


def tracked_top_level() -> set[str]:
    """First path components git knows; whatever lies there when there is no git."""
    listing = subprocess.run(
        ["git", "ls-files"], cwd=ROOT, capture_output=True, text=True, check=False
    )
    names = listing.stdout.split("\n") if listing.returncode == 0 else []
    return {name.split("/")[0] for name in names if name}


def test_top_level_is_as_prescribed():
    visible = {name for name in tracked_top_level() if not name.startswith(".")}
    assert visible <= TOP_LEVEL


@library_files
def test_module_says_what_it_is(path: Path):
    assert ast.get_docstring(ast.parse(path.read_text()))


@library_files
def test_files_and_functions_stay_readable(path: Path):
    source = path.read_text()
    assert source.count("\n") <= LONGEST_FILE
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef)):
            documented = ast.get_docstring(node) is not None and len(node.body) > 1
            first = node.body[1 if documented else 0]
            length = (node.end_lineno or 0) - first.lineno + 1
            assert length <= LONGEST_FUNCTION, f"{node.name} has {length} lines"


@library_files
def test_library_never_prints(path: Path):
    if "cli" in path.parts:
        return
    calls = [
        n for n in ast.walk(ast.parse(path.read_text())) if isinstance(n, ast.Call)
    ]
    printed = [
        c for c in calls if isinstance(c.func, ast.Name) and c.func.id == "print"
    ]
    assert printed == []


def public_functions(body: list[ast.stmt]) -> Iterator[ast.FunctionDef]:
    """Of a module and of its public classes."""
    for node in body:
        if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
            yield from public_functions(node.body)
        if isinstance(node, ast.FunctionDef) and not node.name.startswith("_"):
            yield node


def raised_in(node: ast.AST) -> Iterator[str]:
    """Names of what a function raises itself; what it calls is not looked into."""
    for inner in ast.iter_child_nodes(node):
        if isinstance(inner, (ast.FunctionDef, ast.Lambda)):
            continue
        if isinstance(inner, ast.Raise) and isinstance(inner.exc, ast.Call):
            yield ast.unparse(inner.exc.func)
        yield from raised_in(inner)


@library_files
def test_public_functions_say_which_errors_they_raise(path: Path):
    if "cli" in path.parts:  # its docstrings are the help of commands
        return
    for function in public_functions(ast.parse(path.read_text()).body):
        known = set(raised_in(function)) & ERRORS
        _, _, said = (ast.get_docstring(function) or "").partition("Raises\n------\n")
        untold = {
            name for name in known if not {name, "LensfitError"} & set(WORD(said))
        }
        assert not untold, f"{function.name} raises {', '.join(untold)}"


@library_files
def test_annotations_stay_real_for_jaxtyping(path: Path):
    assert "from __future__ import annotations" not in path.read_text()


def test_the_doorway_is_light():
    script = (
        "import sys, lensfit.cli.main; "
        f"print([name for name in {HEAVY!r} if name in sys.modules])"
    )
    run = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=True
    )
    assert run.stdout.strip() == "[]"
