"""What a preset says of deviations is what the fit said, and its report."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from pinhole_shoot import (
    IMAGE_PX,
    MM_PER_PX,
    SENSOR_MM,
    Camera,
    observations,
    take_of,
)
from scipy.interpolate import RegularGridInterpolator

from lensfit.fitting.chart_view import View
from lensfit.fitting.decentring import MANUFACTURING_TOLERANCE
from lensfit.fitting.lens_state import LensState, fit_state, with_colour
from lensfit.fitting.parameters import release
from lensfit.fitting.uncertainty import position_deviations_mm, uncertainty_of
from lensfit.lens import Lens
from lensfit.preset.blocks import Camera as CameraBlock
from lensfit.preset.schema import LensName, Preset, Provenance
from lensfit.preset.store import load_preset, save_preset
from lensfit.workflow.calibration.entries import entry_of
from lensfit.workflow.calibration.entry_facts import entry_facts

pytestmark = pytest.mark.slow

NOISE_PX = 0.02
CAMERA = Camera(k=(-0.12, 0.06), p=(2e-4, -1e-4), warp_mm=0.001)
FINE = np.stack(np.meshgrid(np.arange(-14, 15.0), np.arange(-10, 11.0)), -1) / 2
BLOCK = CameraBlock(None, *SENSOR_MM, *IMAGE_PX)


def coloured_take(view: int) -> View:
    """A photograph in colour whose light falls off, of a fine lattice."""
    lattice = FINE.reshape(-1, 2)
    image = CAMERA.image_mm(CAMERA.camera_axes(view, lattice * 40.0))
    seen = observations(image, NOISE_PX, 7 + view, lattice)
    rng = np.random.default_rng(view)
    noise = rng.normal(0, NOISE_PX, (3, len(image), 2))
    noise[1] = 0.0
    gain = np.array([4e-4, 0.0, -6e-4])[:, None, None]
    from_middle = seen.points_px - np.array(IMAGE_PX) / 2
    r2 = np.sum((from_middle * MM_PER_PX / 15.0) ** 2, -1)
    light = np.exp(-0.5 * r2[:, None] * [1.0, 1.1, 1.2])
    light = light * np.exp(rng.normal(0, 0.01, light.shape))
    seen = replace(
        seen,
        channel_points_px=seen.points_px + gain * from_middle + noise,
        channel_covariance_px2=np.stack([seen.covariance_px2] * 3),
        flux=light,
        bright=False,
    )
    return take_of(seen, f"view {view}", f_number=4.0, focus_distance_mm=900.0)


@pytest.fixture(scope="module")
def state() -> LensState:
    takes = [coloured_take(k) for k in range(3)]
    (state,) = with_colour([fit_state(takes, all_views=takes)])
    return state


@pytest.fixture(scope="module")
def lens(state: LensState, tmp_path_factory) -> Lens:
    """Of the preset that was written and read again."""
    path: Path = tmp_path_factory.mktemp("preset") / "preset.json"
    provenance = Provenance("2025-01-31T12:00:00+00:00", "0.1.0", {}, ())
    preset = Preset(
        lens=LensName("a pinhole"),
        camera=BLOCK,
        entries=(entry_of(state),),
        provenance=provenance,
    )
    save_preset(preset, path)
    return load_preset(path).at()


def grid_mm() -> np.ndarray:
    """Of the report, on the photograph."""
    x, y = (np.linspace(-s / 2, s / 2, n) for s, n in ((24.0, 25), (18.0, 17)))
    return np.stack(np.meshgrid(x, y), -1).reshape(-1, 2)


def test_positions_are_known_as_the_fit_and_its_report_say(state, lens):
    straight = np.asarray(lens.undistorted_from_distorted(grid_mm()))
    fitted = position_deviations_mm(
        state.geometry.adjustment, state.uncertainty, straight
    )
    stated = lens.position_standard_deviation_mm(straight)
    np.testing.assert_allclose(stated, fitted, rtol=1e-5)
    assert stated.min() > 0
    grid = np.array(entry_facts(state, lens, BLOCK)["uncertainty_grid"]["sd_px"])
    sd_px = np.hypot(*stated.T).reshape(grid.shape) / MM_PER_PX
    np.testing.assert_allclose(sd_px, grid, atol=1e-5)


def test_the_radial_profile_is_known_as_the_map_is(state, lens):
    """On a circle inside the frame both are one thing, though the profile's circles
    reach beyond it: a pose makes good of errors over the frame alone."""
    facts = entry_facts(state, lens, BLOCK)
    profile, grid = facts["radial_profile"], facts["uncertainty_grid"]
    row = np.searchsorted(profile["radius_mm"], 8.0)
    radius_mm = profile["radius_mm"][row]
    angle = 2 * np.pi * np.arange(24) / 24
    circle = radius_mm * np.stack([np.cos(angle), np.sin(angle)], -1)
    circle = circle + np.asarray(lens.distortion.principal_point_mm)
    seen = np.asarray(lens.distorted_from_undistorted(circle))
    on_map = RegularGridInterpolator(
        (grid["y_mm"], grid["x_mm"]), np.square(grid["sd_px"]), "cubic"
    )
    known_mm = np.sqrt(on_map(seen[:, ::-1]).mean()) * MM_PER_PX
    stated = profile["standard_deviation_percent"][row]
    assert stated == pytest.approx(100 * known_mm / radius_mm, rel=0.01)


def test_the_worst_corner_is_told_apart_by_kinds_of_errors(state, lens):
    """Shares of one variance; of centroids none is the wavefront's."""
    shares = entry_facts(state, lens, BLOCK)["corner_shares"]
    assert list(shares) == ["detections", "wavefront", "statements", "systematic"]
    assert sum(shares.values()) == pytest.approx(1.0, abs=1e-3)
    assert shares["wavefront"] == 0.0
    assert min(shares["detections"], shares["systematic"]) > 0.0
    whole = np.sum(list(state.uncertainty.parts.values()), 0)
    np.testing.assert_array_equal(whole, state.uncertainty.covariance)


def test_objects_in_focus_are_known_less_well_than_the_map(state, lens):
    """A turn of the camera makes good of the map what it does not of objects."""
    facts = entry_facts(state, lens, BLOCK)
    map_px, object_px = (
        np.array(facts[key]["sd_px"])
        for key in ("uncertainty_grid", "object_uncertainty_grid")
    )
    assert map_px.shape == object_px.shape
    assert (object_px[[0, 0, -1, -1], [0, -1, 0, -1]] > 0).all()
    assert object_px.max() >= map_px.max() - 1e-4


def test_an_axis_is_not_known_better_for_leaving_decentring_out():
    """Decentring within tolerances, which nobody sees beside another axis, makes the
    axis as uncertain as it does where its terms are fitted."""
    centred = Camera(k=(-0.02, 0.0), p=(0.0, 0.0))
    takes = []
    for view in range(3):
        board = FINE.reshape(-1, 2) * 40.0
        image = centred.image_mm(centred.camera_axes(view, board))
        seen = observations(image, NOISE_PX, view, FINE.reshape(-1, 2))
        takes.append(take_of(seen, f"view {view}", f_number=4.0))
    adjustment = fit_state(takes, all_views=takes).geometry.adjustment
    blocks, prior = adjustment.layout.blocks, adjustment.prior
    assert prior.free[blocks["principal_point"]].all()
    free = prior
    for name, width in MANUFACTURING_TOLERANCE.items():
        if not prior.free[blocks[name]].any():
            free = release(free, blocks[name], width)
    assert (free.free != prior.free).any()
    left_out, fitted = (
        uncertainty_of(one, tuple(takes)).deviation("principal_point")
        for one in (adjustment, replace(adjustment, prior=free))
    )
    np.testing.assert_allclose(left_out, fitted, rtol=0.1)


def test_the_field_of_the_fit_has_room_for_more_than_was_kept(state, lens):
    """So that numbers of the field are found by their order, not by their place."""
    layout = state.geometry.adjustment.layout
    assert 0 < lens.distortion.degree < layout.free_degree


@pytest.mark.parametrize("channel", ["r", "b"])
def test_lateral_colour_is_known_as_the_fit_says(state, lens, channel):
    colour = state.colour[channel]
    centre = np.asarray(state.distortion.principal_point_mm)
    radius_mm = float(state.distortion.reference_radius_mm)
    q = (grid_mm() - centre) / radius_mm
    inside = np.hypot(*q.T) < colour.valid_radius
    stated = lens.lateral_colour_standard_deviation_mm(grid_mm(), channel)
    assert inside.sum() > 300
    fitted = colour.deviations(q) * radius_mm
    np.testing.assert_allclose(stated[inside], fitted[inside], rtol=1e-9)
    assert stated.max() > 0


def test_fall_off_is_known_as_the_fit_says(state, lens):
    (fall_off,) = state.fall_off
    centre = np.asarray(state.distortion.principal_point_mm)
    fitted = fall_off.deviation(np.hypot(*(grid_mm() - centre).T))
    for index, channel in enumerate("rgb"):
        stated = lens.illumination_standard_deviation(grid_mm(), channel)
        np.testing.assert_allclose(stated, fitted[index], rtol=1e-7, atol=1e-12)
        assert stated.max() > 0
