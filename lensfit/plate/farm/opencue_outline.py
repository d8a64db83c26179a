"""A farm job as an outline of OpenCue: one layer, a list of commands.

The outline is a script for ``pycuerun``. Its commands are lists of words, which
PyOutline runs without a shell. The script is read back by PyOutline as a check.
"""

import re
from pathlib import Path

from lensfit.atomic import write_text_atomic
from lensfit.errors import OutputError
from lensfit.plate.farm.job import FarmJob

_SCRIPT = '''"""{name}, {tasks} tasks. Submit it with: pycuerun {file}"""

from outline.modules.shell import ShellSequence

ShellSequence(
    "apply",
    commands=[
{commands}
    ],{needs}
)
'''


_NEEDS = """
    cores={0.cores},
    memory="{0.mib}m",
    threadable=True,"""
"""Memory in MiB, as OpenCue reads an m."""


def write_outline(job: FarmJob, path: Path) -> None:
    """Write the outline of a job.

    Raises
    ------
    OutputError : PyOutline is not installed or does not read the outline as meant, or
        a word would be changed on the way.
    """
    outline = _pyoutline(path)
    commands = [job.arguments(frames) for frames in job.chunks or (None,)]
    for word in commands[0]:
        if "%{" in word:
            raise OutputError(
                f"{word!r} holds '%{{', which PyOutline replaces", remedy="rename it"
            )
    script = _SCRIPT.format(
        name=re.sub(r"[^\w .#-]", "_", job.name),
        tasks=len(commands),
        file=re.sub(r"[^\w .#-]", "_", path.name),
        commands="\n".join(f"        {command!r}," for command in commands),
        needs=_NEEDS.format(job.needs) if job.needs else "",
    )
    write_text_atomic(path, script)
    (layer,) = outline.load_outline(str(path)).get_layers()
    if layer.get_arg("commands") != commands:
        raise OutputError("PyOutline reads it otherwise than it was meant", where=path)


def _pyoutline(path: Path):
    try:
        import outline  # pyright: ignore[reportMissingImports]
    except ImportError as error:
        raise OutputError(
            "an outline of OpenCue needs PyOutline, which is not installed",
            where=path,
            remedy="pip install 'lensfit[opencue]'",
        ) from error
    return outline
