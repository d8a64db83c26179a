"""Calibrate a lens from a shoot: detect, fit, write.

    photographs -> detected points -> lens states -> preset, UV maps, report

A photograph that cannot be used does not stop the others; the report lists it with the
reason. The outputs are an atomic output set (`calibration.results_folder`): they
replace those of an earlier run, all at once.
"""

import json
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from msgspec.structs import replace
from threadpoolctl import threadpool_limits

from lensfit.atomic import write_text_atomic
from lensfit.errors import DetectionError, FitError
from lensfit.exchange.stmaps import StmapFrame, file_stem, write_stmaps
from lensfit.fitting.chart_view import View
from lensfit.fitting.lens_state import LensState
from lensfit.fitting.lens_states import FittedLens, fit
from lensfit.fitting.wavefront.effort import Effort
from lensfit.lens import Lens
from lensfit.preset.schema import LensName, Preset
from lensfit.preset.store import save_preset
from lensfit.progress import Progress, silent, stopwatch
from lensfit.report.pictures import write_dot_pictures
from lensfit.report.report_page import SCHEMA as REPORT_SCHEMA
from lensfit.report.report_page import write_report
from lensfit.report.verdict import verdict_of
from lensfit.workflow.calibration.entries import (
    camera_of,
    entry_of,
    provenance_of,
    with_quality,
)
from lensfit.workflow.calibration.entry_facts import entry_facts
from lensfit.workflow.calibration.fit_facts import (
    blur_facts,
    statement_facts,
    take_facts,
    terms_of,
)
from lensfit.workflow.calibration.observe import Observed, observe_shoot
from lensfit.workflow.calibration.results_folder import PRESET, REPORT, atomic_results
from lensfit.workflow.pictures.model_pictures import write_model_pictures
from lensfit.workflow.shoot.resolve_take import with_identified_charts
from lensfit.workflow.shoot.shoot_records import Shoot
from lensfit.workflow.statements.contradiction import Contradiction
from lensfit.workflow.statements.contradictions import (
    contradictions_of_fit,
    contradictions_of_report,
    contradictions_of_views,
    gravest_first,
)
from lensfit.workflow.statements.fitted_statements import contradicted_by_fit
from lensfit.workflow.statements.repeated_exposures import without_repeated_exposures
from lensfit.workflow.statements.targets_seen import (
    contradicted_targets,
    missed_targets,
)

MAP_OVERSCAN_PERCENT = 10.0


def calibrate(
    shoot: Shoot,
    out_dir: str | Path,
    *,
    progress: Progress = silent,
    effort: str = "normal",
) -> dict[str, Any]:
    """Measure the lens of a shoot and write everything about it.

    The files appear at the end, and those of an earlier run that this one did not write
    again are removed. A run that ends in an error leaves the earlier results as they
    are and its own overlays in ``overlays_failed``; one that is interrupted, nothing.

    Parameters
    ----------
    shoot : From `lensfit.workflow.shoot.shoot_file.load_shoot`.
    out_dir : Folder for preset.json, stmaps, overlays, model, blur, report.json and
        report.html.
    progress : Receives the progress.
    effort : Speed against error of the blur: "fastest", "fast", "normal", "best"; or
        "none", which measures no blur.

    Returns
    -------
    The report, as in report.json. A take that could not be used has its reason under
    "failed".

    Raises
    ------
    LensfitError : No photograph could be used, or the folder cannot be written or holds
        the calibration of another lens.
    """
    with atomic_results(out_dir, shoot) as folder:
        with stopwatch() as seeing:
            shoot = with_identified_charts(shoot, progress)
            observed = observe_shoot(shoot, folder, progress)
        return calibrate_observed(
            shoot,
            observed,
            folder,
            progress=progress,
            effort=effort,
            seen_in_s=seeing["seconds"],
        )


# As `lensfit.fitting.lens_states.fit`: what is written is propagated by such matrices,
# too.
@threadpool_limits.wrap(limits=1, user_api="blas")
def calibrate_observed(
    shoot: Shoot,
    observed: list[Observed],
    folder: Path,
    *,
    progress: Progress = silent,
    effort: str = "normal",
    seen_in_s: float = 0.0,
) -> dict[str, Any]:
    """The same with detections that were made before, written to the folder as it goes.

    Parameters
    ----------
    shoot : Its charts read, as `with_identified_charts` does it.
    observed : By `observe_shoot`, into the same folder.
    seen_in_s : Seconds that finding them took, which count in the whole.

    Raises
    ------
    LensfitError : No photograph could be used, or the folder cannot be written.
    """
    observed, contradictions = without_repeated_exposures(observed)
    takes = [o.take for o in observed if o.take is not None]
    if not takes:
        raise DetectionError(
            observed[0].failed or "no photograph could be used",
            remedy=_others(observed),
        )
    with stopwatch() as fitting:
        targets = contradicted_targets(missed_targets(shoot, observed), observed)
        contradictions += targets
        # What is stated of exchanged photographs is of others.
        if not any(one.kind == "exchanged" for one in targets):
            contradictions += contradictions_of_views(takes)
        fitted = _fit_lens(takes, contradictions, progress, effort)
        contradictions += contradictions_of_fit(takes, fitted)
        contradictions += contradicted_by_fit(fitted.states, contradictions)
    with stopwatch() as writing, ThreadPoolExecutor(1) as pool:
        preset = preset_of(shoot, observed, fitted)
        maps_written = pool.submit(_write_maps, preset, folder, progress)
        report = _report(shoot, observed, fitted, preset, folder)
        entries = report["entries"]
        contradictions += contradictions_of_report(shoot, observed, entries)
        report["contradictions"] = [c.as_json() for c in gravest_first(contradictions)]
        judged = verdict_of(report)
        report["verdict"] = msgspec.to_builtins(judged)
        preset = replace(with_quality(preset, entries), verdict=judged)
        maps = maps_written.result()
    # One after the other; what `_seconds` counts lies within them, and overlaps.
    spent = {"fit": fitting["seconds"], "write": writing["seconds"]}
    spent["whole"] = seen_in_s + sum(spent.values())
    seconds = _seconds(observed, fitted) | spent
    report["seconds"] = {k: round(v, 3) for k, v in seconds.items()}
    report["files"]["stmaps"] = maps
    save_preset(preset, folder / PRESET)
    write_text_atomic(folder / REPORT, json.dumps(report, indent=1))
    write_report(report, folder)
    return report


def _fit_lens(
    takes: list[View],
    contradictions: list[Contradiction],
    progress: Progress,
    effort: str,
) -> FittedLens:
    """The fit; one that fails names the contradiction, if there is one.

    Raises
    ------
    FitError : No state could be fitted.
    """
    try:
        return fit(takes, progress, effort=Effort.from_name(effort))
    except FitError as error:
        if not contradictions:
            raise
        first = gravest_first(contradictions)[0]
        raise FitError(first.text, where=error.where, remedy=first.remedy) from error


def lens_of_state(preset: Preset, state: LensState) -> Lens:
    """The lens of a preset at a state that was measured."""
    return preset.at(
        focal_length_mm=state.focal_length_mm,
        focus_distance_mm=state.focus_distance_mm,
    )


def preset_of(shoot: Shoot, observed: list[Observed], fitted: FittedLens) -> Preset:
    """What was fitted to the takes of a shoot, as it is kept."""
    return Preset(
        lens=LensName(shoot.lens.name, shoot.lens.serial),
        camera=camera_of(shoot, observed),
        entries=tuple(
            entry_of(state, fitted.wavefronts.get(state.focal_length_mm))
            for state in fitted.states
        ),
        provenance=provenance_of(shoot, observed),
    )


def _write_maps(preset: Preset, folder: Path, progress: Progress) -> list[str]:
    """Both UV maps of every state, with overscan, relative to the folder."""
    size = preset.camera.image_width_px, preset.camera.image_height_px
    frame = StmapFrame(size, MAP_OVERSCAN_PERCENT)
    names = []
    for entry in preset.entries:
        lens = preset.at(
            focal_length_mm=entry.focal_length_mm,
            focus_distance_mm=entry.focus_distance_mm,
        )
        written = write_stmaps(
            lens,
            frame,
            folder / "stmaps",
            file_stem(preset.lens.name, lens),
            per_channel=lens.has_lateral_colour,
            progress=progress,
        )
        names += [str(path.relative_to(folder)) for path in written.paths]
    return names


def _report(
    shoot: Shoot,
    observed: list[Observed],
    fitted: FittedLens,
    preset: Preset,
    folder: Path,
) -> dict[str, Any]:
    modelled = write_model_pictures(observed, fitted, preset, folder)
    takes = [take_facts(o, fitted, folder) for o in observed]
    for take in takes:
        take["modelled"] = modelled.get(take["image"])
    used = [t for t in takes if not t["failed"]]
    camera = preset.camera
    stems = {o.image: o.overlay.stem for o in observed if o.overlay is not None}
    return {
        "schema": REPORT_SCHEMA,
        "lens": {"name": preset.lens.name, "serial": preset.lens.serial},
        "camera": {name: getattr(camera, name) for name in camera.__struct_fields__},
        "camera_sharpening": _sharpening_facts(observed),
        "created": preset.provenance.created,
        "versions": dict(preset.provenance.versions),
        "rms_px": _pooled_rms(used, "rms_px"),
        "held_out_rms_px": _pooled_rms(used, "held_out_rms_px"),
        "points_detected": sum(t["points_detected"] or 0 for t in takes),
        "points_used": sum(t["points_used"] or 0 for t in takes),
        "notes": _notes(shoot, observed, fitted),
        "terms": [
            term
            for state in fitted.states
            for term in terms_of(state, fitted.wavefronts.get(state.focal_length_mm))
        ],
        "statements": statement_facts(fitted.states),
        "takes": takes,
        "entries": [
            entry_facts(state, lens_of_state(preset, state), preset.camera)
            for state in fitted.states
        ],
        "blur": [
            {"focal_length_mm": focal_mm}
            | blur_facts(wavefront, write_dot_pictures(wavefront, stems, folder))
            for focal_mm, wavefront in fitted.wavefronts.items()
        ],
        "blur_not_measured": [
            {"focal_length_mm": focal_mm, "reason": reason}
            for focal_mm, reason in fitted.unmeasured_blur.items()
        ],
        "comparison": None,
        "files": {
            "preset": "preset.json",
            "report": ["report.html", "report.json"],
        },
    }


def _pooled_rms(takes: list[dict[str, Any]], key: str) -> float:
    """Root mean square over the points of all takes."""
    squares = [t["points_used"] * t[key] ** 2 for t in takes]
    return float(np.sqrt(sum(squares) / max(sum(t["points_used"] for t in takes), 1)))


def _notes(shoot: Shoot, observed: list[Observed], fitted: FittedLens) -> list[str]:
    notes = list(shoot.notes) + list(fitted.notes)
    for state in fitted.states:
        notes += state.geometry.notes
    for wavefront in fitted.wavefronts.values():
        notes += wavefront.notes
    if len({o.orientation for o in observed if o.take is not None}) > 1:
        notes.append(
            "some photographs were turned by their EXIF orientation and others were "
            "not: shoot all of them the same way up"
        )
    notes += _mosaic_notes(observed) + _sharpening_notes(observed)
    return list(dict.fromkeys(notes))


def _mosaic_notes(observed: list[Observed]) -> list[str]:
    """That colours were interpolated, where noise shows it and nobody said so."""
    seen = [o.mosaic_seen for o in observed if o.mosaic_seen]
    if not seen:
        return []
    return [
        f"the noise of {len(seen)} of {len(observed)} photographs shows that colours "
        "were interpolated from a mosaic, which the fit takes for blur of the lens: "
        f'state mosaic = "{max(set(seen), key=seen.count)}" in [camera]'
    ]


def _sharpening_facts(observed: list[Observed]) -> dict[str, Any] | None:
    """Halos as parts of the contrast, and the mask; None where none is seen."""
    sharpening = observed[0].sharpening
    if sharpening is None:
        return None
    dark, bright = sharpening.halos
    mask = sharpening.mask and sharpening.mask._asdict()
    return {"halo_dark": dark, "halo_bright": bright, "unsharp_mask": mask}


def _sharpening_notes(observed: list[Observed]) -> list[str]:
    """What the camera did to edges, and whether it was taken off."""
    sharpening = observed[0].sharpening
    if sharpening is None:
        return []
    if sharpening.mask is None:
        return [
            f"{sharpening.sentence}; no filter explains that, so the blur is that of "
            "lens and camera together: switch sharpening off, or photograph raw"
        ]
    return [
        f"{sharpening.sentence}; an unsharp mask of {sharpening.mask.radius_px:.1f} px "
        "explains it and was taken off, so the blur is the lens'"
    ]


def _others(observed: list[Observed]) -> str | None:
    others = len(observed) - 1
    return f"{others} more photographs failed too" if others else None


def _seconds(observed: list[Observed], fitted: FittedLens) -> dict[str, float]:
    total: dict[str, float] = {}
    parts = [o.seconds for o in observed]
    parts += [state.geometry.seconds for state in fitted.states]
    parts.append(fitted.seconds)
    for part in parts:
        for name, value in part.items():
            total[name] = total.get(name, 0.0) + value
    return total
