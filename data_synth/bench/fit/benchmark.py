"""Detection and fit on real and on traced photographs, next to OpenCV.

Everything is measured in the same run. A set that falls short is a row that says so,
not an error: a benchmark informs. Nothing but this module's result is written unless
a folder is given.
"""

import statistics
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from data_synth.bench.fit.lens import (
    edge_colour_px,
    lens_of,
    straightness_px,
    truth_errors_px,
)
from data_synth.bench.fit.opencv import opencv_of
from data_synth.bench.floor import Floor, Rates, best_seconds, measured_rates
from data_synth.bench.plot import write_fit_plot
from data_synth.bench.result import Row, as_tables, bench_result, machine
from data_synth.bench.sampler import sampled
from data_synth.bench.sets import (
    LEAST_PART_OF_DETECTIONS,
    MOST_COLOUR_DIFFERENCE_PX,
    MOST_ROUND_TRIP_PX,
    BenchSet,
    chosen_sets,
    shoot_of,
)
from data_synth.bench.start import START_SET, start_rows
from lensfit.errors import DetectionError, LensfitError
from lensfit.fitting.adjust import Adjustment, equations_at
from lensfit.fitting.chief_ray import ChiefRayFit, fit_chief_ray
from lensfit.fitting.lens_state import LensState
from lensfit.fitting.lens_states import FittedLens, fit
from lensfit.lens import Lens
from lensfit.preset.blocks import Camera
from lensfit.programs import forget_programs
from lensfit.progress import Progress, silent
from lensfit.workflow.calibration.entries import camera_of
from lensfit.workflow.calibration.entry_facts import entry_facts
from lensfit.workflow.calibration.fit_facts import errors_of
from lensfit.workflow.calibration.observe import observe_shoot

_RUNS = 3


@dataclass(frozen=True, eq=False)
class Measured:
    """A set after detection and fit.

    Attributes
    ----------
    detect_s : Detection and indexing, all photographs, in seconds.
    first_fit_s, fit_s, spread_s : Geometric fit, the first with tracing and
        compilation; median and spread of a few more.
    profiles : Seconds of detection and of one more fit, by stage.
    floor : One pass over the detections beside its floating-point operations.
    failed : Why photographs could not be used.
    """

    bench_set: BenchSet
    state: LensState
    camera: Camera
    detect_s: float
    first_fit_s: float
    fit_s: float
    spread_s: float
    profiles: dict[str, dict[str, float]]
    floor: Floor
    failed: tuple[str, ...]

    @property
    def geometry(self) -> ChiefRayFit:
        return self.state.geometry


def bench_fit(
    data: str | Path,
    out_dir: str | Path | None = None,
    *,
    only: str | Sequence[str] | None = None,
    progress: Progress = silent,
) -> dict[str, Any]:
    """Measure every set, or one.

    Parameters
    ----------
    data : Folder with ``real`` and ``oracle``.
    out_dir : Folder for bench_fit.json, error_against_time_fit.png, and overlays.
    only : Name of a set, or several.
    progress : Told about each set.

    Returns
    -------
    "rows" with a figure and its bar each, "sets" with counts and times, "profiles"
    (seconds by stage of detection and fit), "floors" (a pass over the detections beside
    its floating-point operations), "machine", and "errors", one line for each
    photograph or set that could not be used.

    Raises
    ------
    LensfitError : There is no set of that name, or the results cannot be written.
    """
    on, rates = machine(), measured_rates()
    rows: list[Row] = []
    sets, errors, profiles, floors = [], [], {}, []
    chosen = chosen_sets(only)
    for done, one in enumerate(chosen):
        progress("sets", done, len(chosen))
        # Every set has programs of its own, and a process may map only so many.
        forget_programs()
        try:
            measured = measure(one, Path(data), _folder(out_dir, one), rates)
        except LensfitError as error:
            errors.append(f"{one.name}: {error}")
            continue
        errors += [f"{one.name}: {reason}" for reason in measured.failed]
        rows += rows_of(measured, Path(data))
        sets.append(counts_of(measured))
        profiles |= {f"{one.name}, {k}": v for k, v in measured.profiles.items()}
        floors.append(measured.floor.as_table() | {"set": one.name})
        if one.name == START_SET:
            rows += start_rows("fit", data)
    progress("sets", len(chosen), len(chosen))
    where = {"profiles": profiles, "floors": floors, "rates": rates._asdict()}
    found = {"rows": as_tables(rows), "sets": sets, "errors": errors} | where
    if out_dir is not None:
        write_fit_plot(found["rows"], Path(out_dir))
    return bench_result("fit", on, out_dir, **found)


def measure(
    bench_set: BenchSet, data: Path, folder: Path | None, rates: Rates
) -> Measured:
    """Detect and fit one set, the geometric fit twice.

    Raises
    ------
    LensfitError : The photographs are missing, or none of them can be used.
    """
    shoot = shoot_of(bench_set, data)
    looked = sampled(lambda: observe_shoot(shoot, folder, silent))
    observed = looked.result
    # Sets without a truth are judged by their points: blur is `bench blur`'s.
    takes = [
        o.take if bench_set.traced else replace(o.take, dot_images=None)
        for o in observed
        if o.take is not None
    ]
    failed = tuple(o.failed for o in observed if o.failed)
    if not takes:
        raise DetectionError(failed[0] if failed else "no photograph could be used")
    fitted = fit(takes)
    state = _state_of(fitted)
    group = list(state.geometry.takes)
    again = [fit_chief_ray(group, all_views=takes) for _ in range(_RUNS - 1)]
    last = sampled(lambda: fit_chief_ray(group, all_views=takes))
    seconds = [_geometric_seconds(one) for one in (*again, last.result)]
    return Measured(
        bench_set=bench_set,
        state=state,
        camera=camera_of(shoot, observed),
        detect_s=sum(o.seconds["detect"] for o in observed),
        first_fit_s=_geometric_seconds(state.geometry),
        fit_s=statistics.median(seconds),
        spread_s=max(seconds) - min(seconds),
        profiles={"detection": looked.seconds, "geometric fit": last.seconds},
        floor=pass_floor(state.geometry.adjustment, rates),
        failed=failed + tuple(str(e) for e in fitted.failed.values()),
    )


def rows_of(measured: Measured, data: Path) -> list[Row]:
    """Every figure of a set that has a bar."""
    one, geometry = measured.bench_set, measured.geometry
    lens = lens_of(measured.state, measured.camera)
    rows = []
    if one.traced:
        truth = truth_errors_px(lens, data / "oracle" / one.name)
        rows.append(Row(one.name, "chief ray against truth, px", truth["chief"], 0.05))
        for pair in ("r-g", "b-g"):
            what = f"lateral colour {pair} against truth, px"
            rows.append(Row(one.name, what, truth[pair], 0.03))
    elif one.detections is None:
        rows.append(_straightness(measured))
    else:
        rows += _against_opencv(measured)
    if one.detect_bar_s is not None:
        what = "detection and indexing, s"
        rows.append(Row(one.name, what, measured.detect_s, one.detect_bar_s))
    if one.colour_px is not None:
        found = edge_colour_px(geometry, lens, measured.camera)
        for channel, expected in zip(("r", "b"), one.colour_px, strict=True):
            rows.append(_edge_colour(one.name, channel, expected, found[channel]))
    return [*rows, _round_trip(measured, lens)]


def counts_of(measured: Measured) -> dict[str, Any]:
    """Counts and times, which have no bar of their own."""
    geometry, state = measured.geometry, measured.state
    detections = [t.observations for t in geometry.takes]
    centre = np.asarray(state.distortion.principal_point_mm)
    return {
        "set": measured.bench_set.name,
        "photographs": len(geometry.takes),
        "candidates": sum(m.candidates for m in detections),
        "indexed": sum(len(m) for m in detections),
        "used": int(geometry.adjustment.used.sum()),
        "rms_px": errors_of(geometry)[0],
        "held_out_rms_px": geometry.held_out_rms_px,
        "detect_s": measured.detect_s,
        "first_fit_s": measured.first_fit_s,
        "fit_s": measured.fit_s,
        "spread_s": measured.spread_s,
        "principal_distance_mm": float(state.distortion.principal_distance_mm),
        "principal_point_mm": centre.tolist(),
        "terms": list(geometry.kept),
    }


def _against_opencv(measured: Measured) -> list[Row]:
    one, geometry = measured.bench_set, measured.geometry
    five, fourteen = opencv_of(geometry, 5), opencv_of(geometry, 14)
    held_out = Row(
        one.name,
        "held-out reprojection, px rms",
        geometry.held_out_rms_px,
        one.bar_px,
        one.aim_px,
        {"OpenCV 5": five.held_out_rms_px, "OpenCV 14": fourteen.held_out_rms_px},
    )
    used = float(geometry.adjustment.used.sum())
    least = float(np.ceil(LEAST_PART_OF_DETECTIONS * (one.detections or 0)))
    points = Row(one.name, "points used", used, least, one.detections, least=True)
    seconds = Row(
        one.name,
        "geometric fit, s",
        measured.fit_s,
        fourteen.seconds,
        peers={
            "OpenCV 5": five.seconds,
            "OpenCV 14": fourteen.seconds,
            "first": measured.first_fit_s,
            "spread": measured.spread_s,
        },
    )
    return [held_out, points, seconds]


def _straightness(measured: Measured) -> Row:
    one = measured.bench_set
    value = straightness_px(measured.geometry)
    what = "straightness of lines, px rms"
    return Row(one.name, what, value, one.bar_px, one.aim_px)


def _edge_colour(
    name: str, channel: str, expected: float, found: tuple[float, float]
) -> Row:
    return Row(
        name,
        f"lateral colour {channel}-g at the edge, px",
        found[0],
        MOST_COLOUR_DIFFERENCE_PX,
        peers={"the detections": found[1], "other code": expected},
        expected=expected,
    )


def _round_trip(measured: Measured, lens: Lens) -> Row:
    """Undefined, and so short of the bar, for a map that folds or is off the frame."""
    facts = entry_facts(measured.state, lens, measured.camera)
    camera = measured.camera
    half = np.array([camera.sensor_width_mm, camera.sensor_height_mm])
    inside = bool(np.all(np.abs(facts["principal_point_mm"]) < half / 2))
    value = facts["round_trip_max_px"] if facts["monotone"] and inside else np.nan
    what = "undistort, redistort: frame + 15 %, px"
    return Row(measured.bench_set.name, what, float(value), MOST_ROUND_TRIP_PX)


def _geometric_seconds(geometry: ChiefRayFit) -> float:
    return geometry.seconds["fit_compact"] + geometry.seconds["fit_select"]


def _state_of(fitted: FittedLens) -> LensState:
    """The state with most photographs; the sets of this bench have one."""
    return max(fitted.states, key=lambda state: len(state.geometry.takes))


def _folder(out_dir: str | Path | None, bench_set: BenchSet) -> Path | None:
    return None if out_dir is None else Path(out_dir) / bench_set.name


def pass_flops(detections: int, shared: int, local: int) -> float:
    """Operations of J^T J of so many detections, two rows each.

    A row of residuals takes 2 k^2 + 2 l (k + l) over k shared parameters and l of its
    photograph's.
    """
    return 2.0 * detections * (2 * shared**2 + 2 * local * (shared + local))


def pass_floor(adjustment: Adjustment, rates: Rates) -> Floor:
    """One pass of the geometric fit over its points, measured now, programs compiled.

    Beside the operations it cannot avoid: those of derivatives, of the board and of the
    lens are not counted, so the ratio says what all of that costs.
    """
    layout = adjustment.layout
    detections = int(adjustment.stack.present.sum())
    seconds = best_seconds(lambda: equations_at(adjustment).matrix.block_until_ready())
    flops = pass_flops(detections, layout.shared, layout.local)
    return Floor("one pass over the detections", flops, "flops", rates.flops, seconds)
