"""Stated deviations of chief rays, lateral colour and fall-off against many draws."""

from dataclasses import replace

import msgspec
import numpy as np
import pytest
from known_entries import NAMES, POINTS, covariance_of, known_entry, lens_of
from preset_makers import make_entry

from lensfit.lens import Lens
from lensfit.preset.blocks import Covariance
from lensfit.preset.entry import Entry

DRAWS = 300


def draws_of(covariance: Covariance, seed: int = 5) -> list[dict[str, float]]:
    rng = np.random.default_rng(seed)
    zero = np.zeros(len(covariance.parameters))
    drawn = rng.multivariate_normal(zero, covariance.matrix(), DRAWS)
    return [dict(zip(covariance.parameters, row, strict=True)) for row in drawn]


def added(values: tuple[float, ...], name: str, step: dict[str, float]):
    return tuple(v + step.get(f"{name}[{k}]", 0.0) for k, v in enumerate(values))


def drawn_entry(entry: Entry, step: dict[str, float]) -> Entry:
    """With the numbers of projection and distortion moved, by the schema's meaning."""
    p, d = entry.projection, entry.distortion
    assert d.field is not None
    reference = d.reference_radius_mm
    e = np.log(d.squeeze) * np.array(
        [np.cos(2 * d.squeeze_axis_rad), np.sin(2 * d.squeeze_axis_rad)]
    )
    e += [step["squeeze[0]"], step["squeeze[1]"]]
    moved = added((*d.field.x, *d.field.y), "free_field", step)
    half = len(d.field.x)
    projection = msgspec.structs.replace(
        p,
        principal_distance_mm=p.principal_distance_mm
        * float(np.exp(step["focal_length[0]"])),
        principal_point_mm=tuple(
            v + reference * step[f"principal_point[{k}]"]
            for k, v in enumerate(p.principal_point_mm)
        ),
    )
    distortion = msgspec.structs.replace(
        d,
        radial_log_slope=added(d.radial_log_slope, "radial", step),
        decentering=added(d.decentering, "decentering", step),
        squeeze=float(np.exp(np.hypot(*e))),
        squeeze_axis_rad=float(np.arctan2(e[1], e[0]) / 2),
        field=msgspec.structs.replace(d.field, x=moved[:half], y=moved[half:]),
    )
    return msgspec.structs.replace(entry, projection=projection, distortion=distortion)


def frame_of(lens: Lens) -> np.ndarray:
    """Points of the undistorted picture that cover the frame."""
    half_x, half_y = np.array(lens.sensor_size_mm) / 2
    x, y = np.linspace(-half_x, half_x, 25), np.linspace(-half_y, half_y, 17)
    seen = np.stack(np.meshgrid(x, y), -1).reshape(-1, 2)
    return np.asarray(lens.undistorted_from_distorted(seen))


def pose_changes(lens: Lens, points: np.ndarray) -> np.ndarray:
    """What each of the eight small homographies does, by a difference."""
    step = 1e-6
    columns = []
    for k in range(8):
        small = np.zeros(9)
        small[k] = step if k < 6 else 0.01 * step
        matrix = np.eye(3) + small.reshape(3, 3)
        there = np.c_[points, np.ones(len(points))] @ matrix.T
        moved = lens.distorted_from_undistorted(there[:, :2] / there[:, 2:])
        still = lens.distorted_from_undistorted(points)
        columns.append(np.asarray(moved - still).ravel() / step)
    return np.stack(columns, -1)


@pytest.mark.slow
def test_positions_scatter_as_stated_but_for_the_pose():
    entry = known_entry()
    lens = lens_of(entry)
    every = np.concatenate([frame_of(lens), POINTS])
    pose = pose_changes(lens, every)
    count = 2 * (len(every) - len(POINTS))
    still = np.asarray(lens.distorted_from_undistorted(every)).ravel()
    found = []
    for step in draws_of(entry.covariance or covariance_of((), 0, 0)):
        drawn = lens_of(drawn_entry(entry, step))
        away = np.asarray(drawn.distorted_from_undistorted(every)).ravel() - still
        undone = np.linalg.lstsq(pose[:count], away[:count], rcond=1e-10)[0]
        found.append((away - pose @ undone)[count:].reshape(-1, 2))
    scatter = np.sqrt(np.mean(np.square(found), 0))
    stated = lens.position_standard_deviation_mm(POINTS)
    np.testing.assert_allclose(scatter, stated, rtol=4 / np.sqrt(2 * DRAWS))


def test_what_a_pose_would_undo_is_no_deviation():
    """A rectilinear lens without distortion: its focal length is the camera's distance,
    its principal point the camera's direction."""
    entry = known_entry(
        covariance=covariance_of(NAMES[:3], 1e-3, 0),
        distortion=msgspec.structs.replace(
            make_entry().distortion,
            radial_log_slope=(),
            decentering=(),
            field=None,
            squeeze=1.0,
        ),
    )
    assert lens_of(entry).position_standard_deviation_mm(POINTS).max() < 1e-12


def test_lateral_colour_scatters_as_stated():
    entry = known_entry()
    lens, colour = lens_of(entry), entry.lateral_colour
    assert colour is not None
    assert colour.covariance is not None
    found = []
    for step in draws_of(colour.covariance.r):
        red = msgspec.structs.replace(
            colour.r,
            shift_mm=added(colour.r.shift_mm, "shift_mm", step),
            radial=added(colour.r.radial, "radial", step),
        )
        drawn = lens_of(
            msgspec.structs.replace(
                entry, lateral_colour=msgspec.structs.replace(colour, r=red)
            )
        )
        straight = drawn.undistorted_from_distorted(POINTS)
        found.append(drawn.distorted_from_undistorted(straight, "r"))
    scatter = np.std(found, 0)
    stated = lens.lateral_colour_standard_deviation_mm(POINTS, "r")
    np.testing.assert_allclose(scatter, stated, rtol=4 / np.sqrt(2 * DRAWS))
    assert not lens.lateral_colour_standard_deviation_mm(POINTS, "g").any()


def test_illumination_scatters_as_stated_and_is_one_on_the_axis():
    entry = known_entry()
    lens, light = lens_of(entry), entry.fall_off[0]
    assert light.covariance is not None
    found = []
    for step in draws_of(light.covariance.r):
        moved = msgspec.structs.replace(light, r=added(light.r, "r", step))
        drawn = lens_of(msgspec.structs.replace(entry, fall_off=(moved,)))
        found.append(drawn.relative_illumination(POINTS, "r"))
    stated = lens.illumination_standard_deviation(POINTS, "r")
    np.testing.assert_allclose(np.std(found, 0), stated, rtol=4 / np.sqrt(2 * DRAWS))
    axis = np.asarray(lens.distortion.principal_point_mm)[None]
    assert not lens.illumination_standard_deviation(axis, "r").any()


def test_beyond_what_was_photographed_colour_is_known_as_at_its_edge():
    lens = lens_of(known_entry())
    stated = lens.lateral_colour_standard_deviation_mm(beyond(lens), "r")
    np.testing.assert_allclose(stated[1:], stated[:1].repeat(2, 0), rtol=1e-9)


def test_light_that_goes_on_with_its_last_slope_is_known_ever_less():
    entry = known_entry()
    lens, light = lens_of(entry), entry.fall_off[0]
    points = beyond(lens)
    stated = lens.illumination_standard_deviation(points, "b")
    share = stated / np.asarray(lens.relative_illumination(points, "b"))
    assert np.all(np.diff(share) > 0)
    assert light.covariance is not None
    of_light = []
    for step in draws_of(light.covariance.b):
        moved = msgspec.structs.replace(light, b=added(light.b, "b", step))
        drawn = lens_of(msgspec.structs.replace(entry, fall_off=(moved,)))
        of_light.append(np.log(np.asarray(drawn.relative_illumination(points, "b"))))
    rtol = 4 / np.sqrt(2 * DRAWS)
    np.testing.assert_allclose(np.std(of_light, 0), share, rtol=rtol)


def beyond(lens) -> np.ndarray:
    """Points beyond the largest radius of every map, one at its edge."""
    centre = np.asarray(lens.distortion.principal_point_mm)
    return centre + np.array([15.95, 20.0, 40.0])[:, None] * np.array([0.8, 0.6])


def test_red_and_blue_add_their_own_deviation():
    lens = lens_of(known_entry())
    green = lens.position_standard_deviation_mm(POINTS)
    landed = lens.distorted_from_undistorted(POINTS)
    own = lens.lateral_colour_standard_deviation_mm(landed, "r")
    red = lens.position_standard_deviation_mm(POINTS, "r")
    np.testing.assert_allclose(red**2, green**2 + own**2, rtol=1e-12)


def test_no_points_have_no_deviations():
    lens, none = lens_of(known_entry()), np.zeros((0, 2))
    assert lens.position_standard_deviation_mm(none).shape == (0, 2)
    assert lens.lateral_colour_standard_deviation_mm(none, "b").shape == (0, 2)
    assert lens.illumination_standard_deviation(none).shape == (0,)


def test_a_lens_can_be_copied_with_its_deviations():
    lens = lens_of(known_entry())
    copy = replace(lens, notes=("a note",))
    np.testing.assert_array_equal(
        copy.position_standard_deviation_mm(POINTS),
        lens.position_standard_deviation_mm(POINTS),
    )
