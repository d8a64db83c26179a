"""The house stands: imports flow one way, heavy ones stay out of the doorway.

The floors are those of notebooks/guide/contributing.md. A module imports only from
lower floors or its own room, and never from `data_synth`, whose ray tracer shares no
line with the optics it judges (`data_synth/test_independence.py`).
"""

import ast
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "lensfit"

FLOORS = {
    "errors": 0,
    "units": 0,
    "atomic": 1,
    "swapped_folder": 2,
    "atomic_set": 3,
    "batches": 0,
    "progress": 0,
    "cores": 0,
    "memory": 0,
    "private_folder": 0,
    "printable": -1,
    "_jax": 1,
    "bounded": 1,
    "_strict": 2,
    "program_files": 2,
    "programs": 3,
    "mosaic": 1,
    "chroma": 1,
    "coords": 2,
    "photograph": 2,
    "optics": 2,
    "chart": 2,
    "io": 3,
    "detect": 3,
    "psf": 4,
    "lens": 5,
    "preset": 6,
    "rendering": 7,
    "fitting": 7,
    "exchange": 8,
    "plate": 8,
    "report": 8,
    "workflow": 9,
    "cli": 10,
}
WORKFLOW_FLOORS = {
    "shoot": 0,
    "calibration": 1,
    "pictures": 2,
    "statements": 2,
    "check": 3,
    "kit": 4,
    "view": 4,
}
"""Rooms within the room of whole jobs; the jobs themselves are files beside them."""
MODULE_PATHS = sorted(PACKAGE.rglob("*.py"))


@cache
def _imports(source: str) -> list[ast.Import | ast.ImportFrom]:
    nodes = ast.walk(ast.parse(source))
    return [node for node in nodes if isinstance(node, (ast.Import, ast.ImportFrom))]


def imported_names(source: str, module: str, *, is_package: bool) -> list[str]:
    """Absolute dotted names of everything `module` imports, at any depth."""
    names = []
    for node in _imports(source):
        if isinstance(node, ast.Import):
            names += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            parts = module.split(".")
            kept = len(parts) - node.level + (1 if is_package else 0)
            base = parts[:kept] if node.level else []
            stem = ".".join([*base, *([node.module] if node.module else [])])
            names += [f"{stem}.{alias.name}" for alias in node.names]
    return names


def uphill_imports(source: str, module: str, *, is_package: bool = False) -> list[str]:
    """What `module` imports from a floor that is not below its own."""
    room = module.split(".")[1]
    wrong = []
    for name in imported_names(source, module, is_package=is_package):
        parts = name.split(".")
        if parts[0] == "data_synth":
            wrong.append(name)
        if parts[0] != "lensfit" or len(parts) < 2 or parts[1] not in FLOORS:
            continue
        if parts[1] != room and FLOORS[parts[1]] >= FLOORS[room]:
            wrong.append(name)
    return wrong


def module_name(path: Path) -> str:
    parts = path.relative_to(ROOT).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def test_imports_flow_one_way():
    modules = {module_name(path): path for path in MODULE_PATHS}
    del modules["lensfit"]  # the public list, on top of everything
    assert {module.split(".")[1] for module in modules} == FLOORS.keys(), (
        "give the new room a floor, here and in notebooks/guide/contributing.md"
    )
    uphill = {
        module: uphill_imports(
            path.read_text(), module, is_package=path.name == "__init__.py"
        )
        for module, path in modules.items()
    }
    assert {module: names for module, names in uphill.items() if names} == {}


def uphill_rooms(source: str, module: str) -> list[str]:
    """Rooms of the workflow that `module` of one imports from, if not below its own."""
    own = module.split(".")[2]
    wanted = [n.split(".") for n in imported_names(source, module, is_package=False)]
    rooms = {n[2] for n in wanted if n[:2] == ["lensfit", "workflow"] and len(n) > 2}
    return sorted(
        room
        for room in rooms & WORKFLOW_FLOORS.keys() - {own}
        if WORKFLOW_FLOORS[room] >= WORKFLOW_FLOORS[own]
    )


def test_rooms_of_the_workflow_flow_one_way():
    modules = {
        f"{module_name(path.parent)}.{path.stem}": path
        for path in (PACKAGE / "workflow").glob("*/**/*.py")
    }
    assert {module.split(".")[2] for module in modules} == WORKFLOW_FLOORS.keys(), (
        "give the new room a floor, here"
    )
    uphill = {m: uphill_rooms(path.read_text(), m) for m, path in modules.items()}
    assert {module: rooms for module, rooms in uphill.items() if rooms} == {}


def test_a_planted_cycle_of_rooms_is_caught():
    source = (
        "def f():\n    from lensfit.workflow.pictures.chart_drawing import drawing_of"
    )
    assert uphill_rooms(source, "lensfit.workflow.calibration.observe") == ["pictures"]
    assert uphill_rooms(source, "lensfit.workflow.view.screen_picture") == []


@pytest.mark.parametrize(
    ("source", "module", "is_package"),
    [
        ("import lensfit.fitting.adjust", "lensfit.lens", False),
        ("from lensfit.fitting import adjust", "lensfit.rendering.warp", False),
        ("from lensfit import workflow", "lensfit.io.exr", False),
        ("from ..rendering import warp", "lensfit.fitting.adjust", False),
        ("from .. import cli", "lensfit.workflow.apply", False),
        ("from ..rendering.frame import render", "lensfit.preset", True),
        ("def f():\n    from lensfit.io import exr", "lensfit.detect.dots", False),
        ("import data_synth.trace", "lensfit.lens", False),
    ],
)
def test_planted_violations_are_caught(source: str, module: str, is_package: bool):
    assert uphill_imports(source, module, is_package=is_package)


@pytest.mark.parametrize(
    ("source", "module"),
    [
        (
            "from lensfit.detect.observations import Observations",
            "lensfit.fitting.adjust",
        ),
        ("from lensfit.errors import FitError\nimport numpy", "lensfit.lens"),
        ("from .blocks import Distortion", "lensfit.preset.schema"),
    ],
)
def test_honest_imports_pass(source: str, module: str):
    assert uphill_imports(source, module) == []


@pytest.mark.parametrize(
    "room", ["rendering", "optics", "psf", "detect", "io", "preset"]
)
def test_only_fit_optimises(room: str):
    for path in (PACKAGE / room).rglob("*.py"):
        names = imported_names(path.read_text(), module_name(path), is_package=False)
        assert [n for n in names if n.split(".")[0] == "optimistix"] == [], path
