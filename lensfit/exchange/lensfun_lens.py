"""The lens that a lensfun database describes: a state for every focal length."""

from functools import partial
from pathlib import Path

from lensfit.errors import ExchangeError
from lensfit.exchange.foreign import (
    ForeignFallOff,
    ForeignLens,
    ForeignState,
    StatedValues,
)
from lensfit.exchange.lensfun import (
    FULL_FRAME_DIAGONAL_MM,
    LensfunMap,
    centre_magnification,
    sensor_of_crop,
    tca_channel,
    vignetting,
)
from lensfit.exchange.lensfun_xml import (
    LensfunDatabase,
    LensfunDistortion,
    LensfunLens,
)

_DEFAULT_WIDTH_PX = 4096
_FAR_M = 1000.0
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
    size = stated.size_px or (
        _DEFAULT_WIDTH_PX,
        max(1, round(_DEFAULT_WIDTH_PX * sensor[1] / sensor[0])),
    )
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
