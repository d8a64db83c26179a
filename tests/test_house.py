"""House rules that a linter does not know: the tree, docstrings, sizes, no print."""

import ast
import re
import subprocess
import sys
from collections.abc import Callable, Iterable, Iterator
from functools import cache
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

LIBRARY_FILES = sorted(
    [*(ROOT / "lensfit").rglob("*.py"), *(ROOT / "data_synth").rglob("*.py")]
)


@cache
def parsed(path: Path) -> ast.Module:
    return ast.parse(path.read_text())


def offenders(wrong_of: Callable[[Path], Iterable[str]]) -> list[str]:
    """Every breach of a rule in the library, each after the file it is in.

    One test looks through all files: a test per file and rule would be thousands, which
    cost more to start than to run.
    """
    assert LIBRARY_FILES
    return [
        f"{path.relative_to(ROOT)}: {wrong}"
        for path in LIBRARY_FILES
        for wrong in wrong_of(path)
    ]


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


def undocumented(path: Path) -> Iterator[str]:
    if not ast.get_docstring(parsed(path)):
        yield "has no docstring"


def test_modules_say_what_they_are():
    assert offenders(undocumented) == []


def too_long(path: Path) -> Iterator[str]:
    if (length := path.read_text().count("\n")) > LONGEST_FILE:
        yield f"has {length} lines"
    for node in ast.walk(parsed(path)):
        if isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef)):
            documented = ast.get_docstring(node) is not None and len(node.body) > 1
            first = node.body[1 if documented else 0]
            length = (node.end_lineno or 0) - first.lineno + 1
            if length > LONGEST_FUNCTION:
                yield f"{node.name} has {length} lines"


def test_files_and_functions_stay_readable():
    assert offenders(too_long) == []


def printing(path: Path) -> Iterator[str]:
    if "cli" in path.relative_to(ROOT).parts:
        return
    for node in ast.walk(parsed(path)):
        if isinstance(node, ast.Call) and ast.unparse(node.func) == "print":
            yield f"prints in line {node.lineno}"


def test_library_never_prints():
    assert offenders(printing) == []


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


def untold_errors(path: Path) -> Iterator[str]:
    if "cli" in path.relative_to(ROOT).parts:  # its docstrings are the help of commands
        return
    for function in public_functions(parsed(path).body):
        known = set(raised_in(function)) & ERRORS
        _, _, said = (ast.get_docstring(function) or "").partition("Raises\n------\n")
        untold = {
            name for name in known if not {name, "LensfitError"} & set(WORD(said))
        }
        if untold:
            yield f"{function.name} raises {', '.join(sorted(untold))}"


def test_public_functions_say_which_errors_they_raise():
    assert offenders(untold_errors) == []


def postponed_annotations(path: Path) -> Iterator[str]:
    if "from __future__ import annotations" in path.read_text():
        yield "postpones its annotations"


def test_annotations_stay_real_for_jaxtyping():
    assert offenders(postponed_annotations) == []


PLANTED = '''
from __future__ import annotations

def read(path):
    """Read it."""
    print(path)
    raise OutputError(path)

def long():
'''
PLANTED += "    pass\n" * (LONGEST_FILE + 1)


@pytest.mark.parametrize(
    ("wrong_of", "found"),
    [
        (undocumented, ["has no docstring"]),
        (too_long, ["has 460 lines", "long has 451 lines"]),
        (printing, ["prints in line 6"]),
        (untold_errors, ["read raises OutputError"]),
        (postponed_annotations, ["postpones its annotations"]),
    ],
)
def test_planted_breaches_are_caught(wrong_of, found, tmp_path, monkeypatch):
    path = tmp_path / "planted.py"
    path.write_text(PLANTED)
    monkeypatch.setitem(globals(), "ROOT", tmp_path)
    assert list(wrong_of(path)) == found


def test_the_doorway_is_light():
    script = (
        "import sys, lensfit.cli.main; "
        f"print([name for name in {HEAVY!r} if name in sys.modules])"
    )
    run = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=True
    )
    assert run.stdout.strip() == "[]"
