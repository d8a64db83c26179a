"""OpenTrackIO and lensfun as written: files that hold a table of lens states."""

import math
from dataclasses import replace

import numpy as np
from jaxtyping import Array

from lensfit.atomic import write_text_atomic
from lensfit.batches import in_batches
from lensfit.coords import Window
from lensfit.exchange.brown_conrady import D_U, U_D, fit_brown
from lensfit.exchange.export_request import (
    Exported,
    ExportRequest,
    Nearness,
    WantedState,
    export_result,
    lens_description,
    principal_point,
    samples_pair,
    state_name,
    states_of,
)
from lensfit.exchange.lensfun import (
    FULL_FRAME_DIAGONAL_MM,
    fit_even_polynomial,
    fit_lensfun,
    fit_tca,
    tca_channel,
)
from lensfit.exchange.lensfun_xml import (
    LensfunDistortion,
    LensfunLens,
    LensfunTca,
    LensfunVignetting,
    lensfun_text,
)
from lensfit.exchange.opentrackio import opentrackio_text
from lensfit.exchange.opentrackio_lens import ColourShift, LensSample
from lensfit.exchange.samples import (
    ExchangeFrame,
    Samples,
    residual_from,
    residual_of,
)
from lensfit.lens import Lens
from lensfit.optics.lateral import ChannelShift
from lensfit.preset.entry import Entry
from lensfit.printable import printable
from lensfit.rendering.uv import overscan_needed
from lensfit.units import m_from_mm

_FAR_M = 1000.0
"""What lensfun's own files write for infinity."""


def export_opentrackio(request: ExportRequest) -> Exported:
    """A sample for each entry, or for the one requested."""
    samples, nearness, lens = [], [], None
    for state in states_of(request):
        one = replace(request, state=state)
        lens = one.lens()
        sample, parts = _sample(one, lens)
        samples.append(sample)
        nearness += parts
    assert lens is not None
    write_text_atomic(request.out, opentrackio_text(tuple(samples)))
    return export_result(
        request, lens, tuple(nearness), has_colour=True, has_light=True
    )


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
        distortion, tca, parts = _lensfun_maps(one, lens)
        distortions.append(distortion)
        tcas += tca
        nearness += parts
        for state in states:
            found, parts = _lensfun_light(replace(request, state=state))
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
    notes = _lensfun_notes(request, by_focal, distortions)
    return Exported(result.paths, result.nearness, (*result.notes, *notes))


def _lensfun_notes(
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


def _sample(request: ExportRequest, lens: Lens) -> tuple[LensSample, list[Nearness]]:
    fit, judge = samples_pair(lens, request.frame)
    centre = principal_point(lens)
    both = tuple(fit_brown(model, fit, centre) for model in (D_U, U_D))
    where = f" at {state_name(lens)}" if len(request.preset.entries) > 1 else ""
    nearness = [
        Nearness(f"distortion {one.model[-3:]}{where}", residual_of(one, judge))
        for one in both
    ]
    falloff = ()
    if lens.illumination is not None:
        falloff, worst = _about_sensor_centre(lens, request.frame)
        nearness.append(Nearness(f"fall-off{where}", worst_light=worst))
    camera = request.preset.camera
    needed = overscan_needed(
        lens,
        Window.of_size(*request.frame.size_px),
        sensor_width_mm=request.frame.sensor_width_mm,
    )
    focals = {e.focal_length_mm for e in request.preset.entries}
    return LensSample(
        name=request.preset.lens.name,
        serial=request.preset.lens.serial,
        camera_model=camera.model,
        sensor_size_mm=request.frame.area_mm,
        size_px=request.frame.size_px,
        distortions=both,
        projection_offset_mm=centre,
        pinhole_focal_length_mm=float(lens.distortion.principal_distance_mm),
        nominal_focal_length_mm=lens.focal_length_mm,
        is_prime=len(focals) == 1,
        focus_distance_mm=lens.focus_distance_mm,
        f_number=lens.f_number,
        entrance_pupil_offset_mm=float(lens.entrance_pupil_offset_mm),
        falloff=falloff,
        overscan=max(1.0, needed.factor),
        colour=_colour(lens),
        history=(lens_description(request, lens),),
    ), nearness


def _colour(lens: Lens) -> dict[str, ColourShift]:
    if lens.lateral_colour is None:
        return {}
    radius = float(lens.distortion.reference_radius_mm)

    def pair(values: Array) -> tuple[float, float]:
        x, y = np.asarray(values).tolist()
        return x, y

    def shift(one: ChannelShift) -> ColourShift:
        return ColourShift(
            radius,
            float(one.valid_radius),
            pair(one.shift_mm),
            pair(one.strain),
            pair(one.decentering),
            tuple(np.asarray(one.radial).tolist()),
        )

    red, blue = lens.lateral_colour
    return {"r": shift(red), "b": shift(blue)}


def _light(lens: Lens, points_mm: np.ndarray) -> np.ndarray:
    """Mean of the channels."""
    each = [
        in_batches(lambda p, c=c: lens.relative_illumination(p, c), points_mm)
        for c in ("r", "g", "b")
    ]
    return np.mean(each, axis=0)


def _about_sensor_centre(
    lens: Lens, frame: ExchangeFrame
) -> tuple[tuple[float, ...], float]:
    points = replace(frame, overscan_percent=0.0).grid_mm(65)
    k, worst = fit_even_polynomial(
        np.linalg.norm(points, axis=-1), _light(lens, points)
    )
    return tuple(-v for v in k), worst


def _lensfun_maps(
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
        terms[channel], residual = _tca(lens, judge, channel, model.half_short_mm)
        nearness.append(Nearness(f"lateral colour of {channel}{where}", residual))
    tca = LensfunTca(lens.focal_length_mm, terms["r"], terms["b"])
    return distortion, [tca], nearness


def _tca(lens: Lens, judge: Samples, channel, half_short_mm: float):
    """v, c, b and how near they are; green lands on the samples' distorted points."""

    def one(points):
        return lens.distorted_from_undistorted(points, channel)

    landed = in_batches(one, judge.undistorted_mm)
    centre = principal_point(lens)
    terms = fit_tca(judge.distorted_mm, landed, half_short_mm, centre)
    made = tca_channel(judge.distorted_mm, terms, half_short_mm, centre)
    off = np.linalg.norm(made - landed, axis=-1) / judge.frame.pitch_mm
    return terms, residual_from(off)


def _lensfun_light(
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
            about / frame.radius_mm, _light(lens, points)
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
