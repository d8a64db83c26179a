"""What the command line says to someone who uses it wrongly."""

from typer.testing import CliRunner

from lensfit.cli.main import app


def told_of_wrong_usage(*words: str) -> str:
    """The words about it, in one line; the exit code is 2."""
    done = CliRunner().invoke(app, list(words))
    assert done.exit_code == 2
    return unboxed(done.output)


def unboxed(text: str) -> str:
    """In one line, without the box that is drawn around it."""
    return " ".join(text.replace("│", " ").split())
