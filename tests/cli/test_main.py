"""The front door: help, version, exit codes, and one line for every failure."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
import typer
from typer.testing import CliRunner

from lensfit import __version__
from lensfit.cli import main
from lensfit.cli._door import DoorGroup
from lensfit.cli._options import EFFORTS_OR_NONE
from lensfit.errors import ShootError
from lensfit.fitting.wavefront.effort import Effort

runner = CliRunner()


def lensfit(*arguments: str | Path, **environment: str) -> subprocess.CompletedProcess:
    """The program itself, as a user starts it."""
    return subprocess.run(
        [sys.executable, "-c", "from lensfit.cli.main import main; main()", *arguments],
        capture_output=True,
        text=True,
        env=os.environ | environment,
        check=False,
    )


def test_a_reader_that_left_is_no_failure():
    text = """
from lensfit.cli.main import app
@app.command()
def talk():
    for _ in range(100000):
        print("a line")
app()
"""
    with subprocess.Popen(
        [sys.executable, "-c", text, "talk"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    ) as run:
        assert run.stdout is not None
        assert run.stderr is not None
        assert run.stdout.readline() == "a line\n"
        run.stdout.close()
        assert run.stderr.read() == ""
    assert run.returncode == 1


def test_the_terminal_breaks_the_lines_of_help(failing):
    @failing.command()
    def wide() -> None:
        """First.

        One paragraph whose
        source is
        broken.

        Example: lensfit a
        Example: lensfit b
        """

    text = runner.invoke(failing, ["wide", "--help"], env={"COLUMNS": "80"}).stdout
    lines = [line.strip() for line in text.splitlines()]
    for line in (
        "One paragraph whose source is broken.",
        "Example: lensfit a",
        "Example: lensfit b",
    ):
        assert line in lines


def assert_one_line(text: str, said: str) -> None:
    assert text.startswith("lensfit: error: ")
    assert text.count("\n") == 1
    assert said in text


@pytest.fixture
def failing() -> typer.Typer:
    """A program whose commands fail in every way a command can."""
    app = typer.Typer(cls=DoorGroup)

    @app.callback()
    def options(debug: bool = typer.Option(False, "--debug")) -> None:
        pass

    @app.command()
    def shoot() -> None:
        raise ShootError("has no take", where="a.toml", remedy="add one")

    @app.command()
    def bug() -> None:
        raise ZeroDivisionError("division\nby zero")

    @app.command()
    def stop() -> None:
        raise KeyboardInterrupt

    @app.command()
    def leave() -> None:
        raise typer.Exit(3)

    return app


@pytest.mark.parametrize(
    ("command", "line"),
    [
        ("shoot", "lensfit: error: a.toml: has no take; add one\n"),
        (
            "bug",
            "lensfit: error: ZeroDivisionError: division by zero; "
            "run again with --debug for the traceback\n",
        ),
        ("stop", "lensfit: error: interrupted\n"),
    ],
)
def test_a_failure_is_one_line_and_exit_code_1(failing, command: str, line: str):
    result = runner.invoke(failing, [command])
    assert result.exit_code == 1
    assert result.stderr == line
    assert result.stdout == ""


@pytest.mark.parametrize("arguments", [["--debug", "bug"], ["bug", "--debug"]])
def test_debug_shows_the_traceback_wherever_it_stands(failing, arguments: list[str]):
    result = runner.invoke(failing, arguments)
    assert result.exit_code == 1
    assert "Traceback (most recent call last)" in result.stderr
    assert "ZeroDivisionError" in result.stderr


def test_a_command_may_choose_its_exit_code(failing):
    assert runner.invoke(failing, ["leave"]).exit_code == 3


def test_wrong_usage_is_exit_code_2():
    for arguments in (["bogus"], ["calibrate"], ["--bogus"], ["preset", "bogus"]):
        result = runner.invoke(main.app, arguments)
        assert result.exit_code == 2, arguments
        assert result.stdout == ""


@pytest.mark.parametrize("command", main.COMMANDS + main.MEASURING)
def test_every_command_has_help_with_an_example(command: str):
    result = runner.invoke(main.app, [command, "--help"], env={"COLUMNS": "200"})
    assert result.exit_code == 0
    first = {"preset": "show", "bench": "fit", "kit": "plan"}
    if command in first:
        result = runner.invoke(main.app, [command, first[command], "--help"])
    assert re.search(rf"Example: lensfit {command}", result.stdout)


def commands(group, *before: str):
    """Every command and its words, nested ones too."""
    for name, command in group.commands.items():
        if hasattr(command, "commands"):
            yield from commands(command, *before, name)
        else:
            yield (*before, name), command


COMMANDS = dict(commands(typer.main.get_command(main.app)))


@pytest.mark.parametrize("words", COMMANDS, ids=" ".join)
def test_a_terminal_of_80_columns_cuts_no_name_of_an_option(words: tuple[str, ...]):
    result = runner.invoke(main.app, [*words, "--help"], env={"COLUMNS": "80"})
    shown = set(re.findall(r"(?<![\w-])--?[\w-]+(?=[\s,])", result.stdout))
    options = [p for p in COMMANDS[words].params if p.param_type_name == "option"]
    wanted = {w for p in options for w in (*p.opts, *p.secondary_opts)}
    assert max(map(len, result.stdout.splitlines())) <= 80
    assert sorted(wanted - shown) == []


@pytest.mark.parametrize(
    ("option", "value", "said"),
    [
        ("--coma-gain", "abc", "'abc' is no number"),
        ("--coma-gain", "nan", "nan is not from -100 to 100"),
        ("--coma-gain", "-100.5", "-100.5 is not from -100 to 100"),
        ("--blades", "2.5", "'2.5' is no whole number"),
        ("--blades", "17", "17 is not from 0 to 16"),
    ],
)
def test_a_knob_that_cannot_be_set_is_wrong_usage(option: str, value: str, said: str):
    asked = ["apply", "a.json", "b.exr", "--out", "c", option, value]
    result = runner.invoke(main.app, asked, env={"COLUMNS": "80"})
    assert result.exit_code == 2
    assert f"Invalid value for '{option}': {said}" in result.stderr


def test_the_program_starts_and_knows_its_version():
    run = lensfit("--version")
    assert (run.returncode, run.stdout) == (0, f"lensfit {__version__}\n")


BAD_SHOOTS = {
    "missing file": None,
    "not TOML": "[lens\n",
    "picture": "\x89PNG",
    "empty": "",
    "unknown key": '[lens]\nnam = "x"\n',
}


@pytest.mark.parametrize("kind", BAD_SHOOTS)
def test_a_bad_shoot_is_one_line_and_nothing_written(kind: str, tmp_path: Path):
    shoot, out = tmp_path / "shoot.toml", tmp_path / "out"
    content = BAD_SHOOTS[kind]
    if content is not None:
        shoot.write_bytes(content.encode("latin-1"))
    result = runner.invoke(main.app, ["calibrate", str(shoot), "--out", str(out)])
    assert result.exit_code == 1
    assert_one_line(result.stderr, str(shoot))
    assert result.stdout == ""
    assert not out.exists()


def test_a_bad_shoot_through_the_real_program(tmp_path: Path):
    shoot = tmp_path / "shoot.toml"
    shoot.write_text('[lens]\nname = "x"\n[[tagret]]\n')
    run = lensfit("calibrate", shoot, "--out", tmp_path / "out")
    assert run.returncode == 1
    assert_one_line(run.stderr, 'unknown key "tagret"; did you mean "target"?')
    assert [path.name for path in tmp_path.iterdir()] == ["shoot.toml"]


def test_the_compilation_cache_may_be_moved_or_left_out(tmp_path: Path):
    script = (
        "import lensfit, jax; "
        "print(jax.config.jax_compilation_cache_dir, jax.numpy.zeros(1).dtype)"
    )

    def run(**environment: str) -> str:
        clean = {k: v for k, v in os.environ.items() if not k.startswith("JAX_")}
        command = [sys.executable, "-c", script]
        return subprocess.run(
            command, capture_output=True, text=True, env=clean | environment, check=True
        ).stdout

    moved = run(LENSFIT_CACHE_DIR=str(tmp_path))
    assert moved.startswith(f"{tmp_path}{os.sep}")
    assert f"{os.sep}jax{os.sep}" in moved
    assert moved.endswith(" float64\n")
    assert run(LENSFIT_CACHE_DIR="") == "None float64\n"
    assert run(JAX_COMPILATION_CACHE_DIR=str(tmp_path)).startswith(f"{tmp_path} ")


@pytest.mark.skipif(os.name == "nt", reason="no users in this sense")
@pytest.mark.parametrize("loads_jax_first", [False, True])
def test_a_cache_of_jax_that_others_can_write_is_not_used(tmp_path, loads_jax_first):
    shared = tmp_path / "shared"
    shared.mkdir()
    shared.chmod(0o777)
    script = (
        "import lensfit, jax; from lensfit._jax import cache_note; "
        "print(jax.config.jax_compilation_cache_dir); print(cache_note())"
    )
    script = ("import jax; " if loads_jax_first else "") + script
    variables = {"JAX_COMPILATION_CACHE_DIR": str(shared), "LENSFIT_CACHE_DIR": ""}
    command = [sys.executable, "-c", script]
    done = subprocess.run(
        command, capture_output=True, text=True, env=os.environ | variables, check=True
    )
    used, note = done.stdout.splitlines()
    assert used == "None"
    assert "JAX_COMPILATION_CACHE_DIR is not used" in note
    assert str(shared) in note


def test_the_efforts_of_the_help_are_those_of_the_fit():
    assert tuple(one.name.lower() for one in Effort) == EFFORTS_OR_NONE
