"""A job of a benchmark in a process of its own: another Python, or one just started."""

import subprocess
from pathlib import Path

from lensfit.errors import LensfitError


def output_of(
    command: list[str],
    *,
    patience_s: float,
    failed: str,
    where: str | Path,
    remedy: str,
    environment: dict[str, str] | None = None,
) -> list[str]:
    """The lines that a command prints.

    Parameters
    ----------
    patience_s : The longest that it may take.
    failed, where, remedy : What is said if it fails; its own last line is added.
    environment : All of it; that of this process if None.

    Raises
    ------
    LensfitError : It cannot be run, fails, or takes too long.
    """
    try:
        ran = subprocess.run(
            command,
            capture_output=True,
            text=True,
            timeout=patience_s,
            check=True,
            env=environment,
        )
    except (OSError, subprocess.SubprocessError) as error:
        said = (getattr(error, "stderr", None) or str(error)).strip()
        raise LensfitError(
            f"{failed} ({said.splitlines()[-1]})", where=where, remedy=remedy
        ) from error
    return ran.stdout.splitlines()
