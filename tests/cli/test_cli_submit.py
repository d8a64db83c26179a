"""`lensfit submit` hands on what `apply` takes, word for word."""

import inspect
import json
import math
import os
import subprocess
import sys
from enum import EnumType
from pathlib import Path
from typing import Annotated, get_args, get_origin

import pytest
import typer
from typer.testing import CliRunner

from lensfit.cli.apply import apply
from lensfit.cli.main import app

NASTY = "a'b \"$HOME;{{Param.Out}}|é"
OWN = {"preset", "plates", "out", "frames", "library", "as_json", "progress_as"}
"""What submit has itself, JSON, which is how it speaks, and what a farm reads."""
RECORDER = """#!{python}
import json, pathlib, sys
pathlib.Path({log!r}).open("a").write(json.dumps(sys.argv[1:]) + "\\n")
"""


@pytest.fixture
def job(tmp_path):
    """A preset and five plates, whose names are as bad as a file system allows."""
    folder = tmp_path / NASTY
    folder.mkdir()
    (folder / "preset.json").touch()
    (folder / "map.exr").touch()
    for number in range(-2, 3):
        sign, size = ("-" if number < 0 else ""), abs(number)
        (folder / f"{NASTY}.{sign}{size:04d}.exr").touch()
    return folder


def submit(job, *arguments):
    """The files of `job` are empty: nothing could be planned from them."""
    plates = str(job / f"{NASTY}.####.exr")
    command = ["submit", str(job / "preset.json"), plates, "--out", str(job / "o ut")]
    return CliRunner().invoke(app, [*command, "--no-plan", *arguments])


def words_of(job) -> list[list[str]]:
    """The command of each task, with parameters put in as the specification says."""
    return words_in(job / "o ut")


def words_in(out) -> list[list[str]]:
    template = json.loads((out / "apply.openjd.json").read_text())
    values = json.loads((out / "apply.openjd.parameters.json").read_text())
    for parameter in template["parameterDefinitions"]:
        values.setdefault(parameter["name"], parameter.get("default"))
    (step,) = template["steps"]
    tasks = [None]
    if "parameterSpace" in step:
        (frames,) = step["parameterSpace"]["taskParameterDefinitions"]
        tasks = frames["range"]
    return [[_filled(w, values, t) for w in _action(step)["args"]] for t in tasks]


def _action(step):
    return step["script"]["actions"]["onRun"]


def _filled(word, values, frames):
    """One pass over the word: what is put in is not read again."""
    parts = word.replace("{{", "\0").replace("}}", "\0").split("\0")
    named = {f"Param.{k}": str(v) for k, v in values.items()}
    named["Task.Param.Frames"] = frames
    return "".join(named[p] if i % 2 else p for i, p in enumerate(parts))


APPLY = typer.main.get_command(app).commands["apply"]


def parsed(words):
    """What the parser of `apply` makes of a command."""
    return APPLY.make_context("apply", list(words)).params


def given_to_every_option(job) -> list[str]:
    """Each option of `apply`, at a value that is not its default."""
    words: list[str] = []
    for option in APPLY.params:
        if option.name in OWN or option.name == "help":
            continue
        if option.is_flag:
            words.append(option.opts[0])
            continue
        value = accepted(option, job)
        empty = [""] if option.multiple and not Path(value).is_absolute() else []
        for word in [value, *empty]:
            words += [option.opts[0], word]
    return words


def accepted(option, job) -> str:
    """A value that the parser takes for an option."""
    kind = inspect.signature(apply).parameters[option.name].annotation
    if "Path" in str(kind) or option.name == "filter_image":
        return str(job / "map.exr")
    kind = get_args(kind)[0] if get_origin(kind) is Annotated else kind
    kinds = get_args(kind) or [kind]
    words = [m.value for k in kinds if isinstance(k, EnumType) for m in k][::-1]
    for value in [*words, NASTY, "0.1", "3", "5000"]:
        try:
            found = parsed(["p", "q", "--out", "o", option.opts[0], value])
        except typer.BadParameter:
            continue
        if found[option.name] != option.default:
            return value
    raise AssertionError(f"no value for {option.name}")


def test_every_option_of_apply_survives(job):
    options = given_to_every_option(job)
    direct = [str(job / "preset.json"), str(job / f"{NASTY}.####.exr")]
    direct += ["--out", str(job / "o ut"), "--frames", "-2--1"]
    assert submit(job, "--frames", "-2--1", *options).exit_code == 0
    (task,) = words_of(job)
    assert task[0] == "apply"
    wanted = parsed([*direct, *options, "--progress", "openjd"])
    assert parsed(task[1:]) == wanted
    # And the test has left none of them at its default.
    for option in APPLY.params:
        if option.name not in OWN and option.name != "help":
            assert wanted[option.name] != option.default, option.name


@pytest.mark.parametrize("value", ["inf", "1e-07", "0.1", "2.8", "1234567.125"])
def test_numbers_arrive_as_they_were_given(job, value):
    assert submit(job, "--focus-distance-mm", value).exit_code == 0
    (task,) = words_of(job)
    assert parsed(task[1:])["focus_distance_mm"] == float(value)
    assert math.isfinite(float(value)) == ('"FLOAT"' in text(job))


def text(job):
    return (job / "o ut" / "apply.openjd.json").read_text()


def test_options_left_alone_are_not_handed_on(job):
    assert submit(job).exit_code == 0
    (task,) = words_of(job)
    assert [w.split("=")[0] for w in task[3:]] == ["--frames", "--out", "--progress"]


def test_frames_are_dealt_into_chunks(job):
    assert submit(job, "--chunk", "2").exit_code == 0
    assert [t[3] for t in words_of(job)] == [
        "--frames=-2--1",
        "--frames=0-1",
        "--frames=2",
    ]
    assert submit(job, "--frames", "2--2x2,9", "--chunk", "3").exit_code == 0
    assert [t[3] for t in words_of(job)] == ["--frames=2--2x2", "--frames=9"]
    said = submit(job, "--frames", "1-9").stderr
    assert "frames 3-9 do not exist yet" in said


def test_paths_are_parameters_a_farm_may_map(job):
    assert submit(job, "--stmap", str(job / "map.exr")).exit_code == 0
    template = json.loads(text(job))
    paths = {
        d["name"]: (d["objectType"], d["dataFlow"])
        for d in template["parameterDefinitions"]
        if d["type"] == "PATH"
    }
    assert paths == {
        "Preset": ("FILE", "IN"),
        "PlatesFolder": ("DIRECTORY", "IN"),
        "Out": ("DIRECTORY", "OUT"),
        "Stmap": ("FILE", "IN"),
    }
    assert str(job) not in text(job)
    assert "{{" not in template["name"]


def test_pictures_and_maps_named_from_here_are_found_from_anywhere(job, monkeypatch):
    monkeypatch.chdir(job)
    assert submit(job, "--filter-image", "map.exr", "--stmap", "map.exr").exit_code == 0
    (task,) = words_of(job)
    found = parsed(task[1:])
    assert found["filter_image"] == str(job / "map.exr")
    assert found["stmap"] == job / "map.exr"


def test_a_single_plate_is_one_task(job):
    (job / "one.exr").touch()
    words = ["submit", str(job / "preset.json"), str(job / "one.exr")]
    words += ["--out", str(job / "o ut"), "--no-plan", "--json"]
    run = CliRunner().invoke(app, words)
    said = json.loads(run.stdout)
    assert said["tasks"] == 1
    ((_, _, *words),) = words_of(job)
    out = f"--out={job / 'o ut'}"
    assert words == [str(job / "one.exr"), out, "--progress=openjd"]


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--frames", "7-9"], "3 of 3 frames are missing"),
        (["--frames", "x"], "no range of frames"),
        (["--stmap", "none.exr"], "does not exist"),
        (["--layer", "a\nb"], "control character"),
        (["--frames", "-2-2000", "--chunk", "1"], "more than the 1024"),
        (["--frames", "-2-999x2,-1-999x3", "--chunk", "999"], "longer than 1024"),
        ([f"--layer={i}" for i in range(60)], "more than the 50"),
    ],
)
def test_what_no_farm_could_run_is_refused_in_one_line(job, arguments, said):
    result = submit(job, *arguments)
    assert result.exit_code == 1
    assert said in result.stderr
    assert len(result.stderr.strip().splitlines()) == 1
    assert not (job / "o ut").exists()


def test_results_do_not_replace_plates_and_presets_exist(job):
    plates = str(job / f"{NASTY}.####.exr")
    for preset, out, said in (
        ("preset.json", job, "would replace its own source"),
        ("none.json", job / "o ut", "none.json: cannot be read"),
    ):
        words = ["submit", str(job / preset), plates, "--out", str(out)]
        result = CliRunner().invoke(app, words)
        assert result.exit_code == 1
        assert said in result.stderr


def test_submitting_loads_nothing_heavy(job):
    words = [str(job / "preset.json"), str(job / f"{NASTY}.####.exr")]
    script = (
        "import sys; from lensfit.cli.main import app\n"
        f"app(['submit', *{words!r}, '--no-plan', '--out', {str(job / 'o ut')!r}],"
        " standalone_mode=False)\n"
        "print([m for m in ('numpy', 'jax', 'cv2', 'OpenEXR')"
        " if m in sys.modules])"
    )
    run = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=True
    )
    assert run.stdout.splitlines()[-1] == "[]"


@pytest.fixture
def scene(tmp_path):
    """An ideal lens and a plate with depth, which blurs."""
    import numpy as np

    from lensfit.coords import Window
    from lensfit.io.exr import ExrImage, ExrPart, write_exr

    window = Window.of_size(1600, 300)
    depth = np.linspace(800, 9000, 1600, dtype=np.float32)
    channels = {"Z": np.broadcast_to(depth, (300, 1600)).copy()}
    channels |= dict.fromkeys("RGB", np.ones((300, 1600), np.float16))
    header = {"lens/focal": 35.0, "lens/fstop": 1.4, "lens/focus": 2.0}
    part = ExrPart(channels, window, window, header)
    write_exr(tmp_path / "plate.0001.exr", ExrImage((part,)))
    thin = {"focal_length_mm": 35.0, "f_number": 1.4, "focus_distance_m": 2.0}
    thin |= {"sensor_width_mm": 36.0, "width_px": 1600, "height_px": 300}
    (tmp_path / "camera.json").write_text(json.dumps(thin))
    words = ["preset", "thin-lens", str(tmp_path / "camera.json")]
    done = CliRunner().invoke(app, [*words, "--out", str(tmp_path / "thin.json")])
    assert done.exit_code == 0, done.output
    return tmp_path


def submitted(scene, *arguments):
    words = ["submit", str(scene / "thin.json"), str(scene / "plate.####.exr")]
    words += ["--out", str(scene / "out"), "--depth-unit", "mm", "--json", *arguments]
    result = CliRunner().invoke(app, words)
    assert result.exit_code == 0, result.output
    return json.loads(result.stdout), result.stderr


def amounts(scene):
    template = json.loads((scene / "out" / "apply.openjd.json").read_text())
    (step,) = template["steps"]
    found = step.get("hostRequirements", {"amounts": []})["amounts"]
    return {amount["name"].split(".")[-1]: amount["min"] for amount in found}


def test_a_job_asks_for_what_the_plan_of_its_cores_states(scene):
    """In MiB; cores share the work, each in memory of its own; workers the same."""
    asked = {}
    for cores in (1, 4):
        words = [str(scene / "thin.json"), str(scene / "plate.####.exr")]
        words += ["--depth-unit", "mm", "--cores", str(cores), "--json"]
        planned = CliRunner().invoke(app, ["plan", *words])
        assert planned.exit_code == 0, planned.output
        plan = json.loads(planned.stdout)
        assert plan["cores"] == cores
        said, _ = submitted(scene, *(["--cores", "1"] if cores == 1 else []))
        asked[cores] = said["host"]["gib"]
        assert asked[cores] == pytest.approx(plan["expected_gib"], abs=6e-3)
        assert amounts(scene) == {
            "vcpu": cores,
            "memory": math.ceil(said["host"]["gib"] * 1024),
        }
        (task,) = words_in(scene / "out")
        assert parsed(task[1:])["cores"] == cores
    assert asked[1] < asked[4]
    two, _ = submitted(scene, "--workers", "2", "--cores", "2")
    assert two["host"]["gib"] == pytest.approx(2 * asked[1], abs=2e-3)


def test_memory_that_is_stated_is_asked_for(scene):
    said, _ = submitted(scene, "--memory-gib", "12", "--cores", "3")
    assert said["host"] == {"cores": 3, "gib": 12}
    assert amounts(scene) == {"vcpu": 3, "memory": 12 * 1024}


def test_what_cannot_be_planned_asks_for_nothing_and_says_so(scene):
    (scene / "plate.0001.exr").write_bytes(b"still being rendered")
    said, remarks = submitted(scene)
    assert "host" not in said
    assert amounts(scene) == {}
    assert "no memory is asked for, since nothing is planned" in remarks
    assert "plate.0001.exr" in remarks
    (task,) = words_in(scene / "out")
    assert parsed(task[1:])["cores"] is None


def openjd(*words):
    run = subprocess.run(
        [sys.executable, "-m", "openjd", *map(str, words)],
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert run.returncode == 0, run.stdout + run.stderr
    return run.stdout


def test_open_job_description_accepts_it_and_words_arrive_whole(job, tmp_path):
    """Run by its own implementation, with a program that writes its words down."""
    program, log = tmp_path / "program", tmp_path / "log"
    program.write_text(RECORDER.format(python=sys.executable, log=str(log)))
    program.chmod(0o755)
    options = given_to_every_option(job)
    result = submit(job, "--chunk", "3", "--json", *options)
    said = json.loads(result.stdout)
    template, _ = said["files"]
    assert "passes validation" in openjd("check", template)
    openjd(*said["run"][1:], "-p", f"Command={program}")
    ran = [json.loads(line) for line in log.read_text().splitlines()]
    plain = {"progress_as": "auto"}  # each farm reads progress its own way
    assert [parsed(words[1:]) | plain for words in ran] == [
        parsed(words[1:]) | plain for words in words_of(job)
    ]
    assert ran[0][1] == str(job / "preset.json")
    assert ran[0][2] == str(job / f"{NASTY}.####.exr")


@pytest.mark.slow
def test_a_farm_renders_what_apply_renders(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(Path(__file__).parents[1] / "workflow")
    from plate_makers import make_preset, write_plate

    from lensfit.preset.store import save_preset

    save_preset(make_preset(), tmp_path / "preset.json")
    for number in range(1, 4):
        write_plate(tmp_path / f"plate.{number:04d}.exr")
    words = [str(tmp_path / "preset.json"), str(tmp_path / "plate.####.exr")]
    common = ["--no-falloff", "--no-defocus", "--keep-overscan", "--tolerance", "2e-4"]
    farm, own = tmp_path / "farm", tmp_path / "own"
    result = CliRunner().invoke(
        app, ["submit", *words, "--out", str(farm), "--chunk", "2", "--json", *common]
    )
    assert json.loads(result.stdout)["host"]["cores"] == 4
    path = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
    monkeypatch.setenv("PATH", path)
    openjd(*json.loads(result.stdout)["run"][1:])
    CliRunner().invoke(app, ["apply", *words, "--out", str(own), *common])
    for frame in sorted(own.iterdir()):
        assert frame.read_bytes() == (farm / frame.name).read_bytes()
    assert len(list(farm.glob("*.exr"))) == 3


def test_opencue_without_pyoutline_says_what_to_install(job, monkeypatch):
    monkeypatch.setitem(sys.modules, "outline", None)
    result = submit(job, "--to", "opencue")
    assert result.exit_code == 1
    assert "pip install 'lensfit[opencue]'" in result.stderr
    assert not (job / "o ut").exists()


def test_pyoutline_runs_the_words_as_they_are(job, tmp_path, monkeypatch):
    outline = pytest.importorskip("outline")
    from outline.cuerun import execute_frame

    program, log = tmp_path / "lensfit", tmp_path / "log"
    program.write_text(RECORDER.format(python=sys.executable, log=str(log)))
    program.chmod(0o755)
    monkeypatch.setenv("PATH", f"{tmp_path}{os.pathsep}{os.environ['PATH']}")
    monkeypatch.setenv("HOME", str(tmp_path))
    options = given_to_every_option(job)
    assert submit(job, "--to", "opencue", "--chunk", "3", *options).exit_code == 0
    assert submit(job, "--chunk", "3", *options).exit_code == 0
    script = outline.load_outline(str(job / "o ut" / "apply.outline"))
    script.setup()
    for frame in (1, 2):
        execute_frame(script.get_path(), "apply", frame)
    ran = [json.loads(line) for line in log.read_text().splitlines()]
    plain = {"progress_as": "auto"}  # each farm reads progress its own way
    assert [parsed(words[1:]) | plain for words in ran] == [
        parsed(words[1:]) | plain for words in words_of(job)
    ]
