"""Writes ``report.html`` beside the ``report.json`` that a calibration made.

The report dictionary (schema ``lensfit.report.1``) is all that is read, with the
overlay pictures that it names relative to the folder of results. A picture that is
gone is said to be gone; nothing else in the page can fail to load, as nothing is
outside the file.
"""

from pathlib import Path

from lensfit.atomic import write_text_atomic
from lensfit.workflow.report_html import page
from lensfit.workflow.report_pictures import data_addresses


def write_report(report: dict, out_dir: Path) -> Path:
    """Write the self-contained page of a calibration.

    Parameters
    ----------
    report : what ``calibrate`` writes as ``report.json``.
    out_dir : the folder of results; overlay paths in the report start from it.

    Returns
    -------
    Path of the page, ``out_dir/report.html``.
    """
    named = [
        take["overlay"] for take in report.get("takes") or [] if take.get("overlay")
    ]
    addresses = data_addresses([out_dir / name for name in named])
    text = page(report, dict(zip(named, addresses, strict=True)))
    target = out_dir / "report.html"
    write_text_atomic(target, text)
    return target
