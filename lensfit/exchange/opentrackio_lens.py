"""A lens from OpenTrackIO samples, in lensfit's units, and to samples.

Millimetres on the sensor, x right, y down, origin at its centre.
Source: camdkit's lens types and schema (SMPTE RIS), OpenLensIO 1.0.1.
"""

from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
from jaxtyping import Array

from lensfit.atomic import write_text_atomic
from lensfit.coords import Window
from lensfit.errors import ExchangeError
from lensfit.exchange.brown_conrady import D_U, U_D, fit_brown
from lensfit.exchange.export_request import (
    Exported,
    ExportRequest,
    Nearness,
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
    PointFunction,
    Points,
    StatedValues,
    assumed_size_px,
)
from lensfit.exchange.lensfun import (
    fit_even_polynomial,
)
from lensfit.exchange.opentrackio import ColourShift, LensSample, opentrackio_text
from lensfit.exchange.samples import (
    ExchangeFrame,
    residual_of,
)
from lensfit.lens import Lens
from lensfit.optics.lateral import ChannelShift
from lensfit.rendering.overscan import overscan_factor


def lens_of_opentrackio(
    samples: tuple[LensSample, ...], stated: StatedValues, where: str | Path
) -> ForeignLens:
    """The lens of the samples, one state each; what is stated counts for all.

    Raises
    ------
    ExchangeError : The sensor size is not stated.
    """
    first = samples[0]
    sensor = first.sensor_size_mm
    if stated.sensor_width_mm is not None:
        aspect = sensor[1] / sensor[0] if sensor else _aspect(stated, where)
        sensor = (stated.sensor_width_mm, stated.sensor_width_mm * aspect)
    if sensor is None:
        raise ExchangeError(
            "does not state the sensor (activeSensorPhysicalDimensions)",
            where=where,
            remedy="give --sensor-width-mm and --size",
        )
    size = stated.size_px or first.size_px
    notes = []
    if size is None:
        size = assumed_size_px(sensor)
        notes.append(f"the file does not say its pixels; {size[0]} x {size[1]} assumed")
    if any(len(sample.distortions) > 1 for sample in samples):
        notes.append(f"of both directions of distortion, {D_U} is used")
    return ForeignLens(
        "OpenTrackIO",
        first.name,
        sensor,
        size,
        tuple(_state(sample, stated) for sample in samples),
        first.serial,
        first.camera_model,
        tuple(notes),
    )


def _aspect(stated: StatedValues, where: str | Path) -> float:
    if stated.size_px is None:
        raise ExchangeError(
            "does not state the height of the sensor", where=where, remedy="give --size"
        )
    return stated.size_px[1] / stated.size_px[0]


def _state(sample: LensSample, stated: StatedValues) -> ForeignState:
    by_model = {one.model: one for one in sample.distortions}
    focal = stated.focal_length_mm or sample.nominal_focal_length_mm
    fall_off = ()
    if sample.falloff:
        light = partial(_illumination, falloff=sample.falloff)
        fall_off = (ForeignFallOff(stated.f_number or sample.f_number, light),)
    return ForeignState(
        map=by_model.get(D_U, sample.distortions[0]),
        principal_distance_mm=sample.pinhole_focal_length_mm,
        principal_point_mm=sample.projection_offset_mm,
        focal_length_mm=focal or sample.pinhole_focal_length_mm,
        focus_distance_mm=stated.focus_distance_mm or sample.focus_distance_mm,
        entrance_pupil_offset_mm=sample.entrance_pupil_offset_mm,
        channels=_channels(sample.colour, sample.projection_offset_mm),
        fall_off=fall_off,
    )


def _illumination(points_mm: Points, falloff: tuple[float, ...]) -> np.ndarray:
    r2 = np.sum(np.asarray(points_mm, float) ** 2, -1)
    a1, a2, a3 = (*falloff, 0.0, 0.0)[:3]
    return 1 - r2 * (a1 + r2 * (a2 + r2 * a3))


def _channels(
    colour: Mapping[str, ColourShift], centre_mm: tuple[float, float]
) -> dict[str, PointFunction]:
    return {
        channel: partial(_channel_from_green, shift=shift, centre_mm=centre_mm)
        for channel, shift in colour.items()
    }


def _channel_from_green(
    green_mm: Points, shift: ColourShift, centre_mm: tuple[float, float]
) -> Points:
    q = (np.asarray(green_mm, float) - np.array(centre_mm)) / shift.reference_radius_mm
    x, y = q[:, 0], q[:, 1]
    r2 = x * x + y * y
    relative = np.polynomial.polynomial.polyval(r2, [*shift.radial, 0.0])
    s1, s2 = shift.strain
    d1, d2 = shift.decentering
    moved = q * relative[:, None]
    moved[:, 0] += s1 * x + s2 * y + d1 * 2 * x * y + d2 * (r2 + 2 * x * x)
    moved[:, 1] += s2 * x - s1 * y + d1 * (r2 + 2 * y * y) + d2 * 2 * x * y
    return green_mm + np.array(shift.shift_mm) + moved * shift.reference_radius_mm


def export_opentrackio(request: ExportRequest) -> Exported:
    """A sample for each entry, or for the one requested."""
    samples, nearness, lens = [], [], None
    for state in states_of(request):
        one = replace(request, state=state)
        lens = one.lens()
        sample, parts = _fitted_sample(one, lens)
        samples.append(sample)
        nearness += parts
    assert lens is not None
    write_text_atomic(request.out, opentrackio_text(tuple(samples)))
    return export_result(
        request, lens, tuple(nearness), has_colour=True, has_light=True
    )


def _fitted_sample(
    request: ExportRequest, lens: Lens
) -> tuple[LensSample, list[Nearness]]:
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
        falloff, worst = _fitted_fall_off(lens, request.frame)
        nearness.append(Nearness(f"fall-off{where}", worst_light=worst))
    camera = request.preset.camera
    overscan = overscan_factor(
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
        overscan=overscan,
        colour=_colour_shifts(lens),
        history=(lens_description(request, lens),),
    ), nearness


def _colour_shifts(lens: Lens) -> dict[str, ColourShift]:
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


def _fitted_fall_off(
    lens: Lens, frame: ExchangeFrame
) -> tuple[tuple[float, ...], float]:
    points = replace(frame, overscan_percent=0.0).grid_mm(65)
    k, worst = fit_even_polynomial(
        np.linalg.norm(points, axis=-1), mean_light(lens, points)
    )
    return tuple(-v for v in k), worst
