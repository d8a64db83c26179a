"""Pictures through OpenColorIO are those that its own processor makes."""

from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from view_makers import Answer, Client, thin_lens

from lensfit.plate.apply_options import ApplyOptions
from lensfit.workflow.view import screen_picture
from lensfit.workflow.view.lens_adjustments import LensAdjustments
from lensfit.workflow.view.screen_picture import (
    ENVIRONMENT,
    SCENE_LINEAR,
    ViewTransform,
    config_choices,
    config_names,
    view_codes,
)
from lensfit.workflow.view.viewed_plate import ViewedPlate

ocio = pytest.importorskip("PyOpenColorIO")
CONFIG = "ocio://cg-config-v1.0.0_aces-v1.3_ocio-v2.1"
BAD = "ocio_profile_version: 2\ndisplays: [nothing\n"


@pytest.fixture(autouse=True)
def _no_config(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("OCIO", raising=False)


def shown(answer: Answer) -> np.ndarray:
    assert answer.status == 200, answer.content
    return cv2.imdecode(np.frombuffer(answer.content, np.uint8), 1)[..., ::-1]


def by_opencolorio(
    light: np.ndarray, display: str, view: str, space: str = SCENE_LINEAR
) -> np.ndarray:
    """The same by a transform of its own, in its own 8 bits."""
    wanted = ocio.DisplayViewTransform(src=space, display=display, view=view)
    processor = ocio.Config.CreateFromFile(CONFIG).getProcessor(wanted)
    cpu = processor.getOptimizedCPUProcessor(
        ocio.BIT_DEPTH_F32, ocio.BIT_DEPTH_UINT8, ocio.OPTIMIZATION_LOSSLESS
    )
    height, width = light.shape[:2]
    made = np.empty(light.shape, np.uint8)
    cpu.apply(
        ocio.PackedImageDesc(np.ascontiguousarray(light), width, height, 3),
        ocio.PackedImageDesc(
            made, width, height, 3, ocio.BIT_DEPTH_UINT8, 1, 3, 3 * width
        ),
    )
    return made


def test_pictures_are_those_of_opencolorio_s_processor(client: Client, plate: Path):
    viewed = ViewedPlate(thin_lens(), str(plate), ApplyOptions())
    light = 2 * viewed.pixels(LensAdjustments(f_number=4.0), "full")
    offered = config_choices(CONFIG)
    for display, views in offered["displays"].items():
        for view in views:
            wanted = {"config": CONFIG, "display": display, "view": view}
            answer = client.post("render", f_number=4.0, exposure_stops=1, view=wanted)
            away = shown(answer).astype(int) - by_opencolorio(light, display, view)
            assert np.abs(away).max() <= 1, (display, view)
    space = "Linear Rec.709 (sRGB)"
    assert space in offered["spaces"]
    rec_709 = {"config": CONFIG, "space": space}
    answer = client.post("plate", view=rec_709)
    display, (view, *_) = next(iter(offered["displays"].items()))
    wanted = by_opencolorio(viewed.plate_pixels(0), display, view, space)
    assert np.abs(shown(answer).astype(int) - wanted).max() <= 1
    other = shown(client.post("plate", view={"config": CONFIG}))
    assert np.abs(other.astype(int) - wanted).max() > 1


def test_a_config_offers_what_opencolorio_says_is_in_it(client: Client):
    offered = client.post("view", config=CONFIG).json()
    config = ocio.Config.CreateFromFile(CONFIG)
    assert set(offered["displays"]) == set(config.getDisplays())
    first = config.getDefaultDisplay()
    assert next(iter(offered["displays"])) == first
    for display, views in offered["displays"].items():
        assert set(views) == set(config.getViews(display))
        assert views[0] == config.getDefaultView(display)
    assert offered["spaces"][0] == "ACEScg"
    assert CONFIG in client.get("api/lens").json()["configs"]


def test_light_without_end_has_a_colour():
    light = np.array([[[np.nan, np.inf, -np.inf], [0.18, 0.18, 0.18]]], np.float32)
    codes = view_codes(light, ViewTransform(CONFIG))
    assert (codes[0, 1] > 60).all()
    assert codes.shape == light.shape
    assert np.isnan(light[0, 0, 0])  # what was given stays


def refusal(answer: Answer) -> str:
    assert answer.status == 422
    said = answer.json()["error"]
    assert "\n" not in said
    assert "Traceback" not in said
    return said


def test_the_environment_s_config_comes_first_and_a_bad_one_is_a_sentence(
    client: Client, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    path = tmp_path / "studio.ocio"
    path.write_text(ocio.Config.CreateFromFile(CONFIG).serialize())
    monkeypatch.setenv("OCIO", str(path))
    lens = client.get("api/lens").json()
    assert lens["config"] == lens["configs"][0] == ENVIRONMENT
    own, built_in = (
        shown(client.post("plate", view={"config": name}))
        for name in (ENVIRONMENT, CONFIG)
    )
    np.testing.assert_array_equal(own, built_in)
    for bad in (BAD, "\0" * 99, "", "ocio_profile_version: 9\n"):
        path.write_text(bad)  # seen at once
        for answer in (
            client.post("view", config=ENVIRONMENT),
            client.post("render", view={"config": ENVIRONMENT}),
        ):
            assert str(path) in refusal(answer)
    monkeypatch.setenv("OCIO", str(tmp_path / "gone.ocio"))
    assert "gone.ocio" in refusal(client.post("plate", view={"config": ENVIRONMENT}))
    assert client.post("plate").status == 200


@pytest.mark.parametrize(
    "view",
    [
        {"config": ENVIRONMENT},  # which is not set
        {"config": "ocio://no-such-config"},
        {"config": "/etc/passwd"},
        {"config": "../studio.ocio"},
        {"config": "ocio://default/../x"},
        {"config": CONFIG, "display": "no such display"},
        {"config": CONFIG, "view": "no such view"},
        {"config": CONFIG, "space": "no such space"},
        {"config": CONFIG, "space": ""},
        {"config": CONFIG, "path": "/etc/passwd"},
        {"display": "sRGB"},
        "sRGB",
        [],
    ],
)
def test_what_cannot_be_shown_is_a_sentence(client: Client, view: Any):
    assert refusal(client.post("render", view=view))


def test_without_opencolorio_pictures_are_in_srgb(
    client: Client, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(screen_picture, "_opencolorio", lambda: None)
    assert config_names() == []
    lens = client.get("api/lens").json()
    assert (lens["configs"], lens["config"]) == ([], None)
    assert client.post("plate").status == 200
    said = refusal(client.post("plate", view={"config": CONFIG}))
    assert "pip install 'lensfit[view]'" in said
