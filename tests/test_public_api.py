"""The public names: all there, typed, light to import, computing in float64."""

import ast
import inspect
import subprocess
import sys
from pathlib import Path

import pytest

import lensfit

PACKAGE = Path(lensfit.__file__).parent
PROMISED = {
    "project": ["object_points_mm", "channel"],
    "distorted_from_undistorted": ["points_mm", "channel"],
    "undistorted_from_distorted": ["points_mm", "channel"],
    "relative_illumination": ["points_mm", "channel"],
    "position_standard_deviation_mm": ["points_mm", "channel"],
    "illumination_standard_deviation": ["points_mm", "channel"],
    "psf": [
        "image_point_mm",
        "object_distance_mm",
        "channel",
        "pixel_pitch_mm",
        "size_px",
        "tolerance",
    ],
}
"""Methods of a lens that other programs rely on, with their arguments."""


def output_of(script: str) -> str:
    run = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=True
    )
    return run.stdout.strip()


@pytest.mark.parametrize("name", lensfit.__all__)
def test_every_public_name_is_there_and_documented(name: str):
    assert name in dir(lensfit)
    assert inspect.getdoc(getattr(lensfit, name))


def test_what_is_not_there_is_said():
    with pytest.raises(AttributeError, match="has no attribute 'rendr'"):
        _ = lensfit.rendr  # pyright: ignore[reportAttributeAccessIssue]


def test_a_lens_keeps_its_promised_methods():
    from lensfit.lens import Lens

    for name, arguments in PROMISED.items():
        parameters = inspect.signature(getattr(Lens, name)).parameters
        assert list(parameters)[1:] == arguments
        assert parameters["channel"].default == "g"


def test_a_preset_keeps_its_promised_method():
    parameters = inspect.signature(lensfit.Preset.at).parameters
    names = ["focal_length_mm", "f_number", "focus_distance_mm"]
    positional = [n for n, p in parameters.items() if p.kind != p.KEYWORD_ONLY]
    assert positional == ["self", *names]
    assert all(p.default is None for n, p in parameters.items() if n != "self")


@pytest.mark.slow
@pytest.mark.parametrize(
    "first",
    ["", "import lensfit.rendering.filters; ", "from lensfit.fitting import adjust; "],
)
def test_verbs_are_functions_whatever_was_imported_before(first: str):
    verbs = "lensfit.fit, lensfit.render, lensfit.calibrate, lensfit.apply"
    script = (
        f"{first}import inspect, lensfit; print([*map(inspect.isfunction, [{verbs}])])"
    )
    assert output_of(script) == "[True, True, True, True]"


@pytest.mark.parametrize(
    "first",
    [
        "import lensfit",
        "import jax, lensfit",
        "import lensfit.lens",
        "from lensfit import load_preset",
    ],
)
def test_float64_whichever_way_one_comes_in(first: str):
    script = f"{first}; import jax.numpy as jnp; print(jnp.asarray(0.1).dtype)"
    assert output_of(script) == "float64"


def test_the_package_says_it_is_typed():
    assert (PACKAGE / "py.typed").is_file()


def test_public_functions_are_fully_annotated():
    paths = [p for p in PACKAGE.rglob("*.py") if not p.name.startswith("_")]
    assert paths
    bare = [
        f"{path.relative_to(PACKAGE)}: {function.name}"
        for path in paths
        for function in public_functions(path)
        if not is_annotated(function)
    ]
    assert bare == []


def public_functions(path: Path) -> list[ast.FunctionDef]:
    """Functions and methods without a leading underscore, not the nested ones."""
    module = ast.parse(path.read_text())
    classes = [n for n in module.body if isinstance(n, ast.ClassDef)]
    bodies = [module.body, *(c.body for c in classes if not c.name.startswith("_"))]
    functions = [n for body in bodies for n in body if isinstance(n, ast.FunctionDef)]
    return [f for f in functions if not f.name.startswith("_")]


def is_annotated(function: ast.FunctionDef) -> bool:
    spec = function.args
    arguments = [*spec.posonlyargs, *spec.args, *spec.kwonlyargs]
    named = [a for a in arguments if a.arg not in ("self", "cls")]
    return function.returns is not None and all(a.annotation for a in named)
