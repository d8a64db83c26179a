"""Write kit.json and kit.html from the record of every lens."""

import json
from pathlib import Path
from typing import Any

from lensfit.atomic import write_text_atomic
from lensfit.workflow.kit.kit_page import kit_page
from lensfit.workflow.kit.kit_records import Kit
from lensfit.workflow.kit.lens_record import read_record
from lensfit.workflow.kit.match import matches

TABLE, PAGE = "kit.json", "kit.html"


def write_kit(kit: Kit, out: Path) -> dict[str, Any]:
    """Write both files into the folder of results, and return what kit.json holds.

    Raises
    ------
    OutputError : They cannot be written.
    """
    table = kit_table(kit, out)
    write_text_atomic(out / TABLE, json.dumps(table, indent=1))
    write_text_atomic(out / PAGE, kit_page(table))
    return table


def kit_table(kit: Kit, out: Path) -> dict[str, Any]:
    """What became of every lens, and how lenses of a set match.

    Raises
    ------
    LensfitError : The plan cannot be made.
    """
    lenses = [_row(kit, folder, out / folder) for folder in kit.lenses]
    return {
        "schema": "lensfit.kit.1",
        "name": kit.name,
        "camera": {"model": kit.camera.model},
        "lenses": lenses,
        "sets": matches(lenses),
    }


def _row(kit: Kit, folder: str, results: Path) -> dict[str, Any]:
    lens, record = kit.lenses[folder], read_record(results)
    row: dict[str, Any] = {
        "folder": folder,
        "name": lens.name,
        "serial": lens.serial,
        "lens_set": lens.lens_set,
        "focal_lengths_mm": list(lens.focal_lengths_mm),
        "state": "waiting",
        "failed": None,
        "report": None,
    }
    if record is None:
        return row
    if record["failed"]:
        return row | {"state": "failed", "failed": record["failed"]}
    return row | {"state": "done", "report": f"{folder}/report.html"} | record["facts"]
