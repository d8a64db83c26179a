"""The record of each lens of a kit: its figures, and what a run resumes by.

The record holds a fingerprint of all that a calibration reads. A lens whose record has
the same fingerprint, and whose results exist, is done; one that failed is tried again,
since the cause may be gone.

Its figures are for the kit's page, from the report of the lens. Everything is plain
numbers, ready for JSON. A figure that was not measured is None.

The fit of the blur measures how far behind its sharp image the sensor lay in each
photograph, besides what all photographs have in common. With v the distance of the
sharp image from the lens, a mark that is engraved D but focuses at D' shows the
difference ``v(D') - v(D)``, and of a thin lens ``1/f = 1/(D - v) + 1/v``.

The width of a point's image in focus is the diameter of the disc of the same second
moments, ``4 sqrt(variance)`` with the mean variance of both directions, as everywhere
in lensfit.
"""

import hashlib
import json
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from lensfit import __version__
from lensfit.atomic import write_text_atomic
from lensfit.chart.chart_camera import object_distance_mm
from lensfit.preset.schema import Preset
from lensfit.report.plain_numbers import distance_of, plain, plain_distance
from lensfit.report.verdict import verdict_of
from lensfit.workflow.calibration.results_folder import PRESET, REPORT
from lensfit.workflow.kit.kit_file import FocusMark, KitLens
from lensfit.workflow.shoot.shoot_records import Shoot

_SAME_MM = 0.5


def focus_scale(lens: KitLens, report: dict[str, Any]) -> list[dict[str, Any]]:
    """A row for each focal length and mark that the blur was measured at.

    Returns
    -------
    Each "engraved", "engraved_mm", "measured_mm" and "standard_deviation_mm" ("inf"
    where infinite), and "off_mm" of the image behind the lens, in which marks compare.
    Anamorphic lenses focus twice, and have none.
    """
    if (lens.anamorphic_squeeze or 1.0) != 1.0:
        return []
    rows = []
    for blur in report.get("blur") or []:
        for mark in lens.focus_marks:
            row = _focus_row(float(blur["focal_length_mm"]), mark, blur)
            if row is not None:
                rows.append(row)
    return rows


def measured_distance_mm(
    focal_length_mm: float, engraved_mm: float, off_mm: float
) -> float:
    """Where a mark focuses whose sharp image lies `off_mm` farther from the lens.

    Raises
    ------
    ChartError : The mark is nearer than four focal lengths.
    """
    image_mm = _image_distance_mm(focal_length_mm, engraved_mm) + off_mm
    if image_mm <= focal_length_mm:
        return math.inf
    return image_mm + 1 / (1 / focal_length_mm - 1 / image_mm)


def _image_distance_mm(focal_length_mm: float, distance_mm: float) -> float:
    if math.isinf(distance_mm):
        return focal_length_mm
    return distance_mm - object_distance_mm(focal_length_mm, distance_mm)


def _focus_row(focal_mm: float, mark: FocusMark, blur: dict) -> dict[str, Any] | None:
    """Weighted over the photographs at the mark; None where none tells."""
    weights, sums = 0.0, 0.0
    for group in blur.get("defocus") or []:
        from_stated = group.get("from_stated") or {}
        focus, target = (
            distance_of(group.get(key))
            for key in ("focus_distance_mm", "target_distance_mm")
        )
        value, deviation = (
            from_stated.get("defocus_mm"),
            from_stated.get("standard_deviation_mm"),
        )
        if focus is None or target is None or value is None or not deviation:
            continue
        same = focus == mark.distance_mm or abs(focus - mark.distance_mm) < _SAME_MM
        if not same:
            continue
        stated = _image_distance_mm(focal_mm, focus)
        stated -= _image_distance_mm(focal_mm, target)
        weights += 1 / deviation**2
        sums += (value - stated) / deviation**2
    if not weights:
        return None
    off_mm, deviation_mm = sums / weights, weights**-0.5
    measured = measured_distance_mm(focal_mm, mark.distance_mm, off_mm)
    beside = measured_distance_mm(focal_mm, mark.distance_mm, off_mm + deviation_mm)
    spread = abs(measured - beside) if math.isfinite(measured + beside) else math.inf
    return {
        "focal_length_mm": focal_mm,
        "engraved": mark.engraved,
        "engraved_mm": plain_distance(mark.distance_mm),
        "measured_mm": plain_distance(measured),
        "standard_deviation_mm": plain_distance(spread),
        "off_mm": off_mm,
        "off_deviation_mm": deviation_mm,
    }


Facts = dict[str, Any]


def lens_facts(lens: KitLens, report: Facts) -> Facts:
    """Verdict and figures of a lens.

    Parameters
    ----------
    report : As in ``report.json``.

    Returns
    -------
    "verdict" (level, headline, accuracy_px, remedy), "focal_lengths" (a row for each:
    breathing, distortion, lateral colour, fall-off) and "focus_scale".
    """
    judged = verdict_of(report)
    first = judged.reasons[0]
    entries = report.get("entries") or []
    focals = list(dict.fromkeys(entry.get("focal_length_mm") for entry in entries))
    return {
        "verdict": {
            "level": judged.level,
            "headline": judged.headline,
            "accuracy_px": judged.accuracy_px,
            "tone": first.tone,
            "remedy": first.remedy,
        },
        "views_used": sum(not t.get("failed") for t in report.get("takes") or []),
        "seconds": (report.get("seconds") or {}).get("whole"),
        "focal_lengths": [
            _focal_facts(focal, [e for e in entries if e["focal_length_mm"] == focal],
                         report)
            for focal in focals
        ],
        "focus_scale": focus_scale(lens, report),
    }  # fmt: skip


def _focal_facts(focal_mm: float, entries: list[Facts], report: Facts) -> Facts:
    far = max(entries, key=_focus_order)
    fitted = [
        s
        for s in report.get("statements") or []
        if s["quantity"] == "focal_length" and s["focal_length_mm"] == focal_mm
    ]
    distortion = _corner_distortion(far)
    return {
        "focal_length_mm": focal_mm,
        "fitted_focal_length_mm": plain(_mean([s["fitted"] for s in fitted])),
        "breathing_percent": breathing_percent(entries),
        "distortion_percent": distortion,
        "lateral_colour_px": _lateral_px(entries),
        "fall_off": list(_fall_off(entries)),
    }


def breathing_percent(entries: list[Facts]) -> float | None:
    """How much larger the lens draws at its nearest mark than at its farthest."""
    known = sorted(
        (one for one in entries if one.get("focus_distance_mm") is not None),
        key=_focus_order,
    )
    if len(known) < 2:
        return None
    near, far = (float(one["principal_distance_mm"]) for one in (known[0], known[-1]))
    return round(100 * (near / far - 1), 4)


def _focus_order(entry: Facts) -> float:
    focus = distance_of(entry.get("focus_distance_mm"))
    return math.inf if focus is None else focus


def _corner_distortion(entry: Facts) -> float | None:
    """The last value of the radial profile, at the frame's corner; percent."""
    values = (entry.get("radial_profile") or {}).get("distortion_percent") or []
    known = [value for value in values if value is not None]
    return float(known[-1]) if known else None


def _lateral_px(entries: list[Facts]) -> float | None:
    """The largest displacement of red or blue against green."""
    curves = [entry.get("lateral_colour") or {} for entry in entries]
    values = [
        abs(value)
        for curve in curves
        for key in ("r_px", "b_px")
        for value in curve.get(key) or []
        if value is not None
    ]
    return max(values) if values else None


def _fall_off(entries: list[Facts]) -> Iterator[Facts]:
    """Stops of light that the corner loses at each f-number, the mean of all marks."""
    lost: dict[float, list[float]] = {}
    for entry in entries:
        for curve in entry.get("fall_off") or []:
            light = curve["g"][-1] if curve.get("g") else None
            if curve.get("f_number") and light:
                lost.setdefault(curve["f_number"], []).append(-math.log2(light))
    for stop, values in sorted(lost.items()):
        yield {"f_number": stop, "corner_stops": round(float(np.mean(values)), 4)}


def _mean(values: list[float]) -> float:
    return float(np.mean(values)) if values else math.nan


_SIZE_PX = 65
_PLACES = {"centre": 0.0, "middle": 0.5, "edge": 0.9}
"""Parts of the half diagonal, along the frame's diagonal."""


def blur_widths(preset: Preset) -> list[dict[str, Any]]:
    """Of every focal length with a measured blur, wide open, focused half way.

    Returns
    -------
    Each "focal_length_mm", "f_number", "focus_distance_mm" and the widths "centre_px",
    "middle_px" and "edge_px" of green.
    """
    rows = []
    measured = [entry for entry in preset.entries if entry.blur is not None]
    for focal_mm in dict.fromkeys(entry.focal_length_mm for entry in measured):
        mine = [e for e in measured if e.focal_length_mm == focal_mm]
        focuses = sorted(e.focus_distance_mm for e in mine if e.focus_distance_mm)
        stops = [f.f_number for e in mine for f in e.fall_off if f.f_number is not None]
        if focuses and stops:
            focus_mm = focuses[len(focuses) // 2]
            rows.append(_width_row(preset, focal_mm, min(stops), focus_mm))
    return rows


def _width_row(
    preset: Preset, focal_mm: float, f_number: float, focus_mm: float
) -> dict[str, Any]:
    camera = preset.camera
    lens = preset.at(
        focal_length_mm=focal_mm, f_number=f_number, focus_distance_mm=focus_mm
    )
    pitch_mm = camera.sensor_width_mm / camera.image_width_px
    half = np.array([camera.sensor_width_mm, camera.sensor_height_mm]) / 2
    row: dict[str, Any] = {
        "focal_length_mm": focal_mm,
        "f_number": f_number,
        "focus_distance_mm": focus_mm,
    }
    for name, part in _PLACES.items():
        spread = lens.psf(
            part * half, focus_mm, channel="g", pixel_pitch_mm=pitch_mm,
            size_px=_SIZE_PX,
        )  # fmt: skip
        row[f"{name}_px"] = round(width_px(np.asarray(spread)), 3)
    return row


def width_px(spread: np.ndarray) -> float:
    """Diameter of the disc of the same second moments as a point-spread function."""
    weight = spread / spread.sum()
    total = 0.0
    for axis in (0, 1):
        place = np.arange(weight.shape[axis])
        along = weight.sum(1 - axis)
        mean = float((along * place).sum())
        total += float((along * (place - mean) ** 2).sum())
    return 4 * float(np.sqrt(total / 2))


RECORD = "kit_lens.json"
_SCHEMA = "lensfit.kit_lens.1"


def fingerprint(shoot: Shoot, effort: str) -> str:
    """Of the shoot as stated, its photographs and how they are calibrated.

    Photographs count by name, size and time of their last change: to read all of them
    would take as long as to find their dots.
    """
    stated = {
        "version": __version__,
        "effort": effort,
        "lens": msgspec.to_builtins(shoot.lens),
        "camera": msgspec.to_builtins(shoot.camera),
        "targets": msgspec.to_builtins(list(shoot.targets.values())),
        "takes": [repr(take) for take in shoot.takes],
        "files": [_stamp(shoot.image_path(take)) for take in shoot.takes],
    }
    text = json.dumps(stated, sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()[:24]


def write_record(
    folder: Path, made_of: str, failed: str | None, facts: dict[str, Any] | None
) -> None:
    """Keep what became of a lens.

    Raises
    ------
    OutputError : The folder cannot be written.
    """
    folder.mkdir(parents=True, exist_ok=True)
    record = {
        "schema": _SCHEMA,
        "fingerprint": made_of,
        "failed": failed,
        "facts": facts,
    }
    write_text_atomic(folder / RECORD, json.dumps(record, indent=1))


def read_record(folder: Path) -> dict[str, Any] | None:
    """The record of a lens; None where there is none that can be read."""
    try:
        record = json.loads((folder / RECORD).read_text(encoding="utf-8"))
        return record if record["schema"] == _SCHEMA else None
    except (OSError, ValueError, TypeError, LookupError):
        return None


def is_done(folder: Path, made_of: str) -> bool:
    """Whether the results of this very shoot are there."""
    record = read_record(folder)
    if record is None or record["fingerprint"] != made_of or record["failed"]:
        return False
    return all((folder / name).is_file() for name in (PRESET, REPORT))


def _stamp(path: Path) -> list[Any]:
    try:
        found = path.stat()
    except OSError:
        return [path.name]
    return [path.name, found.st_size, found.st_mtime_ns]
