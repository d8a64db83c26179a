"""The command line as a test runs it, in this process."""

from click.testing import Result
from typer.testing import CliRunner

from lensfit.cli.main import app


def run(*words: object) -> Result:
    """What became of a command, whatever that was."""
    return CliRunner().invoke(app, [str(word) for word in words])


def run_well(*words: object) -> Result:
    """What became of a command that succeeds."""
    done = run(*words)
    assert done.exit_code == 0, done.stderr
    return done
