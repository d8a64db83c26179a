"""Convert fitted states to preset entries, with camera and provenance.

The blur block's covariance comes from that of the fit. The fit's parameters and the
block's numbers are not the same: a focus offset is a mean of defocus values minus the
defocus of the focus scale, the exit pupil stands in two places. So the covariance is
propagated by finite differences: every independent error of the parameters is applied
at a small size, and the change of the block's numbers is the error of the block.
"""

import hashlib
from collections.abc import Callable
from dataclasses import replace
from datetime import UTC, datetime
from importlib import import_module
from typing import Any

import msgspec
import numpy as np

from lensfit.fitting.colour.lateral_colour import ChannelColour
from lensfit.fitting.fall_off.illumination import FallOffFit
from lensfit.fitting.lens_state import LensState
from lensfit.fitting.wavefront.dot_data import widen_beam
from lensfit.fitting.wavefront.fit import WavefrontFit
from lensfit.fitting.wavefront.stages import stage_with_beam
from lensfit.fitting.wavefront.uncertainty import parameter_moves
from lensfit.preset import blocks
from lensfit.preset.blocks import (
    Blur,
    BlurUncertainty,
    Camera,
    Covariance,
    fall_off_names,
    lateral_names,
)
from lensfit.preset.blur_of_block import numbers_of
from lensfit.preset.entry import Entry, Quality, Term
from lensfit.preset.lens_of_entry import distortion_block
from lensfit.preset.predicted_fall_off import with_predicted_fall_off
from lensfit.preset.schema import Preset, Provenance, SourceImage
from lensfit.workflow.calibration.blur_entries import blur_of
from lensfit.workflow.calibration.fit_facts import errors_of, terms_of
from lensfit.workflow.calibration.observe import Observed
from lensfit.workflow.shoot.shoot_records import Shoot

_STEP = 0.05
_DIGITS = 5


def known_blur_of(state: LensState, wavefront: WavefrontFit) -> Blur:
    """`blur_of`, with its uncertainty."""
    blur = blur_of(state, wavefront)
    moves = parameter_moves(wavefront.stage, wavefront.total_covariance)
    changes = [_change(move, state, wavefront) for move in moves]
    changes.append(_change_by_beam(state, wavefront))
    names = [n for n in numbers_of(blur) if any(c.get(n) for c in changes)]
    known = BlurUncertainty(
        tuple(names),
        tuple(tuple(_short(change[n]) for n in names) for change in changes),
    )
    return msgspec.structs.replace(blur, uncertainty=known)


def _change(
    move: np.ndarray, state: LensState, wavefront: WavefrontFit
) -> dict[str, float]:
    """What a move of the parameters changes in the block, to first order."""

    def moved(share: float) -> WavefrontFit:
        stage = wavefront.stage
        stage = replace(stage, parameters=stage.parameters + share * move)
        return replace(wavefront, stage=stage)

    return _slopes(state, moved)


def _change_by_beam(state: LensState, wavefront: WavefrontFit) -> dict[str, float]:
    """What a beam wider by its standard deviation changes in the block: nothing in
    dots, but the blur of objects at other distances."""
    beam = wavefront.dot_data.beam

    def moved(share: float) -> WavefrontFit:
        wider = beam._replace(ratio=beam.ratio * (1 + share * beam.deviation))
        return replace(
            wavefront,
            dot_data=widen_beam(wavefront.dot_data, wider),
            stage=stage_with_beam(wavefront.stage, wider),
        )

    return _slopes(state, moved)


def _slopes(
    state: LensState, moved: Callable[[float], WavefrontFit]
) -> dict[str, float]:
    """Of the block's numbers, by the share of a move."""
    forth, back = (numbers_of(blur_of(state, moved(s))) for s in (_STEP, -_STEP))
    return {name: (forth[name] - back[name]) / (2 * _STEP) for name in forth}


def _short(value: float) -> float:
    return float(f"{value:.{_DIGITS}g}")


_LIBRARIES = {
    "jax": "jax",
    "optimistix": "optimistix",
    "equinox": "equinox",
    "numpy": "numpy",
    "opencv": "cv2",
}
"""What a calibration was computed with, and the module that says its version: packages
of OpenCV have many names."""
_ALONG_THE_AXIS = {
    "pupil_offset": "entrance_pupil_offset_mm",
    "pupil_shift": "pupil_shift_mm",
}
"""Names in the covariance of an entry."""


def camera_of(shoot: Shoot, observed: list[Observed]) -> Camera:
    """The sensor area and pixels of the photographs that were used."""
    first = next(o.take for o in observed if o.take is not None)
    width_px, height_px = first.observations.image_size_px
    return Camera(
        model=shoot.camera.model,
        sensor_width_mm=first.sensor_size_mm[0],
        sensor_height_mm=first.sensor_size_mm[1],
        image_width_px=width_px,
        image_height_px=height_px,
    )


def provenance_of(shoot: Shoot, observed: list[Observed]) -> Provenance:
    """Which photographs, which program, when."""
    from lensfit import __version__

    return Provenance(
        created=datetime.now(UTC).isoformat(timespec="seconds"),
        lensfit_version=__version__,
        versions={
            name: import_module(module).__version__
            for name, module in _LIBRARIES.items()
        },
        images=tuple(
            SourceImage(o.image, o.sha256, o.target) for o in observed if o.take
        ),
        shoot_sha256=hashlib.sha256(shoot.path.read_bytes()).hexdigest(),
    )


def entry_of(state: LensState, wavefront: WavefrontFit | None = None) -> Entry:
    """One state of the lens as a preset entry.

    Parameters
    ----------
    wavefront : Of its focal length.
    """
    geometry = state.geometry
    distortion = state.distortion
    distance = float(distortion.principal_distance_mm)
    assumed = [] if state.pupil.measured else ["entrance_pupil_offset_mm"]
    if not geometry.focal_length_free:
        assumed.insert(0, "principal_distance_mm")
    if state.pupil_shift is not None and not state.pupil_shift.measured:
        assumed.append("pupil_shift")
    rms_px, held_out_px, used, detected = errors_of(geometry)
    entry = Entry(
        focal_length_mm=state.focal_length_mm,
        focus_distance_mm=state.focus_distance_mm,
        projection=blocks.Projection(
            principal_distance_mm=distance,
            principal_point_mm=tuple(
                np.asarray(distortion.principal_point_mm).tolist()
            ),
            entrance_pupil_offset_mm=state.pupil.offset_mm,
            pupil_shift=_pupil_shift(state),
            assumed=tuple(assumed),
        ),
        distortion=distortion_block(distortion),
        lateral_colour=_lateral(state),
        fall_off=tuple(_fall_off(f) for f in _fall_offs_of_known_stops(state.fall_off)),
        terms=tuple(_term(t) for t in terms_of(state, wavefront)),
        covariance=_covariance(state),
        quality=Quality(
            rms_px=rms_px,
            held_out_rms_px=held_out_px,
            points_detected=detected,
            points_used=int(used),
            photographs=len(geometry.takes),
        ),
        blur=known_blur_of(state, wavefront) if wavefront is not None else None,
    )
    return with_predicted_fall_off(entry)


def with_quality(preset: Preset, facts: list[dict[str, Any]]) -> Preset:
    """The preset with what the report found of each entry over the whole frame.

    Parameters
    ----------
    facts : As `entry_facts`, in the order of the entries.
    """

    def one(entry: Entry, found: dict[str, Any]) -> Entry:
        deviation = np.array(found["uncertainty_grid"]["sd_px"], float)
        known = deviation[np.isfinite(deviation)]
        quality = msgspec.structs.replace(
            entry.quality,
            largest_standard_deviation_px=float(known.max()) if len(known) else None,
            round_trip_px=float(found["round_trip_max_px"]),
        )
        return msgspec.structs.replace(entry, quality=quality)

    entries = tuple(one(e, f) for e, f in zip(preset.entries, facts, strict=True))
    return msgspec.structs.replace(preset, entries=entries)


def _pupil_shift(state: LensState) -> blocks.PupilShift | None:
    if state.pupil_shift is None:
        return None
    ahead_mm = state.geometry.adjustment.frame.board_distance_mm
    return blocks.PupilShift(
        shift_mm=state.pupil_shift.shift_mm,
        chart_distance_mm=state.pupil.offset_mm + float(ahead_mm),
        standard_deviation_mm=state.pupil_shift.standard_deviation_mm,
    )


def _lateral(state: LensState) -> blocks.LateralColour | None:
    # However slight it is: a pixel of the photograph is several of a larger plate.
    if not any(colour.has_terms for colour in state.colour.values()):
        return None

    def block(colour: ChannelColour) -> blocks.ChannelShift:
        return blocks.ChannelShift(
            radial=colour.radial,
            shift_mm=colour.shift_mm,
            valid_radius=colour.valid_radius,
            strain=colour.strain,
            decentering=colour.decentering,
        )

    red, blue = state.colour["r"], state.colour["b"]
    radius_mm = float(state.distortion.reference_radius_mm)
    return blocks.LateralColour(
        block(red),
        block(blue),
        blocks.LateralCovariance(
            _colour_covariance(red, radius_mm), _colour_covariance(blue, radius_mm)
        ),
    )


def _colour_covariance(colour: ChannelColour, reference_radius_mm: float) -> Covariance:
    """Of the terms that were kept, each in the unit of its block."""
    names = np.array(lateral_names(len(colour.radial)))
    unit = np.where(np.arange(len(names)) < 2, reference_radius_mm, 1.0)
    matrix = colour.covariance * np.outer(unit, unit)
    kept = np.flatnonzero(np.diag(matrix))
    return Covariance.from_matrix(
        tuple(names[kept].tolist()), matrix[np.ix_(kept, kept)]
    )


def _fall_offs_of_known_stops(measured: list[FallOffFit]) -> list[FallOffFit]:
    """Those with an f-number; one without it counts only when it is alone."""
    known = [fall_off for fall_off in measured if fall_off.f_number is not None]
    return known or measured[:1]


def _fall_off(fall_off: FallOffFit) -> blocks.FallOff:
    r, g, b = (tuple(row.tolist()) for row in fall_off.control)
    known = [
        Covariance.from_matrix(tuple(fall_off_names(channel, len(matrix))), matrix)
        for channel, matrix in zip("rgb", fall_off.covariance, strict=True)
    ]
    return blocks.FallOff(
        fall_off.f_number,
        fall_off.valid_radius_mm,
        r,
        g,
        b,
        covariance=blocks.FallOffCovariance(*known),
    )


def _term(term: dict) -> Term:
    value, deviation = term["value"], term["standard_deviation"]
    single = isinstance(value, float)
    return Term(
        name=term["name"],
        kept=term["kept"],
        value=value if single else None,
        standard_deviation=deviation if single else None,
        unit=term["unit"],
        reason=term["reason"],
    )


def _covariance(state: LensState) -> Covariance:
    """Of the shared parameters, in the units of `lensfit.fitting.parameters`, but
    lengths along the axis in mm; of all that are not known to be what they are."""
    known = state.uncertainty.covariance
    adjustment = state.geometry.adjustment
    unit = np.ones(len(known))
    names, rows = [], []
    for block, where in adjustment.layout.blocks.items():
        places = np.flatnonzero(np.diag(known)[where])
        if block in _ALONG_THE_AXIS:
            unit[where] = float(adjustment.frame.stated_focal_length_mm)
            block = _ALONG_THE_AXIS[block]
        # The layout of the fit has room for more of the field than was kept.
        numbers = np.arange(len(places)) if block == "free_field" else places
        names += [f"{block}[{k}]" for k in numbers]
        rows += (where.start + places).tolist()
    known = known * np.outer(unit, unit)
    return Covariance.from_matrix(tuple(names), known[np.ix_(rows, rows)])
