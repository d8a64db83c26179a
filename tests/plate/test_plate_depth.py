"""The depth of a plate: options before header before a noted assumption."""

from typing import Any

import numpy as np
import pytest

from lensfit.coords import Window
from lensfit.errors import ImageError
from lensfit.io.exr import ExrImage, ExrPart
from lensfit.plate.plate_depth import DepthOptions, plate_depth
from lensfit.rendering.uv import PlateGeometry

DISPLAY = Window.of_size(36, 20)
DATA = DISPLAY.grown(4, 2)
GEOMETRY = PlateGeometry(DISPLAY, (36.0, 20.0))


def plate(value=2.0, **attributes):
    z = np.full((DATA.height, DATA.width), value, np.float32)
    header = {k.replace("__", "/"): v for k, v in attributes.items()}
    return ExrImage((ExrPart({"R": z * 0, "Z": z}, DATA, DISPLAY, header),))


def read(image, **options):
    found = plate_depth(image, image.parts[0], DepthOptions(**options), GEOMETRY, 35.0)
    return found.depth_mm, found.notes


def test_metres_along_the_axis_are_assumed_and_told():
    depth, (note,) = read(plate())
    assert (depth == 2000).all()
    assert "metres" in note
    assert "optical axis" in note


@pytest.mark.parametrize(
    ("header", "options", "distance_mm"),
    [
        ({"depth__unit": "cm"}, {}, 20),
        ({"renderer__depth__unit": "ft"}, {}, 609.6),
        ({"metersPerUnit": 0.01}, {}, 20),
        ({"depth__unit": "cm"}, {"unit": "in"}, 50.8),
        ({"depth__kind": "inverse", "depth__unit": "m"}, {}, 500),
        ({}, {"kind": "normalised", "near": -2.0, "far": 3.0, "unit": "m"}, np.inf),
    ],
)
def test_options_count_before_the_header(header, options, distance_mm):
    depth, _ = read(plate(**header), **options)
    assert depth == pytest.approx(distance_mm, rel=1e-6)


def test_nothing_is_noted_when_all_is_stated():
    assert read(plate(depth__unit="m"), kind="perpendicular")[1] == ()


def test_ray_distance_is_turned_with_the_camera_of_the_plate():
    depth, _ = read(plate(), kind="ray", unit="m")
    corner = np.hypot(17.5 + 4, 9.5 + 2)  # mm from the centre, overscan included
    assert depth[0, 0] == pytest.approx(2000 * 35 / np.hypot(35, corner), rel=1e-6)
    assert depth[11, 21] == pytest.approx(2000, rel=1e-3)


def test_missing_depth_is_filled_and_told():
    image = plate()
    image.parts[0].channels["Z"][3, 4] = np.nan
    depth, notes = read(image)
    assert (depth == 2000).all()
    assert any("NaN" in note for note in notes)


def test_a_plate_without_depth_is_an_error():
    flat = ExrImage((ExrPart({"R": np.zeros((20, 36), np.float32)}, DISPLAY, DISPLAY),))
    with pytest.raises(ImageError, match=r"no depth .*--no-defocus"):
        read(flat)
    with pytest.raises(ImageError, match="no channel 'far'"):
        read(flat, channel="far")


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"kind": "normalised"}, "--depth-near"),
        ({"kind": "sideways"}, r"no kind of depth \(--depth-kind\)"),
        ({"unit": "yard"}, r"no unit of depth \(--depth-unit\)"),
    ],
)
def test_what_makes_no_sense_is_told(options, words):
    with pytest.raises(ImageError, match=words):
        read(plate(), **options)


@pytest.mark.parametrize(("entry", "what"), [("unit", "unit"), ("kind", "kind")])
def test_a_header_that_makes_no_sense_is_named(entry, what):
    header: dict[str, Any] = {f"depth__{entry}": "yonder"}
    with pytest.raises(ImageError, match=rf"no {what} of depth \(depth/{entry} of the"):
        read(plate(**header))


def test_a_kind_that_is_no_word_is_refused_in_a_line():
    header: dict[str, Any] = {"depth__kind": np.eye(3, dtype=np.float32)}
    with pytest.raises(ImageError, match="depth/kind of the header is no word") as told:
        read(plate(**header))
    assert "\n" not in str(told.value)


def test_depth_that_is_all_missing_is_sky_and_told():
    depth, notes = read(plate(value=np.nan))
    assert np.isposinf(depth).all()
    assert any("100 % of the depth" in n and "all is sky" in n for n in notes)


@pytest.mark.parametrize("value", [0.0, -1.0, 1e9])
def test_a_plate_of_sky_alone_is_told(value):
    depth, notes = read(plate(value=value))
    assert np.isposinf(depth).all()
    assert any("zero, negative, infinite" in n and "all is sky" in n for n in notes)
    image = plate(value=value)
    image.parts[0].channels["Z"][3, 4] = 2.0
    assert not any("all is sky" in n for n in read(image)[1])
