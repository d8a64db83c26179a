"""A kit as a job of a render farm: a task for each lens, then the kit's page.

It is an Open Job Description template, as `lensfit submit` writes one: the folder of
the kit file and that of the results are PATH parameters, so that a farm may map them.
Every task writes the page with the results so far, so that it exists even if a lens
fails and the farm never starts the last step.
"""

from pathlib import Path
from typing import Any

from lensfit.plate.farm.job import absolute
from lensfit.plate.farm.openjd_template import (
    checked_template,
    path_parameter,
    text_parameter,
)
from lensfit.workflow.kit.kit_file import Kit


def kit_template(
    kit: Kit, out: Path, lenses: list[str], effort: str
) -> tuple[dict[str, Any], dict[str, str]]:
    """The template, and the values of its parameters that are paths.

    Parameters
    ----------
    lenses : Folders of those to calibrate.

    Raises
    ------
    OutputError : The job is larger than the specification allows.
    """
    definitions = [
        text_parameter(
            "Command", "lensfit", "The program, where it is not on the PATH"
        ),
        path_parameter("KitFolder", "DIRECTORY", "IN", "Folder of the kit file"),
        text_parameter("KitName", kit.path.name, "Name of the kit file"),
        path_parameter("Out", "DIRECTORY", "OUT", "Folder for the results"),
        text_parameter("Effort", effort, "Speed against error of the blur"),
    ]
    paths = {
        "KitFolder": str(absolute(kit.path.parent)),
        "Out": str(absolute(out)),
    }
    file = "{{Param.KitFolder}}/{{Param.KitName}}"
    one = ["kit", "calibrate", file, "--out={{Param.Out}}", "--workers=1"]
    one += ["--effort={{Param.Effort}}", "--lens={{Task.Param.Lens}}"]
    lens = {"name": "Lens", "type": "STRING", "range": lenses}
    calibrate = {
        "name": "calibrate",
        "parameterSpace": {"taskParameterDefinitions": [lens]},
        "script": _script(one),
    }
    page = {
        "name": "page",
        "dependencies": [{"dependsOn": "calibrate"}],
        "script": _script(["kit", "report", file, "--out={{Param.Out}}"]),
    }
    name = f"lensfit kit {kit.path.stem}"
    return checked_template(name, definitions, [calibrate, page], lenses, paths), paths


def _script(words: list[str]) -> dict[str, Any]:
    return {"actions": {"onRun": {"command": "{{Param.Command}}", "args": words}}}
