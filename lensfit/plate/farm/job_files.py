"""A farm job in files of farms: an Open Job Description template, an OpenCue outline.

In the template, preset, plates, results and files among the options are PATH
parameters, so that a farm may map them to their place on a machine. Their values stand
in a separate file, since the specification forbids a default that leaves the template's
folder. Options are INT, FLOAT and STRING parameters with the values given as defaults;
where they are more than the specification allows, numbers stand in the command itself.
Every text of a user is the value of a parameter: neither a shell nor the template's
format strings read it.

What a task needs of its host stands in ``hostRequirements``: memory in MiB.

The outline of OpenCue, one layer with a list of commands, is a script for ``pycuerun``.
Its commands are lists of words, which PyOutline runs without a shell. The script is
read back by PyOutline as a check.

References
----------
Open Job Description, "Template Schemas", 2023-09.
"""

import math
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from lensfit.atomic import write_text_atomic
from lensfit.errors import OutputError
from lensfit.plate.farm.job import FarmJob, HandedOption, option_words

_PROGRESS = "--progress=openjd"
"""Tells a worker how far a task is (`lensfit.cli._terminal`)."""
_MOST_TASKS = 1024
_MOST_PARAMETERS = 50
_LONGEST_VALUE = 1024


def openjd_template(job: FarmJob) -> tuple[dict[str, Any], dict[str, str]]:
    """The template, and the values of its parameters that are paths.

    Raises
    ------
    OutputError : The job is larger than the specification allows.
    """
    definitions = [
        _command(),
        path_parameter("Preset", "FILE", "IN", "Preset of the lens"),
    ]
    paths = {"Preset": str(job.preset), "Out": str(job.out)}
    words = ["apply", "{{Param.Preset}}"]
    if job.chunks:
        definitions += [
            path_parameter("PlatesFolder", "DIRECTORY", "IN", "Folder of the plates"),
            text_parameter(
                "PlatesName", job.plates.name, "Pattern of the plates' names"
            ),
        ]
        paths["PlatesFolder"] = str(job.plates.parent)
        words += ["{{Param.PlatesFolder}}/{{Param.PlatesName}}"]
        words += ["--frames={{Task.Param.Frames}}"]
    else:
        definitions.append(path_parameter("Plate", "FILE", "IN", "The plate"))
        paths["Plate"] = str(job.plates)
        words.append("{{Param.Plate}}")
    definitions.append(
        path_parameter("Out", "DIRECTORY", "OUT", "Folder for the results")
    )
    words.append("--out={{Param.Out}}")
    count = len(definitions) + sum(len(option.values) for option in job.options)
    for option in job.options:
        values = [
            str(value)
            if count > _MOST_PARAMETERS and isinstance(value, (int, float))
            else _parameter(option, value, definitions, paths)
            for value in option.values
        ]
        words += option_words(option, values)
    words.append(_PROGRESS)
    step = _step(job, words)
    template = checked_template(job.name, definitions, [step], job.chunks, paths)
    return template, paths


def _step(job: FarmJob, words: list[str]) -> dict[str, Any]:
    """The one step of the job: the command, what its host needs, its tasks."""
    step: dict[str, Any] = {
        "name": "apply",
        "script": {
            "actions": {"onRun": {"command": "{{Param.Command}}", "args": words}}
        },
    }
    if job.needs is not None:
        step["hostRequirements"] = {
            "amounts": [
                {"name": "amount.worker.vcpu", "min": job.needs.cores},
                {"name": "amount.worker.memory", "min": job.needs.mib},
            ]
        }
    if job.chunks:
        frames = {"name": "Frames", "type": "STRING", "range": list(job.chunks)}
        step["parameterSpace"] = {"taskParameterDefinitions": [frames]}
    return step


def checked_template(
    name: str,
    definitions: list[dict[str, Any]],
    steps: list[dict[str, Any]],
    tasks: Sequence[str],
    paths: dict[str, str],
) -> dict[str, Any]:
    """A template that keeps to the limits of the specification.

    Parameters
    ----------
    tasks : The range of the step of most tasks.

    Raises
    ------
    OutputError : It does not.
    """
    _check(tasks, definitions, paths)
    return {
        "specificationVersion": "jobtemplate-2023-09",
        "name": name,
        "parameterDefinitions": definitions,
        "steps": steps,
    }


def _parameter(
    option: HandedOption, value: object, definitions: list, paths: dict[str, str]
) -> str:
    """What stands for a value in the command: a parameter, which is defined here."""
    stem = "".join(part.capitalize() for part in re.split(r"\W+", option.word))
    taken = {definition["name"] for definition in definitions}
    name, count = stem, 1
    while name in taken:
        count += 1
        name = f"{stem}{count}"
    if isinstance(value, Path):
        kind = "DIRECTORY" if value.is_dir() else "FILE"
        definitions.append(path_parameter(name, kind, "IN", option.word))
        paths[name] = str(value)
    elif isinstance(value, int) or (isinstance(value, float) and math.isfinite(value)):
        kind = "INT" if isinstance(value, int) else "FLOAT"
        definitions.append(
            {"name": name, "type": kind, "default": value, "description": option.word}
        )
    else:
        definitions.append(text_parameter(name, str(value), option.word))
    return f"{{{{Param.{name}}}}}"


def _command() -> dict[str, str]:
    return text_parameter(
        "Command", "lensfit", "The program, where it is not on the PATH"
    )


def text_parameter(name: str, value: str, said: str) -> dict[str, str]:
    """A parameter that is a word."""
    return {"name": name, "type": "STRING", "default": value, "description": said}


def path_parameter(name: str, kind: str, flow: str, said: str) -> dict[str, str]:
    """A parameter that is a file or a folder, which farms may map."""
    return {
        "name": name,
        "type": "PATH",
        "objectType": kind,
        "dataFlow": flow,
        "description": said,
    }


def _check(tasks: Sequence[str], definitions: list, paths: dict[str, str]) -> None:
    if len(tasks) > _MOST_TASKS:
        raise OutputError(
            f"a job of {len(tasks)} tasks is more than the {_MOST_TASKS} of Open "
            "Job Description",
            remedy="give more frames to a task with --chunk",
        )
    if len(definitions) > _MOST_PARAMETERS:
        raise OutputError(
            f"{len(definitions)} parameters are more than the {_MOST_PARAMETERS} of "
            "Open Job Description",
            remedy="give fewer options",
        )
    values = [
        *tasks,
        *paths.values(),
        *(d.get("default", "") for d in definitions),
    ]
    if any(isinstance(v, str) and len(v) > _LONGEST_VALUE for v in values):
        raise OutputError(
            f"a path, an option or a list of frames is longer than {_LONGEST_VALUE} "
            "characters",
            remedy="shorten it, or give fewer frames to a task with --chunk",
        )


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
