"""OpenLensIO's formulas and OpenTrackIO's files, with their traps."""

import json
import math
from pathlib import Path

import numpy as np
import pytest

from lensfit.errors import ExchangeError
from lensfit.exchange.brown_conrady import D_U, U_D, BrownMap, brown_conrady
from lensfit.exchange.foreign import StatedValues
from lensfit.exchange.opencv import OpenCvMap
from lensfit.exchange.opentrackio import (
    ColourShift,
    LensSample,
    opentrackio_text,
    read_opentrackio,
)
from lensfit.exchange.opentrackio_lens import lens_of_opentrackio

RADIAL = (1.1e-3, 2e-4, -3e-6, 1e-6, 4e-9, -2e-9)
TANGENTIAL = (1e-5, -2e-5)


def make_sample(**changes) -> LensSample:
    known = dict(
        name="Fifty",
        sensor_size_mm=(24.0, 18.0),
        size_px=(2048, 1536),
        distortions=(BrownMap(D_U, RADIAL, TANGENTIAL, (0.3, -0.1), 15.0),),
        projection_offset_mm=(0.2, -0.1),
        pinhole_focal_length_mm=51.3,
        nominal_focal_length_mm=50.0,
        focus_distance_mm=2500.0,
        f_number=1.4,
        entrance_pupil_offset_mm=60.0,
        falloff=(1e-3, 2e-6, -1e-9),
        overscan=1.05,
        history=("lensfit",),
    )
    return LensSample(**(known | changes))


def test_the_formula_number_by_number():
    x, y = 3.0, -4.0
    r2 = 25.0
    k1, k2, k3, k4, k5, k6 = RADIAL
    above = 1 + k1 * r2 + k3 * r2**2 + k5 * r2**3
    below = 1 + k2 * r2 + k4 * r2**2 + k6 * r2**3
    p1, p2 = TANGENTIAL
    known = (
        above / below * x + 2 * p1 * x * y + p2 * (r2 + 2 * x * x),
        above / below * y + 2 * p2 * x * y + p1 * (r2 + 2 * y * y),
    )
    found = brown_conrady(np.array([[x, y]]), RADIAL, TANGENTIAL)[0]
    assert found == pytest.approx(known, abs=1e-14)


@pytest.mark.parametrize("model", [D_U, U_D])
def test_both_directions_close(model: str):
    one = BrownMap(model, RADIAL, TANGENTIAL, (0.3, -0.1), 15.0)
    points = np.array([[0.3, -0.1], [11.0, -8.0], [-12.0, 9.0]])
    assert np.abs(one.distorted(one.undistorted(points)) - points).max() < 1e-9
    assert np.abs(one.undistorted(points[:1]) - points[:1]).max() < 1e-14


def test_an_opencv_camera_converted_by_hand_puts_pixels_in_the_same_place():
    """k by even powers of F, p by F alone (it is a length each, the published F^2 is
    wrong by its dimension), the projection offset with its half pixel."""
    k1, k2, p1, p2, k3, k4, k5, k6 = -0.2, 0.1, 1e-3, -2e-3, -0.03, 0.01, 0.02, -0.01
    matrix = np.array([[2000.0, 0, 1030.0], [0, 2000.0, 760.0], [0, 0, 1]])
    coefficients = np.zeros(14)
    coefficients[:8] = k1, k2, p1, p2, k3, k4, k5, k6
    width_mm, width_px = 24.0, 2048
    camera = OpenCvMap(matrix, coefficients, (width_px, 1536), width_mm / width_px)
    focal = width_mm / width_px * 2000.0
    offset = tuple(
        width_mm / width_px * (c + 0.5 - n / 2)
        for c, n in ((1030.0, 2048), (760.0, 1536))
    )
    radial = (
        k1 / focal**2, k4 / focal**2, k2 / focal**4,
        k5 / focal**4, k3 / focal**6, k6 / focal**6,
    )  # fmt: skip
    tangential = (p1 / focal, p2 / focal)
    converted = BrownMap(U_D, radial, tangential, offset, 15.0)
    points = np.array([[0.0, 0.0], [10.0, -7.0], [-11.0, 8.0]])
    apart = converted.distorted(points) - camera.distorted(points)
    assert np.abs(apart).max() / (width_mm / width_px) < 1e-9


def test_what_is_written_is_read(tmp_path: Path):
    shift = ColourShift(15.0, 1.2, (0.001, -0.002), (1e-4, 0.0), (0.0, 2e-5), (1e-4,))
    sample = make_sample(colour={"r": shift, "b": shift})
    path = tmp_path / "lens.json"
    path.write_text(opentrackio_text((sample,)))
    (found,) = read_opentrackio(path)
    assert found.distortions[0].radial == RADIAL
    assert found.distortions[0].tangential == TANGENTIAL
    assert found.distortions[0].centre_mm == pytest.approx((0.3, -0.1), abs=1e-15)
    assert found.projection_offset_mm == (0.2, -0.1)
    assert found.falloff == sample.falloff
    assert found.focus_distance_mm == pytest.approx(2500.0, rel=1e-15)
    assert found.entrance_pupil_offset_mm == pytest.approx(60.0, rel=1e-15)
    assert found.colour == sample.colour
    assert (found.name, found.f_number, found.size_px) == ("Fifty", 1.4, (2048, 1536))


def test_units_and_names_of_the_standard():
    table = json.loads(opentrackio_text((make_sample(),)))
    lens, static = table["lens"], table["static"]
    assert lens["entrancePupilOffset"] == 0.06
    assert lens["focusDistance"] == 2.5
    assert lens["distortionOffset"]["x"] == pytest.approx(0.1)
    assert lens["exposureFalloff"] == {"a1": 1e-3, "a2": 2e-6, "a3": -1e-9}
    assert lens["distortion"][0]["model"] == "Brown-Conrady D-U"
    assert lens["distortion"][0]["overscan"] == 1.05
    assert static["lens"]["nominalFocalLength"] == 50.0
    dimensions = static["camera"]["activeSensorPhysicalDimensions"]
    assert dimensions == {"height": 18.0, "width": 24.0}


@pytest.mark.parametrize("focus_mm", [math.inf, None, 731.25])
def test_a_focus_that_json_cannot_hold_comes_back(tmp_path: Path, focus_mm):
    path = tmp_path / "lens.json"
    path.write_text(opentrackio_text((make_sample(focus_distance_mm=focus_mm),)))
    found = read_opentrackio(path)[0].focus_distance_mm
    assert found == focus_mm or found == pytest.approx(focus_mm, rel=1e-14)


def test_the_default_model_leads_from_distorted_to_undistorted(tmp_path: Path):
    path = tmp_path / "lens.json"
    path.write_text(
        '{"lens": {"distortion": [{"radial": [1e-3]}], "pinholeFocalLength": 35}}'
    )
    (found,) = read_opentrackio(path)
    assert found.distortions[0].model == D_U
    with pytest.raises(ExchangeError, match="give --sensor-width-mm"):
        lens_of_opentrackio((found,), StatedValues(), path)
    lens = lens_of_opentrackio(
        (found,), StatedValues(sensor_width_mm=36.0, size_px=(3600, 2400)), path
    )
    assert lens.sensor_size_mm == (36.0, 24.0)
    assert lens.states[0].map.undistorted(np.array([[10.0, 0.0]]))[0, 0] == 11.0


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("{}", "states no pinholeFocalLength"),
        ("[]", "holds 0 samples"),
        ("3", "is no JSON object"),
        ('{"lens": []}', "lens is no JSON object"),
        ('{"lens": {"pinholeFocalLength": 0}}', "is not positive"),
        ('{"lens": {"pinholeFocalLength": "long"}}', "is no number"),
        ('{"lens": {"pinholeFocalLength": true}}', "is no number"),
        ('{"lens": {"pinholeFocalLength": NaN}}', "is not valid JSON"),
        ('{"lens": {"pinholeFocalLength": 1e999}}', "is not finite"),
        ('{"lens": {"pinholeFocalLength": 35}}', "no distortion of a model known"),
        (
            '{"lens": {"pinholeFocalLength": 35, "distortion": [{"radial": [1], '
            '"model": "Fisheye"}]}}',
            "no distortion of a model known",
        ),
        (
            '{"lens": {"pinholeFocalLength": 35, "distortion": [{"radial": '
            "[1,2,3,4,5,6,7]}]}}",
            "radial has 7 numbers",
        ),
        ("[" * 100_000, "is not valid JSON"),
        ('{"lens": {"pinholeFocalLength": ' + "9" * 5000 + "}}", "is not valid JSON"),
    ],
)
def test_what_cannot_be_is_one_sentence(tmp_path: Path, text: str, said: str):
    path = tmp_path / "lens.json"
    path.write_text(text)
    with pytest.raises(ExchangeError) as caught:
        read_opentrackio(path)
    assert said in str(caught.value)
    assert "\n" not in str(caught.value)
