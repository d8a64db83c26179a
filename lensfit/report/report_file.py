"""The report of a folder of results: its JSON, read without trust, and its page.

The page is made of the report dictionary (schema ``lensfit.report.2``) alone, with the
pictures that it names relative to the folder of results and, for the point-spread
functions, the preset there. A missing picture is reported as missing; nothing else in
the page can fail to load, as nothing is outside the file.

Reports of older schemas are read too.
"""

from pathlib import Path
from typing import Any

from lensfit._strict import read_json_object
from lensfit.atomic import write_text_atomic
from lensfit.errors import LensfitError
from lensfit.preset.upgrade import renamed, with_pupil_shift
from lensfit.report.kernels import kernel_sheets
from lensfit.report.pictures import data_addresses, jpeg_address
from lensfit.report.report_page import page
from lensfit.report.through import through_sheets
from lensfit.report.wipe import MODEL_PICTURES

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


def write_report(report: dict, out_dir: Path) -> Path:
    """Write the self-contained page of a calibration.

    Parameters
    ----------
    report : what ``calibrate`` writes as ``report.json``.
    out_dir : the folder of results; paths in the report start from it.

    Returns
    -------
    Path of the page, ``out_dir/report.html``.
    """
    takes = report.get("takes") or []
    blurred = [t for blur in report.get("blur") or [] for t in blur.get("takes") or []]
    addresses = _addresses([take.get("overlay") for take in takes], out_dir)
    addresses |= _addresses([take.get("picture") for take in blurred], out_dir)
    for said in [take.get("modelled") or {} for take in takes]:
        names = [said.get(key) for key in MODEL_PICTURES]
        named = [name for name in names if name and is_inside(out_dir, name)]
        addresses |= {name: jpeg_address(out_dir / name) for name in named}
    preset = out_dir / "preset.json"
    kernels, through = kernel_sheets(report, preset), through_sheets(report, preset)
    text = page(report, addresses, kernels, through)
    target = out_dir / "report.html"
    write_text_atomic(target, text)
    return target


def is_inside(folder: Path, name: str) -> bool:
    """Whether a report that came from elsewhere names a picture of its own folder."""
    try:
        return (folder / name).resolve().is_relative_to(folder.resolve())
    except (OSError, ValueError):
        return False


def _addresses(names: list[str | None], out_dir: Path) -> dict[str, str | None]:
    named = [name for name in names if name and is_inside(out_dir, name)]
    found = data_addresses([out_dir / name for name in named])
    return dict(zip(named, found, strict=True))
