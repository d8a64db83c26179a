"""lensfun: radii and centre term as its manual has them, and its files."""

import math
from pathlib import Path

import numpy as np
import pytest

from lensfit.errors import ExchangeError
from lensfit.exchange.foreign import StatedValues
from lensfit.exchange.lensfun import (
    LensfunMap,
    ptlens_terms,
    sensor_of_crop,
    tca_channel,
    unit_terms,
    vignetting,
)
from lensfit.exchange.lensfun_lens import lens_of_lensfun
from lensfit.exchange.lensfun_xml import (
    LensfunDistortion,
    LensfunLens,
    LensfunTca,
    LensfunVignetting,
    lensfun_text,
    read_lensfun,
)

TERMS = {"poly3": (-0.03,), "poly5": (-0.02, 0.004), "ptlens": (0.01, -0.03, 0.015)}
HALF_SHORT_MM = 12.0

DATABASE = """<?xml version="1.0"?>
<!DOCTYPE lensdatabase SYSTEM "lensfun-database.dtd">
<lensdatabase version="2">
  <camera><maker>Nikon</maker><model>D850</model><mount>Nikon F</mount>
    <cropfactor>1.005</cropfactor></camera>
  <lens>
    <maker>Nikon</maker><maker lang="de">Nikon AG</maker>
    <model>Nikkor 24-70mm f/2.8</model><mount>Nikon F</mount>
    <cropfactor>1.0</cropfactor>
    <calibration>
      <distortion model="ptlens" focal="24" a="0.01" b="-0.03" c="0.015"/>
      <distortion model="poly3" focal="70" k1="0.005"/>
      <distortion model="acm" focal="35" k1="0.005"/>
      <tca model="linear" focal="24" kr="1.0003" kb="0.9996"/>
      <vignetting model="pa" focal="24" aperture="2.8" distance="10"
        k1="-0.5" k2="0.1" k3="-0.05"/>
      <vignetting model="pa" focal="24" aperture="2.8" distance="0.4"
        k1="-0.4" k2="0.1" k3="-0.05"/>
    </calibration>
  </lens>
  <lens><maker>Nikon</maker><model>Fisheye</model><mount>Nikon F</mount>
    <type>fisheye</type><cropfactor>1</cropfactor>
    <calibration><distortion model="poly3" focal="16" k1="0.1"/></calibration></lens>
</lensdatabase>
"""


@pytest.fixture
def database(tmp_path: Path) -> Path:
    path = tmp_path / "slr.xml"
    path.write_text(DATABASE)
    return path


@pytest.mark.parametrize("model", list(TERMS))
def test_distortion_after_the_manual(model):
    """d = f(U) with U in the model's own, magnified picture; ours is U times D."""
    terms, scaled = TERMS[model], 0.7
    if model == "poly3":
        centre, distorted = 1 - terms[0], scaled * (1 - terms[0] + terms[0] * scaled**2)
    elif model == "poly5":
        centre = 1.0
        distorted = scaled * (1 + terms[0] * scaled**2 + terms[1] * scaled**4)
    else:
        a, b, c = terms
        centre = 1 - a - b - c
        distorted = scaled * (a * scaled**3 + b * scaled**2 + c * scaled + centre)
    lens = LensfunMap(model, terms, HALF_SHORT_MM, (0.2, -0.1))
    undistorted = scaled * centre * HALF_SHORT_MM
    landed = lens.distorted(
        np.array([[0.2 + 0.6 * undistorted, 0.8 * undistorted - 0.1]])
    )
    known = distorted * HALF_SHORT_MM * np.array([0.6, 0.8]) + [0.2, -0.1]
    assert landed[0] == pytest.approx(known, abs=1e-13)
    assert np.abs(lens.undistorted(lens.distorted(landed)) - landed).max() < 1e-9


def test_ptlens_terms_are_found_again():
    found = ptlens_terms(unit_terms("ptlens", TERMS["ptlens"]))
    assert found == pytest.approx(TERMS["ptlens"], abs=1e-14)
    with pytest.raises(ValueError, match="too strong"):
        ptlens_terms(np.array([0.0, -40.0, 0.0, 0.0]))


def test_one_is_the_half_short_side_and_for_vignetting_the_corner():
    assert sensor_of_crop(1.0, 1.5) == pytest.approx((36.0, 24.0))
    edge = np.array([[0.0, 12.0]])
    corner = np.array([[18.0, -12.0]])
    moved = tca_channel(edge, (1.001, 0.002, -0.0005), 12.0, (0.0, 0.0))
    assert moved[0, 1] == pytest.approx(12.0 * 1.0025)
    light = vignetting(corner, (-0.5, 0.1, -0.05), math.hypot(18, 12), (0.0, 0.0))
    assert light[0] == pytest.approx(1 - 0.5 + 0.1 - 0.05)


def test_what_is_written_is_read(tmp_path: Path):
    lens = LensfunLens(
        maker="lensfit",
        model='Angle <50> "mm" & more',
        crop_factor=1.2361890087305107,
        aspect_ratio=4 / 3,
        distortions=(
            LensfunDistortion(24.0, "ptlens", TERMS["ptlens"]),
            LensfunDistortion(70.0, "poly5", TERMS["poly5"], 71.5),
        ),
        tcas=(LensfunTca(24.0, (1.0003, 1e-5, 2e-6), (0.9996, 0.0, -1e-5)),),
        vignettings=(LensfunVignetting(24.0, 2.8, 1000.0, (-0.5, 0.1, -0.05)),),
        centre=(0.01, -0.02),
    )
    path = tmp_path / "lens.xml"
    path.write_text(lensfun_text(lens, ("rms 0.1 px -- worst <1 px --",)))
    assert read_lensfun(path).lenses == (lens,)


def test_a_lens_is_chosen_by_part_of_its_name(database: Path):
    found = lens_of_lensfun(
        read_lensfun(database), StatedValues(lens="24-70"), database
    )
    assert found.name == "Nikon Nikkor 24-70mm f/2.8".replace(
        "Nikon Nikkor", "Nikon Nikkor"
    )
    assert [s.focal_length_mm for s in found.states] == [24.0, 70.0]
    assert found.sensor_size_mm == pytest.approx((36.0, 24.0))
    assert found.states[0].principal_distance_mm == pytest.approx(
        24 * (1 - 0.01 + 0.015)
    )
    green = np.array([[10.0, 5.0]])
    assert found.states[0].channels["r"](green) == pytest.approx(green * 1.0003)
    # the vignetting of the farthest focus
    (light,) = found.states[0].fall_off
    assert light.illumination(np.array([[18.0, 12.0]]))[0] == pytest.approx(0.55)


def test_camera_focal_length_and_focus_choose(database: Path):
    found = lens_of_lensfun(
        read_lensfun(database),
        StatedValues(lens="24-70", focal_length_mm=24.0, focus_distance_mm=400.0),
        database,
        camera="d850",
    )
    assert found.sensor_size_mm[0] == pytest.approx(36.0 / 1.005)
    (state,) = found.states
    (light,) = state.fall_off
    assert light.illumination(np.array([[18.0, 12.0]]))[0] == pytest.approx(0.65)


@pytest.mark.parametrize(
    ("stated", "camera", "said"),
    [
        (StatedValues(), None, "holds several: Nikon Nikkor"),
        (StatedValues(lens="Zeiss"), None, "holds no lens 'Zeiss'"),
        (StatedValues(lens="Fisheye"), None, "only rectilinear ones are read"),
        (StatedValues(lens="24-70"), "Canon", "holds no camera 'Canon'"),
        (
            StatedValues(lens="24-70", focal_length_mm=50.0),
            None,
            "no distortion at 50 mm",
        ),
    ],
)
def test_what_is_not_there_is_said(database: Path, stated, camera, said: str):
    with pytest.raises(ExchangeError) as caught:
        lens_of_lensfun(read_lensfun(database), stated, database, camera)
    assert said in str(caught.value)


@pytest.mark.parametrize(
    ("changed", "to", "said"),
    [
        ("lensdatabase", "opencv_storage", "begins with <opencv_storage>"),
        ('k1="0.005"', 'k1="nan"', "is not finite"),
        ('k1="0.005"', 'k1="1e30"', "is out of range"),
        ('k1="0.005"', 'k1="abc"', "is no number"),
        ('k1="0.005"', 'k1="1"', "leaves no picture"),
        ('focal="24"', 'focal="0"', "is not positive"),
        ("<cropfactor>1.0<", "<cropfactor>x<", "is no number"),
        ("</lensdatabase>", "", "is no XML"),
    ],
)
def test_a_malformed_database_is_one_sentence(
    database: Path, changed: str, to: str, said: str
):
    database.write_text(DATABASE.replace(changed, to))
    with pytest.raises(ExchangeError) as caught:
        read_lensfun(database)
    assert said in str(caught.value)
