"""A prescription set to a focal length, f-number and focus distance.

Focus is found as a photographer finds it: the group moves until the axial point at the
focus distance (counted from the sensor) makes the smallest rms spot in green, wide
open. The f-number is geometric: focal length over entrance pupil diameter, focused at
infinity, in the y section.
"""

import dataclasses
import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from data_synth.paraxial import FirstOrder, Section, first_order
from data_synth.prescription import Prescription
from data_synth.surfaces import Surface
from data_synth.trace import Stop, Traced, trace

REFERENCE_NM = 546.07
Group = tuple[int, int, float]
"""First and last surface, and the share of the movement that it makes."""
FAR_MM = 1e9
"""An object this far away stands for infinity."""


@dataclass(frozen=True, eq=False)
class SetLens:
    """A lens ready to photograph: sensor at z = 0, tracer frame.

    Attributes
    ----------
    surfaces, stop : What rays meet.
    focal_length_mm : Effective focal length at infinity focus, y section.
    f_number, focus_distance_mm : As set.
    pupil_z_mm, pupil_radius_mm : Paraxial entrance pupil at this focus, larger section.
    """

    prescription: Prescription
    surfaces: tuple[Surface, ...]
    stop: Stop
    focal_length_mm: float
    f_number: float
    focus_distance_mm: float
    pupil_z_mm: float
    pupil_radius_mm: float

    def trace(self, origin_mm, direction, wavelength_nm: float) -> Traced:
        """Trace rays of one wavelength to the sensor (see `data_synth.trace`)."""
        return trace(self.surfaces, self.stop, origin_mm, direction, wavelength_nm)


def set_lens(
    prescription: Prescription,
    *,
    focal_length_mm: float | None = None,
    f_number: float | None = None,
    focus_distance_mm: float = math.inf,
    blades: int = 0,
    blade_rotation_rad: float = 0.0,
    blade_roundness: float = 0.0,
    change=None,
) -> SetLens:
    """Set zoom, stop and focus.

    Parameters
    ----------
    prescription : The lens as published.
    focal_length_mm : Which state of a zoom (the nearest published one).
    f_number : The prescription's widest by default.
    focus_distance_mm : From the sensor; infinity is allowed.
    blades : Blades of the iris when stopped down; round wide open or when 0.
    change : Function from surfaces to surfaces applied before focusing: a tolerance
        error such as a decentred element.
    """
    state = prescription.state_nearest(focal_length_mm)
    surfaces = _with_thicknesses(prescription.surfaces, state.thicknesses_mm)
    if change is not None:
        surfaces = change(surfaces)
    f_number = prescription.f_number if f_number is None else f_number
    widest = min(f_number, prescription.f_number)
    at_infinity = _focused(surfaces, prescription, math.inf, widest)
    data = first_order(at_infinity, REFERENCE_NM)
    focused = at_infinity
    if math.isfinite(focus_distance_mm):
        focused = _focused(at_infinity, prescription, focus_distance_mm, widest)
    radius_mm = abs(
        data.focal_length_mm / (2 * f_number * data.entrance_pupil_magnification)
    )
    wide_open = f_number <= prescription.f_number * 1.001
    stop = Stop(
        radius_mm, 0 if wide_open else blades, blade_rotation_rad, blade_roundness
    )
    pupil = _larger_pupil(focused)
    return SetLens(
        prescription=prescription,
        surfaces=focused,
        stop=stop,
        focal_length_mm=data.focal_length_mm,
        f_number=f_number,
        focus_distance_mm=focus_distance_mm,
        pupil_z_mm=pupil.entrance_pupil_z_mm,
        pupil_radius_mm=abs(radius_mm * pupil.entrance_pupil_magnification),
    )


def _larger_pupil(surfaces: tuple[Surface, ...]) -> FirstOrder:
    sections = [first_order(surfaces, REFERENCE_NM, s) for s in ("x", "y")]
    return max(sections, key=lambda data: abs(data.entrance_pupil_magnification))


def _with_thicknesses(
    surfaces: tuple[Surface, ...], thicknesses_mm: dict[int, float]
) -> tuple[Surface, ...]:
    return tuple(
        dataclasses.replace(s, thickness_mm=thicknesses_mm.get(i, s.thickness_mm))
        for i, s in enumerate(surfaces)
    )


def _moved(
    surfaces: tuple[Surface, ...], group: tuple[int, int], extension_mm: float
) -> tuple[Surface, ...]:
    """The group moved towards the scene; what stands around it stays."""
    first, last = group
    change = {last: surfaces[last].thickness_mm + extension_mm}
    if first > 0:
        change[first - 1] = surfaces[first - 1].thickness_mm - extension_mm
    return _with_thicknesses(surfaces, change)


def _moved_together(
    surfaces: tuple[Surface, ...], groups: tuple[Group, ...], extension_mm: float
) -> tuple[Surface, ...]:
    """Groups moved towards the scene, each by its share."""
    for first, last, share in groups:
        surfaces = _moved(surfaces, (first, last), share * extension_mm)
    return surfaces


def _focused(
    surfaces: tuple[Surface, ...],
    prescription: Prescription,
    distance_mm: float,
    f_number: float,
) -> tuple[Surface, ...]:
    """The lens focused at a distance from the sensor (at infinity by its back gap)."""
    cylinders = prescription.anamorphic_focus_group
    sections: tuple[Section, ...] = ("y",) if cylinders else ("x", "y")
    groups: tuple[Group, ...] = ((0, len(surfaces) - 1, 1.0),)
    if math.isfinite(distance_mm):
        groups = ((*prescription.focus_group, 1.0), *prescription.floating_groups)
    surfaces = _sharpened(surfaces, groups, distance_mm, f_number, sections)
    if cylinders:
        of_x = ((*cylinders, 1.0),)
        surfaces = _sharpened(surfaces, of_x, distance_mm, f_number, ("x",))
    return surfaces


def _sharpened(
    surfaces: tuple[Surface, ...],
    groups: tuple[Group, ...],
    distance_mm: float,
    f_number: float,
    sections: tuple[Section, ...],
) -> tuple[Surface, ...]:
    """Secant search for the movement that brings the best focus onto the sensor."""

    def defocus_mm(extension_mm: float) -> float:
        moved = _moved_together(surfaces, groups, extension_mm)
        return _defocus_mm(moved, distance_mm, f_number, sections)

    previous, current = 0.0, 0.1
    error_previous = defocus_mm(previous)
    for _ in range(40):
        error = defocus_mm(current)
        if abs(error) < 1e-10 or error == error_previous:
            break
        slope = (error - error_previous) / (current - previous)
        previous, error_previous = current, error
        current = current - float(np.clip(error / slope, -20.0, 20.0))
    return _moved_together(surfaces, groups, current)


def _defocus_mm(
    surfaces: tuple[Surface, ...],
    distance_mm: float,
    f_number: float,
    sections: tuple[Section, ...],
) -> float:
    """How far behind the sensor the axial bundle is narrowest (rms over the pupil)."""
    pupils = {s: first_order(surfaces, REFERENCE_NM, s) for s in ("x", "y")}
    stop_mm = pupils["y"].focal_length_mm / (2 * f_number)
    stop_mm /= pupils["y"].entrance_pupil_magnification
    one_side = abs(stop_mm) * np.sqrt((np.arange(16) + 0.5) / 16)
    # Both sides of the axis: a displaced element throws the whole bundle aside.
    stop_heights = np.concatenate([one_side, -one_side])
    product, square = 0.0, 0.0
    for section in sections:
        axis = "xy".index(section)
        pupil = pupils[section]
        target = np.zeros((len(stop_heights), 3))
        target[:, 2] = pupil.entrance_pupil_z_mm
        target[:, axis] = stop_heights * abs(pupil.entrance_pupil_magnification)
        origin = np.zeros_like(target)
        origin[:, 2] = -min(distance_mm, FAR_MM)
        traced = trace(surfaces, None, *_ray_between(origin, target), REFERENCE_NM)
        slope = traced.direction[:, axis] / traced.direction[:, 2]
        slope = slope - np.nanmean(slope)
        product += np.nansum(traced.landing_mm[:, axis] * slope)
        square += np.nansum(slope * slope)
    return float(-product / square)


def _ray_between(
    origin_mm: Float[np.ndarray, "rays 3"], target_mm: Float[np.ndarray, "rays 3"]
) -> tuple[Float[np.ndarray, "rays 3"], Float[np.ndarray, "rays 3"]]:
    """Rays from the target plane, in the direction from origin to target.

    They start on the target plane's side of the scene, so that no digits are lost to
    a distant object.
    """
    direction = target_mm - origin_mm
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    return target_mm, direction
