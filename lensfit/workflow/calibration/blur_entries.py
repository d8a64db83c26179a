"""The fitted wavefront as it is kept: the blur block of a preset entry."""

from functools import partial

import jax
import numpy as np
from jaxtyping import Array, Float

from lensfit.fitting.lens_state import LensState
from lensfit.fitting.wavefront.dot_data import DotData, FocusGroup
from lensfit.fitting.wavefront.fit import WavefrontFit
from lensfit.fitting.wavefront.parameters import Layout, Scale, aberration_of, pupil_of
from lensfit.optics.aberration import Aberration
from lensfit.optics.depth import log_squeeze
from lensfit.optics.paraxial import (
    FirstOrder,
    Scalar,
    defocus_mm,
    first_order_of,
    rim_sine,
)
from lensfit.optics.pupil import Pupil
from lensfit.optics.spectrum import WIDTHS_NM
from lensfit.preset.blocks import Blur, Stop
from lensfit.preset.blur_of_block import blur_block

_PUPIL_MAGNIFICATIONS = 0.1, 10.0
"""Of lenses that there are; elements that move while focusing make breathing that of
another."""


def blur_of(state: LensState, wavefront: WavefrontFit) -> Blur:
    """The blur block of one state; states of a focal length share their wavefront, but
    for what changes with focus."""
    stage = wavefront.stage
    dot_data, layout, parameters = stage.dot_data, stage.layout, stage.parameters
    principal_distance_ratio = _principal_distance_ratio(state, dot_data)
    optics = _optics_of(
        parameters,
        layout,
        dot_data.scale,
        principal_distance_ratio,
        dot_data.focus.coordinate(state.focus_distance_mm),
        1.0 * stage.blades,
    )
    aberration, pupil = jax.device_get(optics)
    ratios = np.exp(np.append(0.0, parameters[layout.blocks["stop_ratio"]]))
    numbers = dot_data.f_numbers
    offset_mm = None
    if layout.anamorphic:
        found = parameters[layout.blocks["astigmatic_offset"]][: len(dot_data.groups)]
        offset_mm = _mean_of_state(found, state, wavefront)
    return blur_block(
        aberration,
        pupil,
        pupil_magnification=_pupil_magnification(state, wavefront),
        reference_distance_mm=dot_data.reference_distance_mm,
        focus_offset_mm=_focus_offset_mm(state, wavefront),
        stops=[
            Stop(number, float(ratio) * _nominal_ratio(number, state, wavefront))
            for number, ratio in zip(numbers, ratios, strict=False)
        ],
        round_f_number=numbers[0],
        assumed=() if wavefront.has("exit_pupil") else _assumed_parameters(dot_data),
        band_widths_nm=_band_widths_nm(wavefront),
        beyond_offset_mm=offset_mm,
    )


def _band_widths_nm(wavefront: WavefrontFit) -> tuple[float, float, float]:
    stage = wavefront.stage
    ratio = np.abs(1 + stage.parameters[stage.layout.blocks["band_width"]])
    red, green, blue = (np.asarray(WIDTHS_NM) * ratio).tolist()
    return red, green, blue


def _assumed_parameters(dot_data: DotData) -> tuple[str, ...]:
    """What stands for an exit pupil that dots do not show: breathing between two focus
    distances gives its magnification, nothing gives its place."""
    if len({one.take.focus_distance_mm for one in dot_data.photographs}) > 1:
        return ("exit_pupil_distance_mm",)
    return ("pupil_magnification", "exit_pupil_distance_mm")


# Uncertainties write the block some hundred times over (`entries`): programs,
# since operations sent one by one would take most of that time.
@partial(jax.jit, static_argnames="layout")
def _optics_of(
    parameters: Float[Array, " parameters"],
    layout: Layout,
    scale: Scale,
    principal_distance_ratio: Float[Array, ""],
    focus: Float[Array, ""] | float,
    blades: Float[Array, ""],
) -> tuple[Aberration, Pupil]:
    aberration = aberration_of(
        parameters, layout, scale, principal_distance_ratio, focus
    )
    return aberration, pupil_of(parameters[layout.pupil_parameters], layout, blades)


@jax.jit
def _sine_ratio(
    fitted: FirstOrder, own: FirstOrder, f_number: Scalar, reference_mm: Scalar
) -> Scalar:
    fitted_sine = rim_sine(fitted, f_number, reference_mm)
    return fitted_sine / rim_sine(own, f_number, reference_mm)


_first_order_of = jax.jit(first_order_of)
_defocus_mm = jax.jit(defocus_mm)


def _principal_distance_ratio(state: LensState, dot_data: DotData) -> float:
    """Principal distance of the state over that of the reference, both as the fit of
    the blur had them.

    Chief rays may say another one afterwards. That changes no millimetre of a spot on
    the sensor, which is what was fitted.
    """
    own = [
        photograph.distortion
        for photograph in dot_data.photographs
        if photograph.take.focus_distance_mm == state.focus_distance_mm
    ]
    distortion = own[0] if own else state.distortion
    distance_mm = float(distortion.principal_distance_mm)
    return distance_mm / float(dot_data.scale.principal_distance_mm)


def _pupil_magnification(state: LensState, wavefront: WavefrontFit) -> float:
    """Exit over entrance pupil, from how far the exit pupil is from the sensor.

    By `optics.paraxial`, L = m_p f + f^2 / X and c = f + f^2 / (m_p X): L = m_p c.
    Where the photographs do not show it, from breathing.
    """
    if not wavefront.has("exit_pupil"):
        inverse = 1 / float(wavefront.dot_data.first_order.pupil_magnification)
        return 1 / float(np.clip(inverse, *_PUPIL_MAGNIFICATIONS))
    stage = wavefront.stage
    return float(np.exp(stage.parameters[stage.layout.blocks["exit_pupil"]][0]))


def _focus_offset_mm(state: LensState, wavefront: WavefrontFit) -> float:
    """What the photographs of this state say beyond the barrel; else what all say."""
    dot_data = wavefront.stage.dot_data
    where = wavefront.stage.layout.blocks["defocus"]
    found = wavefront.stage.parameters[where][: len(dot_data.groups)]
    along_y = 1.0
    if wavefront.stage.layout.anamorphic:
        along_y = float(np.exp(log_squeeze(state.distortion)))
    offsets = [
        value
        - along_y
        * _first_order_defocus_mm(
            group.focus_distance_mm,
            state,
            dot_data.reference_distance_mm,
            _pupil_magnification(state, wavefront),
        )
        for value, group in zip(found, dot_data.groups, strict=True)
    ]
    return _mean_of_state(np.array(offsets), state, wavefront)


def _mean_of_state(
    of_groups: Float[np.ndarray, " groups"], state: LensState, wavefront: WavefrontFit
) -> float:
    """Mean over the groups of this state of measured distance, or else over others."""
    dot_data = wavefront.stage.dot_data
    measured = [not group.take for group in dot_data.groups]
    mine = [_same_focus(group, state) for group in dot_data.groups]
    for wanted in (np.array(mine) & measured, np.array(mine), np.array(measured)):
        if wanted.any():
            return float(np.mean(of_groups[wanted]))
    return float(np.mean(of_groups))


def _same_focus(group: FocusGroup, state: LensState) -> bool:
    return group.focus_distance_mm == state.focus_distance_mm


def _nominal_ratio(f_number: float, state: LensState, wavefront: WavefrontFit) -> float:
    """The stop that the fit took an f-number for, over what `Lens.psf` takes it for."""
    dot_data = wavefront.dot_data
    reference_mm = dot_data.reference_distance_mm
    focus_mm = state.focus_distance_mm or reference_mm
    mine = _focused_first_order(state, _pupil_magnification(state, wavefront), focus_mm)
    ratio = _sine_ratio(dot_data.first_order, mine, f_number, reference_mm)
    return dot_data.beam.ratio * float(ratio)


def _first_order_defocus_mm(
    focus_distance_mm: float | None,
    state: LensState,
    reference_mm: float,
    pupil_magnification: float,
) -> float:
    """Defocus of the reference distance by first-order optics, as `Lens.psf` has it."""
    if focus_distance_mm is None:
        return 0.0
    said = _focused_first_order(state, pupil_magnification, focus_distance_mm)
    return float(_defocus_mm(said, focus_distance_mm, reference_mm))


def _focused_first_order(
    state: LensState, pupil_magnification: float, focus_distance_mm: float
) -> FirstOrder:
    return _first_order_of(
        state.distortion.principal_distance_mm,
        pupil_magnification,
        state.pupil.offset_mm,
        focus_distance_mm,
    )
