"""`lensfit apply` passes every option on, and says in one line what is wrong."""

import json
from types import SimpleNamespace

import numpy as np
import pytest
from typer.testing import CliRunner
from wrong_usage import unboxed

from lensfit.cli.groups.library import LibraryGroup
from lensfit.cli.main import app
from lensfit.plate.plate_depth import DepthOptions
from lensfit.workflow import apply as workflow


@pytest.fixture
def asked(monkeypatch):
    """What the command asks of the workflow, which is not run."""
    calls = {}

    def note(preset, plates, out, **options):
        calls.update(options, plates=plates)
        return workflow.Applied(
            written=calls.get("written", []),
            failures=calls.get("bad", []),
            notes=["heed this"],
            seconds=2.0 * len(calls.get("written", [])),
        )

    monkeypatch.setattr(workflow, "apply", note)
    monkeypatch.setattr(
        LibraryGroup, "find", lambda group, name: SimpleNamespace(preset=None)
    )
    return calls


def run(*arguments):
    return CliRunner().invoke(
        app, ["apply", "p.json", "a.#.exr", "--out", "o", *arguments]
    )


def test_options_reach_the_workflow(asked):
    arguments = (
        "--workers 3 --frames 1-9x2 --depth-channel far.Z --depth-unit cm "
        "--depth-kind ray --edge-mask wire,fence --output circle-of-confusion"
    )
    assert run(*arguments.split()).exit_code == 0
    options = asked["options"]
    assert (asked["workers"], asked["frames"]) == (3, "1-9x2")
    assert options.depth == DepthOptions("far.Z", "cm", "ray", None, None)
    assert options.edge_mask == ("wire", "fence")
    assert options.output == "circle-of-confusion"
    assert options.switches.defocus


def test_defaults_leave_all_to_the_plate(asked):
    assert run("--no-defocus").exit_code == 0
    options = asked["options"]
    assert options.depth == DepthOptions()
    assert not options.switches.defocus
    assert (options.output, options.filter, asked["workers"]) == ("result", "cubic", 1)
    assert run("--tolerance", "1e-4").exit_code == 0
    assert asked["options"].filter == "keys-6"
    assert run("--tolerance", "1e-4", "--filter", "cubic").exit_code == 0
    assert asked["options"].filter == "cubic"


@pytest.mark.parametrize(
    "arguments",
    [["--depth-kind", "sideways"], ["--output", "all"], ["--workers", "0"]],
)
def test_wrong_words_are_wrong_usage(asked, arguments):
    assert run(*arguments).exit_code == 2


def test_the_folder_of_what_was_written_is_named(asked, tmp_path):
    asked["written"] = [tmp_path / "a.1.exr"]
    result = run("--disable", "lateral-red,lateral_blue")
    assert "1 frame written to o in 2.0 s" in result.stdout
    assert asked["options"].knobs == {"lateral_red_gain": 0, "lateral_blue_gain": 0}


@pytest.mark.parametrize("command", ["apply", "plan"])
@pytest.mark.parametrize("tolerance", ["5e-8", "1.1"])
def test_plans_and_results_have_the_same_tolerances(asked, command, tolerance):
    out = ["--out", "o"] if command == "apply" else []
    words = [command, "p.json", "a.exr", *out, "--tolerance", tolerance]
    result = CliRunner().invoke(app, words)
    assert result.exit_code == 2
    assert "--tolerance" in unboxed(result.stderr)


def test_knobs_and_what_is_disabled_reach_the_workflow(asked):
    arguments = (
        "--coma-gain 2 --spherical-um -3.5 --blades 7 --filter-image heart.png "
        "--squeeze 1.8 --maximum-blur-percent 1 --depth-levels 12 "
        "--disable coma,lateral-colour --edge-matte fence.A"
    )
    assert run(*arguments.split()).exit_code == 0
    options = asked["options"]
    assert options.knobs == {
        "coma_gain": 0.0,
        "lateral_red_gain": 0.0,
        "lateral_blue_gain": 0.0,
        "spherical_um": -3.5,
        "blades": 7,
        "filter_image": "heart.png",
        "squeeze": 1.8,
        "maximum_blur_percent": 1.0,
        "depth_levels": 12,
    }
    assert options.edge_matte == "fence.A"


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ("--disable comma", 'did you mean "coma"?'),
        ("--disable lateral_rod", 'did you mean "lateral-red"?'),
        ("--disable ,", "names no aberration"),
        ("--blades 17", "17 is not from 0 to 16"),
        ("--blades 1", "blades is 1; an aperture has no blades (0) or at least 3"),
        ("--blades 2", "blades is 2; an aperture has no blades (0) or at least 3"),
        ("--edge-mask a --edge-matte b", "goes without --edge-matte"),
    ],
)
def test_knobs_that_do_not_exist_are_wrong_usage(asked, arguments, said):
    result = run(*arguments.split())
    assert result.exit_code == 2
    assert said in unboxed(result.stderr)


def test_failures_set_the_exit_code_and_json_holds_them(asked):
    asked["bad"] = ["a.1.exr: is broken"]
    result = run("--json")
    assert result.exit_code == 1
    outcome = json.loads(result.stdout)
    assert outcome["failures"] == ["a.1.exr: is broken"]
    assert np.isclose(outcome["seconds"], 0)
    assert "heed this" in result.stderr
