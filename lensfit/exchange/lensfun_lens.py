"""A lens from a lensfun database, and to one: a state for every focal length."""

import math
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from lensfit.atomic import write_text_atomic
from lensfit.batches import in_batches
from lensfit.errors import ExchangeError
from lensfit.exchange.export_request import (
    Exported,
    ExportRequest,
    Nearness,
    WantedState,
    export_result,
    lens_description,
    mean_light,
    principal_point,
    samples_pair,
    state_name,
    states_of,
)
from lensfit.exchange.foreign import (
    ForeignFallOff,
    ForeignLens,
    ForeignState,
    StatedValues,
    assumed_size_px,
)
from lensfit.exchange.lensfun import (
    FULL_FRAME_DIAGONAL_MM,
    LensfunMap,
    centre_magnification,
    fit_even_polynomial,
    fit_lensfun,
    fit_tca,
    sensor_of_crop,
    tca_channel,
    vignetting,
)
from lensfit.exchange.lensfun_xml import (
    LensfunDatabase,
    LensfunDistortion,
    LensfunLens,
    LensfunTca,
    LensfunVignetting,
    lensfun_text,
)
from lensfit.exchange.samples import (
    Samples,
    residual_from,
    residual_of,
)
from lensfit.lens import Lens
from lensfit.preset.entry import Entry
from lensfit.printable import printable
from lensfit.units import m_from_mm

_FAR_M = 1000.0
"""What lensfun's own files write for infinity."""
_SHOWN = 8


def lens_of_lensfun(
    database: LensfunDatabase,
    stated: StatedValues,
    where: str | Path,
    camera: str | None = None,
) -> ForeignLens:
    """One lens of a database.

    Parameters
    ----------
    stated : `lens` is part of its name, `focal_length_mm` takes one focal length of a
        zoom, `focus_distance_mm` chooses among the vignettings; the sensor is that of
        `sensor_width_mm`, of `camera`, or else the one the lens was calibrated on.
    camera : Part of the name of a camera in the file.

    Raises
    ------
    ExchangeError : No lens or camera of that name, or several; or a projection or
        focal length that is not there.
    """
    lens = _chosen({k.name: k for k in database.lenses}, stated.lens, "lens", where)
    if lens.projection != "rectilinear":
        raise ExchangeError(
            f"{lens.name} is a {lens.projection[:40]} lens, and only rectilinear ones "
            "are read",
            where=where,
            remedy="hand over its UV map",
        )
    crop = lens.crop_factor
    if camera is not None:
        crop = _chosen(dict(database.cameras), camera, "camera", where)
    sensor = sensor_of_crop(crop, lens.aspect_ratio)
    if stated.sensor_width_mm is not None:
        sensor = (stated.sensor_width_mm, stated.sensor_width_mm / lens.aspect_ratio)
    size = stated.size_px or assumed_size_px(sensor)
    if stated.size_px is not None:
        sensor = (sensor[0], sensor[0] * size[1] / size[0])
    states = tuple(_state(d, lens, stated) for d in _distortions(lens, stated, where))
    notes = () if stated.size_px else (
        f"lensfun knows no pixels: {size[0]} x {size[1]} assumed (--size)",
    )  # fmt: skip
    return ForeignLens("lensfun", lens.name, sensor, size, states, notes=notes)


def _chosen(named: dict, wanted: str | None, what: str, where: str | Path):
    """The only one whose name holds `wanted`, or is it."""
    word = (wanted or "").casefold()
    found = [name for name in named if word in name.casefold()]
    exact = [name for name in found if name.casefold() == word]
    if len(exact) == 1:
        found = exact
    if len(found) == 1:
        return named[found[0]]
    shown = ", ".join((found or list(named))[:_SHOWN]) or "none"
    more = " ..." if len(found or named) > _SHOWN else ""
    said = (
        f"holds no {what} {wanted!r}" if not found else f"holds several: {shown}{more}"
    )
    raise ExchangeError(
        said,
        where=where,
        remedy=f"name one with --{what}"
        + ("" if found else f", such as {shown}{more}"),
    )


def _distortions(
    lens: LensfunLens, stated: StatedValues, where: str | Path
) -> tuple[LensfunDistortion, ...]:
    """One for each focal length, the first where it stands twice."""
    found = {d.focal_mm: d for d in reversed(lens.distortions)}
    if not found:
        raise ExchangeError(f"{lens.name} has no distortion", where=where)
    if stated.focal_length_mm is None:
        return tuple(found[focal] for focal in sorted(found))
    nearest = min(found, key=lambda focal: abs(focal - (stated.focal_length_mm or 0)))
    if abs(nearest - stated.focal_length_mm) > 0.05 * nearest:
        known = ", ".join(f"{focal:g}" for focal in sorted(found)[:20])
        raise ExchangeError(
            f"{lens.name} has no distortion at {stated.focal_length_mm:g} mm",
            where=where,
            remedy=f"it has {known} mm",
        )
    return (found[nearest],)


def _state(
    distortion: LensfunDistortion, lens: LensfunLens, stated: StatedValues
) -> ForeignState:
    half_short = sensor_of_crop(lens.crop_factor, lens.aspect_ratio)[1] / 2
    centre = (lens.centre[0] * half_short, lens.centre[1] * half_short)
    real = distortion.real_focal_mm or distortion.focal_mm * abs(
        centre_magnification(distortion.model, distortion.terms)
    )
    tca = next((t for t in lens.tcas if t.focal_mm == distortion.focal_mm), None)
    channels = {} if tca is None else {
        name: partial(
            tca_channel, terms=terms, half_short_mm=half_short, centre_mm=centre
        )
        for name, terms in (("r", tca.r), ("b", tca.b))
    }  # fmt: skip
    return ForeignState(
        map=LensfunMap(distortion.model, distortion.terms, half_short, centre),
        principal_distance_mm=real,
        principal_point_mm=centre,
        focal_length_mm=distortion.focal_mm,
        focus_distance_mm=stated.focus_distance_mm,
        channels=channels,
        fall_off=_fall_off(distortion.focal_mm, lens, stated, centre),
        assumed=() if distortion.real_focal_mm else ("principal_distance_mm",),
    )


def _fall_off(
    focal_mm: float,
    lens: LensfunLens,
    stated: StatedValues,
    centre: tuple[float, float],
) -> tuple[ForeignFallOff, ...]:
    """One for each f-number, at the stated focus distance or else the farthest."""
    wanted = min((stated.focus_distance_mm or 1e9) / 1000, _FAR_M)
    half_diagonal = FULL_FRAME_DIAGONAL_MM / lens.crop_factor / 2
    by_stop = {}
    for one in lens.vignettings:
        if one.focal_mm == focal_mm:
            by_stop.setdefault(one.f_number, []).append(one)
    found = []
    for f_number, some in sorted(by_stop.items()):
        one = min(some, key=lambda v: abs(1 / v.distance_m - 1 / wanted))
        light = partial(
            vignetting,
            terms=one.terms,
            half_diagonal_mm=half_diagonal,
            centre_mm=centre,
        )
        found.append(ForeignFallOff(f_number, light))
    return tuple(found)


def export_lensfun(request: ExportRequest) -> Exported:
    """A database with this lens; distortion is that at the farthest focus."""
    by_focal: dict[float, list[WantedState]] = {}
    for state in states_of(request):
        focal = request.preset.at(*state).focal_length_mm
        by_focal.setdefault(focal, []).append(state)
    frame = request.frame
    width, height = frame.area_mm
    distortions, tcas, vignettings, nearness, lens = [], [], [], [], None
    for states in by_focal.values():
        one = replace(request, state=max(states, key=_focus))
        lens = one.lens()
        distortion, tca, parts = _fitted_maps(one, lens)
        distortions.append(distortion)
        tcas += tca
        nearness += parts
        for state in states:
            found, parts = _fitted_vignettings(replace(request, state=state))
            vignettings += found
            nearness += parts
    assert lens is not None
    x, y = principal_point(lens)
    half_short = min(width, height) / 2
    made = LensfunLens(
        maker="lensfit",
        model=printable(" ".join(request.preset.lens.name.split())),
        crop_factor=FULL_FRAME_DIAGONAL_MM / math.hypot(width, height),
        aspect_ratio=max(width, height) / min(width, height),
        distortions=tuple(distortions),
        tcas=tuple(tcas),
        vignettings=tuple(vignettings),
        centre=(x / half_short, y / half_short),
    )
    comments = (
        lens_description(request, lens),
        *(str(f) for f in nearness),
        f"over {frame}",
    )
    write_text_atomic(request.out, lensfun_text(made, comments))
    result = export_result(
        request, lens, tuple(nearness), has_colour=True, has_light=bool(vignettings)
    )
    notes = _export_notes(request, by_focal, distortions)
    return Exported(result.paths, result.nearness, (*result.notes, *notes))


def _export_notes(
    request: ExportRequest,
    by_focal: dict[float, list[WantedState]],
    distortions: list[LensfunDistortion],
) -> list[str]:
    notes = ["lensfun's file states no principal distance: version 0.3 would refuse it"]
    if any(d.model == "ptlens" for d in distortions):
        notes.append(
            "versions of lensfun read ptlens differently: 0.3 leaves the corrected "
            "picture magnified by 1 - a - b - c"
        )
    if any(len(states) > 1 for states in by_focal.values()):
        notes.append(
            "lensfun knows no focus distance: distortion and lateral colour are those "
            "at the farthest"
        )
    points = {e.projection.principal_point_mm for e in request.preset.entries}
    if len(by_focal) > 1 and len(points) > 1:
        notes.append(
            "lensfun has one centre for all focal lengths: the longest's is written"
        )
    return notes


def _focus(state: WantedState) -> float:
    return state.focus_distance_mm or 0.0


def _fitted_maps(
    request: ExportRequest, lens: Lens
) -> tuple[LensfunDistortion, list[LensfunTca], list[Nearness]]:
    fit, judge = samples_pair(lens, request.frame)
    centre = principal_point(lens)
    model = fit_lensfun(fit, centre)
    where = (
        f" at {lens.focal_length_mm:g} mm" if len(request.preset.entries) > 1 else ""
    )
    nearness = [Nearness(f"distortion {model.model}{where}", residual_of(model, judge))]
    # No real focal length: version 0.3 of the library refuses a file that states one.
    distortion = LensfunDistortion(lens.focal_length_mm, model.model, model.terms)
    if not lens.has_lateral_colour:
        return distortion, [], nearness
    terms = {}
    for channel in ("r", "b"):
        terms[channel], residual = _fitted_tca(
            lens, judge, channel, model.half_short_mm
        )
        nearness.append(Nearness(f"lateral colour of {channel}{where}", residual))
    tca = LensfunTca(lens.focal_length_mm, terms["r"], terms["b"])
    return distortion, [tca], nearness


def _fitted_tca(lens: Lens, judge: Samples, channel, half_short_mm: float):
    """v, c, b and how near they are; green lands on the samples' distorted points."""

    def one(points):
        return lens.distorted_from_undistorted(points, channel)

    landed = in_batches(one, judge.undistorted_mm)
    centre = principal_point(lens)
    terms = fit_tca(judge.distorted_mm, landed, half_short_mm, centre)
    made = tca_channel(judge.distorted_mm, terms, half_short_mm, centre)
    off = np.linalg.norm(made - landed, axis=-1) / judge.frame.pitch_mm
    return terms, residual_from(off)


def _fitted_vignettings(
    request: ExportRequest,
) -> tuple[list[LensfunVignetting], list[Nearness]]:
    """Of every f-number measured at this state, or of the one requested."""
    entry = request.preset.select(*request.state).entry
    stops = [request.state.f_number]
    if stops == [None]:
        every = _entry_at(request, entry)
        stops = [f.f_number for f in every.fall_off if f.f_number is not None]
    found, nearness = [], []
    frame = replace(request.frame, overscan_percent=0.0)
    for f_number in stops:
        state = request.state._replace(f_number=f_number)
        lens = request.preset.at(*state)
        if lens.illumination is None or lens.f_number is None:
            continue
        points = frame.grid_mm(65)
        about = np.linalg.norm(points - np.array(principal_point(lens)), axis=-1)
        terms, worst = fit_even_polynomial(
            about / frame.radius_mm, mean_light(lens, points)
        )
        distance = m_from_mm(lens.focus_distance_mm or math.inf)
        found.append(
            LensfunVignetting(
                lens.focal_length_mm, lens.f_number, min(distance, _FAR_M), terms
            )
        )
        name = f"fall-off f/{lens.f_number:g} at {state_name(lens)}"
        nearness.append(Nearness(name, worst_light=worst))
    return found, nearness


def _entry_at(request: ExportRequest, chosen: Entry) -> Entry:
    """The preset's own entry nearest to a selected one, with all its fall-offs."""

    def apart(entry: Entry) -> tuple[float, float]:
        focus, wanted = entry.focus_distance_mm, chosen.focus_distance_mm
        off = 0.0 if focus is None or wanted is None else abs(1 / focus - 1 / wanted)
        return abs(entry.focal_length_mm - chosen.focal_length_mm), off

    return min(request.preset.entries, key=apart)
