"""A smaller plate that lies where the plate lies; controls as the knobs are defined."""

import msgspec
import numpy as np
import pytest
from view_makers import thin_lens, write_depth_plate

from lensfit.coords import Window
from lensfit.io.exr import ExrImage, ExrPart
from lensfit.plate.apply_options import ApplyOptions
from lensfit.preset.knobs import GROUP_OF, NEUTRAL, Knobs
from lensfit.workflow.view.lens_adjustments import FILES, LensAdjustments, knob_controls
from lensfit.workflow.view.screen_picture import (
    MOST_PIXELS,
    proxy_factor,
    proxy_of,
    smaller_plates,
)
from lensfit.workflow.view.viewed_plate import ViewedPlate


def ramps(data: Window, display: Window) -> ExrImage:
    """A plate whose red and green say where a pixel is, from the display's corner."""
    x, y = np.moveaxis(data.pixel_centres(), -1, 0)
    x, y = x - display.x_min, y - display.y_min
    channels = {"R": x, "G": y, "B": 0 * x, "Z": x}
    planes = {name: plane.astype(np.float32) for name, plane in channels.items()}
    planes["id"] = np.arange(data.area, dtype=np.uint32).reshape(x.shape)
    return ExrImage((ExrPart(planes, data, display, {}),))


@pytest.mark.parametrize("factor", [2, 4])
@pytest.mark.parametrize(
    ("data", "display"),
    [
        (Window(0, 0, 95, 53), Window(0, 0, 95, 53)),
        (Window(-7, -5, 104, 60), Window(0, 0, 96, 54)),
        (Window(13, 9, 60, 40), Window(10, 5, 105, 58)),
    ],
)
def test_a_proxy_lies_where_its_plate_does(data: Window, display: Window, factor: int):
    found = proxy_of(ramps(data, display), factor)
    assert found is not None
    part = found.parts[0]
    assert part.display_window == Window.of_size(
        display.width // factor, display.height // factor
    )
    centres = factor * part.data_window.pixel_centres()
    np.testing.assert_allclose(part.channels["R"], centres[..., 0], atol=1e-4)
    np.testing.assert_allclose(part.channels["G"], centres[..., 1], atol=1e-4)
    assert np.abs(part.channels["Z"] - centres[..., 0]).max() <= 0.5
    assert part.channels["id"].dtype == np.uint32
    low = np.subtract(data[:2], display[:2])
    high = np.subtract(data[2:], display[:2]) + 1
    own = part.data_window
    assert (factor * np.array(own[:2]) >= low).all()
    assert (factor * (np.array(own[2:]) + 1) <= high).all()
    assert (factor * np.array(own[:2]) - low < factor).all()


def test_a_plate_smaller_than_a_block_has_no_proxy():
    window = Window.of_size(5, 2)
    assert proxy_of(ramps(window, window), 4) is None


def test_a_proxy_is_no_larger_than_is_quick():
    for size in ((96, 54), (960, 540), (1920, 1080), (3840, 2160)):
        window = Window.of_size(*size)
        factor = proxy_factor(window)
        assert window.area / factor**2 <= MOST_PIXELS
        assert factor == 1 or window.area / (factor / 2) ** 2 > MOST_PIXELS


@pytest.mark.parametrize(
    ("most_pixels", "sizes"),
    [(96 * 54, {}), (1500, {"proxy": 48}), (90, {"proxy": 12, "finer": 48})],
)
def test_between_a_proxy_and_a_large_plate_lies_a_finer_one(
    most_pixels: int, sizes: dict[str, int]
):
    window = Window.of_size(96, 54)
    found = smaller_plates(ramps(window, window), most_pixels)
    assert {q: p.parts[0].display_window.width for q, p in found.items()} == sizes


@pytest.mark.slow
def test_a_proxy_s_blur_is_the_frame_s(tmp_path):
    plate = write_depth_plate(tmp_path / "plate.exr", 640, 360)
    viewed = ViewedPlate(thin_lens(640, 360), str(plate), ApplyOptions())
    # Focus at infinity blurs by many pixels: what is left varies slowly.
    wanted = LensAdjustments(focus_distance_mm="inf")
    small, full = (viewed.pixels(wanted, q) for q in ("proxy", "full"))
    means = full.reshape(180, 2, 320, 2, 3).mean(axis=(1, 3))
    assert small.shape == means.shape
    assert np.sqrt(np.mean((small - means) ** 2)) < 1e-2


def test_every_knob_has_a_control_with_its_limits():
    groups = knob_controls()
    named = {k["name"]: (k, i) for i, g in enumerate(groups) for k in g["knobs"]}
    assert named.keys() == GROUP_OF.keys() - set(FILES)
    for name, (knob, _) in named.items():
        assert knob["text"], name
        assert knob["label"]
        neutral = getattr(getattr(NEUTRAL, GROUP_OF[name]), name)
        assert knob["neutral"] == neutral
        if neutral is not None:
            assert knob["least"] <= neutral <= knob["most"]
        if knob["slider"] is not None:
            low, high = knob["slider"]
            assert knob["least"] <= low <= neutral <= high <= knob["most"]


def test_knobs_that_name_files_are_all_known():
    schema = msgspec.json.schema(Knobs)["$defs"]
    texts = [
        name
        for record in schema.values()
        for name, one in record["properties"].items()
        if "string" in [kind.get("type") for kind in one.get("anyOf", [one])]
    ]
    assert tuple(texts) == FILES
