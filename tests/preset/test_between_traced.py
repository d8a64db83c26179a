"""Breathing and zooming between calibrated states, judged by exact ray traces.

Entries are fitted to traced chief rays at two settings; what the preset makes of a
setting between them is compared with the trace there, in pixels of a 4096 px frame.
"""

import math
from functools import cache

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from preset_makers import make_entry, make_preset
from scipy.optimize import least_squares

from data_synth.aim import chief_landings_mm
from data_synth.lens import set_lens
from data_synth.prescription import load_prescription
from lensfit.optics.distortion import magnification
from lensfit.preset.blocks import Distortion, Projection

GREEN_NM = 546.07
WIDTH_PX = 4096
VALID = 1.1


@jax.jit
def profile(radii, coefficients):
    return jax.vmap(
        lambda r: r * magnification(r**2, coefficients, jnp.asarray(VALID**2))
    )(radii)


@cache
def traced(name, focal_length_mm, focus_mm):
    """The set lens, objects along the diagonal in focus, and where they land, mm."""
    known = load_prescription(name)
    lens = set_lens(known, focal_length_mm=focal_length_mm, focus_distance_mm=focus_mm)
    distance_mm = min(focus_mm, 1e8)
    half_mm = np.hypot(*known.sensor_size_mm) / 2
    ahead_mm = distance_mm + lens.pupil_z_mm
    size = np.linspace(0.02, 0.93, 25) * half_mm * ahead_mm / lens.focal_length_mm
    objects = np.stack([0.8 * size, 0.6 * size, np.full(25, distance_mm)], -1)
    landed = chief_landings_mm(lens, objects * [1, 1, -1], GREEN_NM)
    assert np.isfinite(landed).all()
    return lens, objects, landed


@cache
def entry_of(name, focal_length_mm, focus_mm):
    """What a calibration without error would say of a setting."""
    lens, objects, landed = traced(name, focal_length_mm, focus_mm)
    pupil_mm = -float(lens.pupil_z_mm)
    unit_mm = np.hypot(*lens.prescription.sensor_size_mm) / 2
    slopes = np.hypot(*objects[:, :2].T) / (objects[:, 2] - pupil_mm)
    wanted_mm = np.hypot(*landed.T)

    def misfit_mm(p):
        return np.asarray(profile(p[0] * slopes / unit_mm, p[1:])) * unit_mm - wanted_mm

    start = [lens.focal_length_mm, 0.0, 0.0, 0.0]
    fit = least_squares(misfit_mm, start, x_scale="jac", xtol=1e-14, ftol=1e-14)
    assert np.abs(fit.fun).max() < 3e-5
    return make_entry(
        focal_length_mm=float(lens.focal_length_mm),
        focus_distance_mm=focus_mm,
        projection=Projection(float(fit.x[0]), (0.0, 0.0), pupil_mm),
        distortion=Distortion(
            "rectilinear",
            unit_mm,
            VALID,
            (-1.2, -1.2, 1.2, 1.2),
            tuple(fit.x[1:].tolist()),
        ),
        lateral_colour=None,
        fall_off=(),
        blur=None,
    )


def errors_px(lens, name, focal_length_mm, focus_mm):
    """Rms error of positions, and what is left of it after a scale."""
    _, objects, landed = traced(name, focal_length_mm, focus_mm)
    found = np.asarray(lens.project(objects))
    pixel_mm = load_prescription(name).sensor_size_mm[0] / WIDTH_PX
    scale = np.sum(found * landed) / np.sum(found**2)
    return [
        float(np.sqrt(np.mean(np.sum((f - landed) ** 2, -1)))) / pixel_mm
        for f in (found, found * scale)
    ]


@pytest.mark.parametrize(
    ("name", "focal_length_mm", "largest_px"),
    [
        ("biotar_50", 50, 0.35),
        ("nikkor_28", 28, 0.05),
        ("cooke_triplet_50", 50, 0.15),
        ("itoh_zoom", 35, 0.25),
        ("itoh_zoom", 51, 0.35),
    ],
)
@pytest.mark.parametrize("focus_mm", [1300.0, 2000.0, 5000.0])
def test_breathing_between_infinity_and_a_metre(
    name, focal_length_mm, largest_px, focus_mm
):
    """Whole lenses and a front group that move: 6 to 36 px of breathing are followed
    to a third of a pixel, and the distortion to a fortieth."""
    ends = [entry_of(name, focal_length_mm, at) for at in (1000.0, math.inf)]
    preset = make_preset(*ends)
    lens = preset.at(focus_distance_mm=focus_mm)
    setting = (name, focal_length_mm, focus_mm)
    all_px, shape_px = errors_px(lens, *setting)
    assert all_px < largest_px
    assert shape_px < 0.025
    far_px, _ = errors_px(make_preset(ends[1]).at(), *setting)
    assert far_px > 20 * all_px


@pytest.mark.parametrize("focus_mm", [2000.0, math.inf])
def test_a_zoom_between_its_ends(focus_mm):
    """35 to 51 mm in one step, at 41.5 mm: of 40 px by which barrel distortion changes
    half a pixel is missed, with the magnification one and a half."""
    ends = [entry_of("itoh_zoom", at, focus_mm) for at in (35.0, 51.0)]
    middle = float(traced("itoh_zoom", 41.5, focus_mm)[0].focal_length_mm)
    lens = make_preset(*ends).at(middle, focus_distance_mm=focus_mm)
    all_px, shape_px = errors_px(lens, "itoh_zoom", 41.5, focus_mm)
    assert all_px < 1.6
    assert shape_px < 0.6


def test_a_zoom_at_a_focus_between_too():
    """Four entries around a setting that differs in both."""
    preset = make_preset(
        *(entry_of("itoh_zoom", f, s) for f in (35.0, 51.0) for s in (1000.0, math.inf))
    )
    middle = float(traced("itoh_zoom", 41.5, 2000.0)[0].focal_length_mm)
    lens = preset.at(middle, focus_distance_mm=2000.0)
    all_px, shape_px = errors_px(lens, "itoh_zoom", 41.5, 2000.0)
    assert all_px < 1.8
    assert shape_px < 0.65


def test_a_point_goes_the_way_the_trace_goes_between_the_ends():
    """Seen from one direction the corner runs outwards all the way, zooming in."""
    ends = [entry_of("itoh_zoom", at, 2000.0) for at in (35.0, 51.0)]
    preset = make_preset(*ends)
    points = np.array([[250.0, 190.0, 2000.0], [480.0, 360.0, 2000.0]])
    low, high = (e.focal_length_mm for e in ends)
    path = np.stack(
        [preset.at(float(f)).project(points) for f in np.linspace(low, high, 21)]
    )
    assert (np.diff(np.hypot(path[..., 0], path[..., 1]), axis=0) > 0).all()
    assert (
        np.abs(np.diff(path, 2, axis=0)).max() < 0.02 * np.abs(path[-1] - path[0]).max()
    )
