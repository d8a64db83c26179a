"""One state of another program's lens: its map over the frame, and lensfit's terms."""

from typing import NamedTuple

import msgspec
import numpy as np

from lensfit.errors import ExchangeError
from lensfit.exchange.foreign import ForeignLens, ForeignState
from lensfit.exchange.preset_map import (
    MapAlignedOnAxis,
    fit_channel_shift,
    fit_distortion,
    fit_fall_off,
    map_aligned_on_axis,
    residual_without_fit,
)
from lensfit.exchange.samples import (
    JUDGE_COUNT,
    ExchangeFrame,
    LensMap,
    Residual,
    Samples,
    residual_from,
)
from lensfit.optics.distortion import Distortion
from lensfit.preset import blocks
from lensfit.preset.blocks import Camera
from lensfit.preset.entry import Entry, Quality, Term
from lensfit.preset.lens_of_entry import distortion_block, lens_of_entry

_INSIDE_PERCENT = -2.0
"""A UV map may end with the last pixel centre that it can look up."""


class StateFit(NamedTuple):
    """How near one entry is to the file."""

    state: str
    distortion: Residual
    colour: Residual | None
    worst_light: float | None


class SampledState(NamedTuple):
    """A state over the frame, and its overscan where the file knows that."""

    state: ForeignState
    axis: MapAlignedOnAxis
    frame: ExchangeFrame
    fit: Samples
    judge: Samples

    @classmethod
    def of(cls, state: ForeignState, frame: ExchangeFrame) -> "SampledState":
        """With as much of the frame's overscan as the state's map reaches.

        Raises
        ------
        ExchangeError : It does not even reach all of the frame.
        """
        axis = map_aligned_on_axis(state.map, state.principal_point_mm, frame.radius_mm)
        failure = None
        for overscan in (frame.overscan_percent, 0.0, _INSIDE_PERCENT):
            own = ExchangeFrame(frame.size_px, frame.sensor_width_mm, overscan)
            try:
                pair = Samples.of(axis, own), Samples.of(axis, own, JUDGE_COUNT)
                return cls(state, axis, own, *pair)
            except ExchangeError as error:
                failure = error
        assert failure is not None
        raise failure

    @property
    def principal_distance_mm(self) -> float:
        """Of lensfit's undistorted picture."""
        return self.state.principal_distance_mm / self.axis.magnification

    def without_distortion(self) -> Residual:
        """How far a lens that has but the squeeze on the axis is off."""
        point = self.axis.principal_point_mm
        return residual_without_fit(self.judge, self.principal_distance_mm, point)


def entry_of_state(
    seen: SampledState, lens: ForeignLens, camera: Camera, box: np.ndarray
) -> tuple[Entry, StateFit]:
    """lensfit's terms fitted to a state, and how near they are to it.

    Parameters
    ----------
    camera : Of the preset.
    box : Around the samples of all states (`box_of`).
    """
    state, axis, frame, fit, judge = seen
    distance = seen.principal_distance_mm
    found = fit_distortion(fit, distance, axis.principal_point_mm, box)
    pupil = state.entrance_pupil_offset_mm
    assumed = list(state.assumed)
    if pupil is None:
        assumed.append("entrance_pupil_offset_mm")
    colour, colour_off = _colour(state, found, judge)
    lights = [
        fit_fall_off(f.illumination, f.f_number, axis.principal_point_mm, frame)
        for f in state.fall_off
    ]
    entry = Entry(
        focal_length_mm=state.focal_length_mm,
        focus_distance_mm=state.focus_distance_mm,
        projection=blocks.Projection(
            distance,
            axis.principal_point_mm,
            distance if pupil is None else pupil,
            assumed=tuple(assumed),
        ),
        distortion=distortion_block(found),
        lateral_colour=colour,
        fall_off=tuple(light for light, _ in lights),
        terms=(_term(lens),),
        covariance=None,
        quality=_quality(0.0),
    )
    made = LensMap(lens_of_entry(entry, camera))
    off = np.linalg.norm(
        made.distorted(judge.undistorted_mm) - judge.distorted_mm, axis=-1
    )
    residual = residual_from(off / frame.pitch_mm)
    entry = msgspec.structs.replace(entry, quality=_quality(residual.rms_px))
    worst_light = max((worst for _, worst in lights), default=None)
    fitted = StateFit(str(entry), residual, colour_off, worst_light)
    return entry, fitted


def _colour(
    state: ForeignState, found: Distortion, judge: Samples
) -> tuple[blocks.LateralColour | None, Residual | None]:
    """Red and blue over the points where green lands, as far as they are known."""
    if not state.channels:
        return None, None
    shifts, worst = {}, Residual(0.0, 0.0)
    for channel in ("r", "b"):
        landed = state.channels[channel](judge.distorted_mm)
        known = np.isfinite(landed).all(-1)
        shifts[channel], residual = fit_channel_shift(
            judge.distorted_mm[known], landed[known], found, judge.frame
        )
        worst = max(worst, residual, key=lambda r: r.worst_px)
    return blocks.LateralColour(shifts["r"], shifts["b"]), worst


def _term(lens: ForeignLens) -> Term:
    return Term(
        name="distortion",
        kept=True,
        value=None,
        standard_deviation=None,
        unit="",
        reason=f"imported from {lens.source}, not measured here",
    )


def _quality(rms_px: float) -> Quality:
    """Of a lens that no photograph was fitted to: nothing held out, no points."""
    return Quality(rms_px, None, 0, 0, 0)
