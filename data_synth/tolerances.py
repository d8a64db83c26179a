"""Lenses near a published one: scaled, made with errors, with other rims or fronts.

Prescriptions in, prescriptions out, so that whatever photographs a published lens
photographs these. Every random change comes from a seed.

Sizes of errors follow what workshops hold (W. J. Smith, Modern Optical Engineering, the
chapter on tolerances): a few tenths of a per cent of a radius, a few hundredths of a
millimetre of a thickness and of decentring, about a minute of arc of tilt, all for a
lens of 50 mm.
"""

import dataclasses
import math

import numpy as np

from data_synth.aim import tracer_from_object
from data_synth.glass import glass_from_abbe
from data_synth.lens import set_lens
from data_synth.paraxial import first_order
from data_synth.prescription import Prescription, ZoomState
from data_synth.pupilmap import REFERENCE_NM, open_bounds_mm, pupil_map
from data_synth.sensor import Frame
from data_synth.spots import field_points_mm
from data_synth.surfaces import Surface

CURVATURE_PART = 0.003
THICKNESS_PART = 0.01
DECENTRE_PART = 4e-4
"""Of the focal length."""
TILT_RAD = 4e-4
CORNER = ((0.95,), (0.95,))
AXIS_PART = 0.998
BISECTIONS = 14


def scaled(prescription: Prescription, focal_length_mm: float) -> Prescription:
    """The lens and its sensor larger or smaller, to this focal length (first state)."""
    scale = focal_length_mm / prescription.states[0].focal_length_mm
    width, height = prescription.sensor_size_mm
    return dataclasses.replace(
        prescription,
        title=f"{prescription.title}, scaled to {focal_length_mm:g} mm",
        sensor_size_mm=(
            round(width * scale, 4),
            round(height * scale, 4),
        ),
        surfaces=tuple(_surface_scaled(s, scale) for s in prescription.surfaces),
        states=tuple(
            ZoomState(
                round(state.focal_length_mm * scale, 3),
                {k: t * scale for k, t in state.thicknesses_mm.items()},
            )
            for state in prescription.states
        ),
    )


def _surface_scaled(surface: Surface, scale: float) -> Surface:
    return dataclasses.replace(
        surface,
        curvature_x_per_mm=surface.curvature_x_per_mm / scale,
        curvature_y_per_mm=surface.curvature_y_per_mm / scale,
        thickness_mm=surface.thickness_mm * scale,
        semi_diameter_mm=surface.semi_diameter_mm * scale,
        even_coefficients=tuple(
            value / scale ** (2 * power - 1)
            for power, value in enumerate(surface.even_coefficients, start=2)
        ),
    )


def perturbed(
    prescription: Prescription, seed: int, *, strength: float = 1.0, shape: bool = True
) -> Prescription:
    """The lens as one workshop made it: radii, thicknesses, decentred and tilted glass.

    `set_lens` focuses the result anew. Elements (glass from its first surface to the
    next air) are displaced as a whole; the iris stays. Radii and thicknesses change the
    same in every state of a zoom.

    Parameters
    ----------
    strength : 1 is ordinary; 5 is a lens that was dropped.
    shape : Whether radii and thicknesses change too.
    """
    rng = np.random.default_rng(seed)
    focal_mm = prescription.states[0].focal_length_mm
    surfaces = list(prescription.surfaces)
    for first, last in elements(prescription.surfaces):
        shift = rng.normal(scale=DECENTRE_PART * focal_mm * strength, size=2)
        tilt = rng.normal(scale=TILT_RAD * strength, size=2)
        depth_mm = 0.0
        for number in range(first, last + 1):
            curve, thick = rng.normal(size=2) * (strength if shape else 0.0)
            # A tilt about the element's front vertex carries the later ones aside.
            lever = depth_mm * np.array([math.sin(tilt[1]), -math.sin(tilt[0])])
            old = surfaces[number]
            glass = number < last
            depth_mm += old.thickness_mm if glass else 0.0
            surfaces[number] = dataclasses.replace(
                old,
                curvature_x_per_mm=old.curvature_x_per_mm
                * (1 + CURVATURE_PART * curve),
                curvature_y_per_mm=old.curvature_y_per_mm
                * (1 + CURVATURE_PART * curve),
                thickness_mm=old.thickness_mm
                * (1 + (THICKNESS_PART * thick if glass else 0.0)),
                decentre_mm=tuple((shift + lever).tolist()),
                tilt_rad=tuple(tilt.tolist()),
            )
    return dataclasses.replace(
        prescription,
        title=f"{prescription.title}, made with seed {seed}",
        surfaces=tuple(surfaces),
    )


def behind_meniscus(prescription: Prescription) -> Prescription:
    """The lens behind a strong negative meniscus: short, wide, with barrel distortion.

    Not a published lens: a plain front glass (N-BK7), whose size suits a lens of 28 mm.
    """
    scale = prescription.states[0].focal_length_mm / 28.0
    glass = glass_from_abbe(1.5168, 64.17)
    front = (
        Surface(1 / 200.0, 1 / 200.0, 3.0, 36.0, glass),
        Surface(1 / 24.0, 1 / 24.0, 18.0, 22.3),
    )
    scaled_front = tuple(_surface_scaled(s, scale) for s in front)
    surfaces = scaled_front + prescription.surfaces
    focal_mm = first_order(surfaces, REFERENCE_NM).focal_length_mm
    return dataclasses.replace(
        prescription,
        title=f"{prescription.title}, behind a negative meniscus",
        surfaces=surfaces,
        states=(ZoomState(round(float(focal_mm), 1), {}),),
        focus_group=(0, len(surfaces) - 1),
    )


def elements(surfaces: tuple[Surface, ...]) -> list[tuple[int, int]]:
    """First and last surface of every piece of glass between air and air."""
    found, first = [], None
    for number, surface in enumerate(surfaces):
        is_air = surface.glass.refractive_index(REFERENCE_NM) == 1.0
        if first is None and not is_air:
            first = number
        elif first is not None and is_air:
            found.append((first, number))
            first = None
    return found


def with_rims_closed(
    prescription: Prescription, frame: Frame, corner_part: float = 1 / 3
) -> Prescription:
    """The first and last rim closed until the corner keeps this part of the pupil.

    Wide open and focused at forty focal lengths; both rims shrink by the same factor,
    but no further than the bundle on the axis passes: its f-number stays.
    """
    low, high = 0.3, 1.0
    whole = _open_areas(prescription, frame)[1]
    for _ in range(BISECTIONS):
        middle = (low + high) / 2
        corner, axis = _open_areas(_rims_times(prescription, middle), frame)
        if corner > corner_part * axis and axis > AXIS_PART * whole:
            high = middle
        else:
            low = middle
    return dataclasses.replace(
        _rims_times(prescription, high),
        title=f"{prescription.title}, rims closed",
    )


def _rims_times(prescription: Prescription, factor: float) -> Prescription:
    surfaces = list(prescription.surfaces)
    for number in (0, len(surfaces) - 1):
        semi_diameter_mm = surfaces[number].semi_diameter_mm * factor
        surfaces[number] = dataclasses.replace(
            surfaces[number], semi_diameter_mm=semi_diameter_mm
        )
    return dataclasses.replace(prescription, surfaces=tuple(surfaces))


def _open_areas(prescription: Prescription, frame: Frame) -> tuple[float, float]:
    """Open area of the pupil seen from the corner and from the axis, mm^2."""
    distance_mm = 40 * prescription.states[0].focal_length_mm
    lens = set_lens(prescription, focus_distance_mm=distance_mm)
    corner = field_points_mm(lens, frame, CORNER, distance_mm)
    points = tracer_from_object(np.concatenate([corner, [[0.0, 0.0, distance_mm]]]))
    normals = np.broadcast_to([0.0, 0.0, 1.0], points.shape)
    bounds = open_bounds_mm(lens, points)
    rays = pupil_map(lens, points, normals, bounds, REFERENCE_NM, 32)
    light = rays.refined(lens.stop, 64).flux / rays.fields[:, 5].max()
    corner_area, axis_area = light.sum(axis=(1, 2))
    return float(corner_area), float(axis_area)
