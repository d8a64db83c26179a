"""The command line as a test runs it, in this process."""

from typing import Any

from click.testing import Result
from typer.testing import CliRunner

from lensfit.cli.main import app


def run(*words: object, **settings: Any) -> Result:
    """What became of a command, whatever that was.

    Parameters
    ----------
    settings : Of Typer's runner: `env`, `terminal_width` and others.
    """
    return CliRunner().invoke(app, [str(word) for word in words], **settings)


def run_well(*words: object) -> Result:
    """What became of a command that succeeds."""
    done = run(*words)
    assert done.exit_code == 0, done.stderr
    return done
