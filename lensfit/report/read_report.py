"""Read the report.json of a calibration, without trusting its content."""

from pathlib import Path
from typing import Any

from lensfit._strict import read_json_object
from lensfit.errors import LensfitError


def read_report(path: Path) -> dict[str, Any]:
    """The tables of a report.

    Raises
    ------
    LensfitError : There is none, or it is something else.
    """
    tables = read_json_object(
        path,
        error=LensfitError,
        source='give the folder that "lensfit calibrate" wrote',
        mend="calibrate again",
    )
    if not str(tables.get("schema")).startswith("lensfit.report."):
        raise LensfitError(
            "is JSON but no report of lensfit",
            where=path,
            remedy='give the report.json that "lensfit calibrate" wrote',
        )
    return tables
