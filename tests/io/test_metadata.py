"""Header entries become a camera state, with units, sources and clear complaints."""

import math
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest

from lensfit.errors import ImageError
from lensfit.io.camera.header_entries import Alias
from lensfit.io.exr import read_exr
from lensfit.io.metadata import CameraState, HeaderWord, camera_state_from, camera_words

STANDARD = {
    "pinholeFocalLength": 40.3,
    "nominalFocalLength": 40.0,
    "aperture": 2.0,
    "focus": 1.5,
    "sensorOverallDimensions": np.array([36.7, 25.54], np.float32),
    "cameraModel": "ALEXA LF",
    "lensModel": "Signature 40",
    "lensSerialNumber": "42",
}
CG = {
    "lens/focal": 35.0,
    "lens/fstop": np.float32(1.4),
    "lens/focus": 4.0,
    "lens/aperture": 28.25,
    "lens/overscan": 10.0,
}


def test_standard_attributes():
    state = camera_state_from(STANDARD)
    assert state == CameraState(
        focal_length_mm=40.0,
        f_number=2.0,
        focus_distance_mm=1500.0,
        camera_model="ALEXA LF",
        lens_model="Signature 40",
        lens_serial="42",
        sources=state.sources,
    )
    # A lens is at what its ring shows; the pinhole's grows with focusing.
    assert state.sources["focal_length_mm"] == "nominalFocalLength"
    assert set(state.sources) == set(state.known())


def test_the_recorded_window_is_the_frame_and_the_whole_sensor_is_not():
    assert camera_state_from(STANDARD).sensor_width_mm is None
    box = (np.array([100, 50], np.int32), np.array([4195, 2209], np.int32))
    state = camera_state_from(
        STANDARD | {"sensorPhotositePitch": 8.25, "sensorAcquisitionRectangle": box}
    )
    assert state.sensor_width_mm == pytest.approx(4096 * 8.25e-3)
    assert state.sensor_height_mm == pytest.approx(2160 * 8.25e-3)


@pytest.mark.parametrize("prefix", ["", "exr/", "input/exr/", "main/"])
@pytest.mark.parametrize("as_text", [False, True])
def test_cg_attributes_with_any_prefix_as_number_or_text(prefix: str, as_text: bool):
    header = {prefix + k: f" {v:.7g} " if as_text else v for k, v in CG.items()}
    state = camera_state_from(header)
    # `lens/aperture` is a sensor size and never an f-number.
    assert state.known() == {
        "focal_length_mm": 35.0,
        "f_number": 1.4,
        "focus_distance_mm": 4000.0,
        "sensor_width_mm": 28.25,
        "overscan_percent": 10.0,
    }
    assert state.sources["f_number"] == f"{prefix}lens/fstop"


def test_a_renderers_own_aperture_is_not_the_standard_one():
    assert camera_state_from({"renderer/aperture": 36.0}) == CameraState()
    assert camera_state_from({"exr/aperture": 2.8}).f_number == 2.8


def test_nuke_camera_as_text():
    state = camera_state_from(
        {
            "exr/nuke/camera/focal": "50.0",
            "exr/nuke/camera/haperture": "24.576",
            "exr/nuke/camera/vaperture": "18.672",
        }
    )
    assert (state.focal_length_mm, state.sensor_height_mm) == (50.0, 18.672)


def test_infinite_focus_and_no_overscan_are_allowed():
    state = camera_state_from({"focus": math.inf, "lens/overscan": 0.0})
    assert (state.focus_distance_mm, state.overscan_percent) == (math.inf, 0.0)
    assert camera_state_from({"focus": "inf"}).focus_distance_mm == math.inf


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("lens/focal", "wide"),
        ("lens/focal", math.nan),
        ("lens/focal", math.inf),
        ("aperture", 0.0),
        ("focus", -2.0),
        ("lens/overscan", -1.0),
        ("pinholeFocalLength", [1.0, 2.0]),
        ("lens/focal", 10**400),
    ],
)
def test_impossible_values_are_named(key: str, value: object):
    with pytest.raises(ImageError, match=f"'{key}'") as caught:
        camera_state_from({key: value})
    assert "\n" not in str(caught.value)


def test_exif():
    header = {
        "FocalLength": Fraction(85, 10),
        "FNumber": Fraction(28, 10),
        "SubjectDistance": 0.0,
        "Model": "HERO8 Black\0\0\0\0",
        "LensModel": "",
    }
    state = camera_state_from(header, (4000, 3000))
    assert state.known() == {
        "focal_length_mm": 8.5,
        "f_number": 2.8,
        "camera_model": "HERO8 Black",
    }
    infinity = camera_state_from({"SubjectDistance": 2**32 - 1})
    assert infinity.focus_distance_mm == math.inf


def test_exif_sensor_from_35mm_equivalent_keeps_the_diagonal():
    header = {"FocalLength": 4.0, "FocalLengthIn35mmFilm": 24}
    state = camera_state_from(header, (4000, 3000))
    assert state.sensor_width_mm is not None
    assert state.sensor_height_mm is not None
    diagonal = math.hypot(state.sensor_width_mm, state.sensor_height_mm)
    assert diagonal / 4.0 == pytest.approx(math.hypot(36, 24) / 24, rel=1e-3)
    assert state.sensor_width_mm / state.sensor_height_mm == pytest.approx(4 / 3, 1e-3)


def test_exif_resolution_on_the_sensor_beats_the_equivalent():
    header = {
        "FocalLength": 50.0,
        "FocalLengthIn35mmFilm": 75,
        "FocalPlaneXResolution": Fraction(5184 * 10, 223),
        "FocalPlaneYResolution": Fraction(3456 * 10, 149),
        "FocalPlaneResolutionUnit": 4,
        "ExifImageWidth": 5184,
        "ExifImageHeight": 3456,
    }
    # The picture was scaled down after the camera wrote its header.
    state = camera_state_from(header, (1296, 864))
    assert state.sensor_width_mm == pytest.approx(22.3, 1e-5)
    assert state.sensor_height_mm == pytest.approx(14.9, 1e-5)
    # The camera was held upright: its picture is turned, and so is its sensor.
    turned = camera_state_from(header | {"Orientation": 6}, (864, 1296))
    assert turned.sensor_width_mm == pytest.approx(14.9, 1e-5)


def test_every_entry_of_a_quantity_is_told_the_best_first():
    words = camera_words(STANDARD | CG | {"exr/lens/focal": "28"})
    assert words["focal_length_mm"] == [
        HeaderWord(40.0, "nominalFocalLength"),
        HeaderWord(35.0, "lens/focal"),
        HeaderWord(28.0, "exr/lens/focal"),
        HeaderWord(40.3, "pinholeFocalLength", of_pinhole=True),
    ]
    recorded = "sensorPhotositePitch x sensorAcquisitionRectangle"
    photosites = {
        "sensorPhotositePitch": 10.0,
        "sensorAcquisitionRectangle": ((0, 0), (3669, 2553)),
    }
    header = STANDARD | CG | photosites
    assert camera_words(header)["sensor_width_mm"] == [
        HeaderWord(36.7, recorded),
        HeaderWord(28.25, "lens/aperture"),
    ]
    own = {"sensor_width_mm": (Alias("lens/aperture"),)}
    chosen = camera_words(header, None, own)
    assert [w.entry for w in chosen["sensor_width_mm"]] == ["lens/aperture", recorded]
    # The height of a sensor whose width does not count belongs to no other width.
    assert "sensor_height_mm" not in chosen


def test_an_impossible_entry_behind_a_good_one_does_not_count():
    header: dict[str, object] = {"aperture": 2.0, "lens/fstop": "wide"}
    assert camera_state_from(header).f_number == 2
    header["lens/aperture"] = "big"
    good, bad = camera_words(header)["f_number"]
    assert good == HeaderWord(2.0, "aperture")
    assert isinstance(bad.value, ImageError)
    with pytest.raises(ImageError, match="lens/aperture"):
        camera_state_from(header)


def test_real_plate(data_dir: Path):
    plate = read_exr(data_dir / "plates" / "plate.0001.exr", header_only=True)
    # camera.json beside it: 35 mm, f/1.4, focus 4 m, sensor 28.25 mm, 10 % overscan.
    assert camera_state_from(plate.parts[0].attributes).known() == {
        "focal_length_mm": 35.0,
        "f_number": 1.4,
        "focus_distance_mm": 4000.0,
        "sensor_width_mm": 28.25,
        "overscan_percent": 10.0,
    }
