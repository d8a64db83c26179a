"""Read the report.json of a calibration, of this or an older schema, without trusting
its content."""

from pathlib import Path
from typing import Any

from lensfit._strict import read_json_object
from lensfit.errors import LensfitError
from lensfit.preset.upgrade import renamed, with_pupil_shift

SCHEMA = "lensfit.report.2"
_KEYS_OF_1 = {"guessed": "extrapolated"}
_TEXTS_OF_1 = {
    "usual_pupil_walk": "usual_pupil_shift",
    "pupil_walk_at_other_focus": "pupil_shift_at_other_focus",
}


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
    if tables["schema"] == "lensfit.report.1":
        words = renamed(with_pupil_shift(tables), _KEYS_OF_1, _TEXTS_OF_1)
        return words | {"schema": SCHEMA}
    return tables
