"""Shoot file and image header joined: who wins, what is noted, what is an error."""

import math
from pathlib import Path

import pytest

from lensfit.errors import ShootError
from lensfit.io.metadata import CameraState
from lensfit.workflow.shoot.resolve_take import resolve_take
from lensfit.workflow.shoot.shoot_records import Camera, LensName, Shoot, Take, Target

SIZE = (2048, 1536)


def resolve(take_keys: dict, camera_keys: dict | None = None, **header):
    """The resolved only take of a shoot with these keys."""
    take = Take(image="a.exr", target="dots", **take_keys)
    shoot = Shoot(
        path=Path("folder/shoot.toml"),
        lens=LensName("50"),
        camera=Camera(**(camera_keys or {"sensor_width_mm": 24.0})),
        targets={"dots": Target("dots", "dot-grid", 10.0)},
        takes=(take,),
    )
    return resolve_take(shoot, take, CameraState(**header), SIZE)


def test_the_header_fills_what_the_shoot_leaves_out():
    resolved = resolve({}, focal_length_mm=50.0, f_number=2.8, focus_distance_mm=900.0)
    assert resolved.focal_length_mm == 50.0
    assert resolved.f_number == 2.8
    assert resolved.focus_distance_mm == 900.0
    assert resolved.image_path == Path("folder/a.exr")
    assert resolved.notes == ()


def test_the_shoot_wins_and_a_disagreement_is_noted():
    keys = {"focal_length_mm": 50.0, "f_number": 2.8, "focus_distance_mm": math.inf}
    resolved = resolve(
        keys, focal_length_mm=50.5, f_number=4.0, focus_distance_mm=2000.0
    )
    assert resolved.f_number == 2.8
    assert resolved.focus_distance_mm == math.inf
    assert resolved.notes == (
        "f_number is 2.8 in the shoot file and 4 in the image header",
        "focus_distance_mm is inf in the shoot file and 2000 in the image header",
    )


def test_far_focus_is_compared_as_a_lens_feels_it():
    resolved = resolve(
        {"focal_length_mm": 50.0, "focus_distance_mm": math.inf},
        focus_distance_mm=65535000.0,
    )
    assert resolved.notes == ()


def test_square_photosites_give_the_height():
    assert resolve({"focal_length_mm": 50.0}).sensor_size_mm == (24.0, 18.0)


def test_a_header_height_never_joins_a_stated_width():
    # A stated width is of the recorded window, a header's size perhaps of the chip.
    resolved = resolve(
        {"focal_length_mm": 50.0}, sensor_width_mm=24.1, sensor_height_mm=30.0
    )
    assert resolved.sensor_size_mm == (24.0, 18.0)


def test_photosites_that_are_not_square_are_noted():
    camera = {"sensor_width_mm": 24.0, "sensor_height_mm": 20.0}
    resolved = resolve({"focal_length_mm": 50.0}, camera)
    assert resolved.sensor_size_mm == (24.0, 20.0)
    assert "photosites are not square" in resolved.notes[0]


def test_what_nobody_knows_is_asked_for():
    with pytest.raises(ShootError, match=r"a.exr: neither .* knows the focal length"):
        resolve({})
    with pytest.raises(ShootError, match="add sensor_width_mm to"):
        resolve({"focal_length_mm": 50.0}, {"model": "x"})


def test_a_focal_length_that_cannot_be_on_the_headers_sensor_is_refused():
    with pytest.raises(ShootError, match=r"a.exr: .*too short.* in millimetres"):
        resolve({"focal_length_mm": 0.05}, {"model": "X"}, sensor_width_mm=36.0)


def test_a_roi_beyond_the_photograph_is_refused():
    keys = {"focal_length_mm": 50.0, "roi": (0, 0, 2048, 1537)}
    with pytest.raises(ShootError, match="beyond the photograph of 2048 x 1536"):
        resolve(keys)
    resolve(keys | {"roi": (0, 0, 2048, 1536)})


def test_a_sensor_that_has_no_such_photograph_is_refused():
    camera = {"sensor_width_mm": 28.0, "sensor_height_mm": 2160.0}
    with pytest.raises(ShootError, match="28 x 2160 mm has no photographs of 2048"):
        resolve({"focal_length_mm": 50.0}, camera)
