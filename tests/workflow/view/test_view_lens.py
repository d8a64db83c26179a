"""The view of a preset draws what the lens of that preset says."""

import base64
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest
from view_makers import Client, served, thin_lens

from lensfit.plate.apply_options import ApplyOptions
from lensfit.plate.camera.sources import StateOverrides
from lensfit.preset.schema import Preset
from lensfit.preset.store import load_preset
from lensfit.report.kernels import GAMMA
from lensfit.workflow.view.lens_adjustments import (
    LensAdjustments,
    adjustments_of_options,
)
from lensfit.workflow.view.lens_curves import breathing_facts
from lensfit.workflow.view.lens_server import LensServer
from lensfit.workflow.view.viewed_lens import ViewedLens

PRESETS = Path(__file__).parents[3] / "presets"


@pytest.fixture(scope="module")
def preset() -> Preset:
    return load_preset(PRESETS / "prime_50" / "preset.json")


@pytest.fixture(scope="module")
def client(preset: Preset) -> Iterator[Client]:
    lenses = [
        ViewedLens(preset, "prime", LensAdjustments()),
        ViewedLens(thin_lens(), "thin", LensAdjustments()),
    ]
    with served(LensServer(lenses)) as asked:
        yield asked


def picture(address: str) -> np.ndarray:
    content = base64.b64decode(address.partition(",")[2])
    return cv2.imdecode(np.frombuffer(content, np.uint8), 1)[..., ::-1]


@pytest.mark.parametrize("name", ["field", "point", "through"])
@pytest.mark.slow
def test_two_lenses_side_by_side_are_drawn_on_one_scale(preset: Preset, name: str):
    other = load_preset(PRESETS / "vintage_50" / "preset.json")
    named = [(preset, "prime"), (other, "vintage")]
    lenses = [ViewedLens(one, said, LensAdjustments()) for one, said in named]
    state = {"f_number": 2.8, "x": 0.5}
    alone = []
    for lens in lenses:
        with served(LensServer([lens])) as client:
            alone.append(client.post(name, **state).json()["width_mm"])
    assert alone[0] != alone[1]
    with served(LensServer(lenses)) as client:
        for place in (0, 1):
            own = client.post(name, lens=place, **state).json()["width_mm"]
            assert own == pytest.approx(alone[place])
            found = client.post(name, lens=place, one_scale=True, **state).json()
            assert found["width_mm"] == pytest.approx(max(alone))


def test_the_point_is_the_psf_of_the_lens_in_colour(client: Client, preset: Preset):
    state = {"f_number": 2.8, "focus_distance_mm": 1430.0}
    found = client.post("point", **state, object_distance_mm=1600, x=0.5, y=-0.5).json()
    lens = preset.at(50, 2.8, 1430)
    width_mm, height_mm = lens.sensor_size_mm
    assert [found["x_mm"], found["y_mm"]] == [width_mm / 4, -height_mm / 4]
    shown = picture(found["picture"])
    pitch = found["width_px"] * width_mm / preset.camera.image_width_px / len(shown)
    psf = lens.psfs(
        [[width_mm / 4, -height_mm / 4]], 1600, pixel_pitch_mm=pitch,
        size_px=len(shown), tolerance=0.02,
    )[0]  # fmt: skip
    light = np.moveaxis(np.asarray(psf), 0, -1)
    wanted = 255 * (light / light.max()) ** GAMMA
    np.testing.assert_allclose(shown, wanted, atol=0.51)
    assert np.ptp(shown.astype(int), axis=-1).max() > 5


def test_what_is_not_known_is_not_drawn(client: Client):
    """An ideal lens states no deviations."""
    assert client.post("point", lens=1).json()["deviation"] is None
    assert client.post("field", lens=1).json()["errors"] is None


def test_field_and_through_change_with_the_state(client: Client):
    first = client.post("field").json()
    stopped = client.post("field", f_number=8).json()
    near = client.post("field", object_distance_mm=900).json()
    assert len({one["picture"] for one in (first, stopped, near)}) == 3
    assert near["width_px"] > first["width_px"]
    through = client.post("through", object_distance_mm=1700, x=0.9, y=0.9).json()
    assert len(through["distances_mm"]) == 7
    assert any(abs(mm - 1700) < 1 for mm in map(float, through["distances_mm"]))
    tile = picture(through["picture"]).shape[0] // len(through["f_numbers"])
    wide, small = (
        picture(through["picture"])[k * tile : (k + 1) * tile] for k in (0, -2)
    )
    assert (wide > 128).sum() > (small > 128).sum()


def test_figures_are_drawn_with_their_deviations(client: Client, preset: Preset):
    found = {one["key"]: one for one in client.post("figures").json()}
    assert list(found) == [
        "distortion-grid", "radial-profile", "lateral-colour", "fall-off",
        "fall-off-surface", "uncertainty", "breathing",
    ]  # fmt: skip
    for key in ("radial-profile", "lateral-colour", "fall-off"):
        assert 'class="band' in found[key]["svg"]
    assert "deviation" in found["radial-profile"]["caption"]
    sizes = [
        preset.select(50, None, mm).entry.projection.principal_distance_mm
        for mm in (1430, 2860)
    ]
    larger = 100 * (sizes[0] / sizes[1] - 1)
    assert found["breathing"]["caption"].startswith(f"{larger:.1f}")


def test_breathing_is_known_where_it_was_photographed(preset: Preset):
    focuses = sorted(entry.focus_distance_mm for entry in preset.entries)
    facts = breathing_facts(preset, preset.at(50, 2, focuses[0]))
    assert facts is not None
    known = {
        focus: sd
        for focus, sd in zip(facts["focus_dioptres"], facts["sd_percent"], strict=True)
        if sd is not None
    }
    assert known
    assert known.keys() <= {round(1000 / mm, 6) for mm in focuses}
    assert all(0 < sd < 1 for sd in known.values())


def test_two_lenses_are_each_their_own(client: Client):
    start = client.get("api/lens").json()
    assert [one["file"] for one in start["lenses"]] == ["prime", "thin"]
    state = {"f_number": 4, "focus_distance_mm": 2000, "focal_length_mm": 50}
    assert client.post("point", **state).status == 200
    refused = client.post("point", lens=1, **state)
    assert refused.status == 422
    assert "75 mm" in refused.json()["error"]
    pictures = [client.post("point", lens=k).json()["picture"] for k in (0, 1)]
    assert pictures[0] != pictures[1]


@pytest.mark.parametrize(
    "message",
    [
        {"lens": 2}, {"x": 1.5}, {"object_distance_mm": 0}, {"object_distance_mm": 20},
        {"f_number": 1e6}, {"knobs": {"coma": 1}}, {"path": "/etc/passwd"},
    ],
)  # fmt: skip
def test_what_cannot_be_is_a_sentence(client: Client, message: dict):
    answer = client.post("point", **message)
    assert answer.status == 422
    assert "\n" not in answer.json()["error"]


def test_without_results_there_is_no_report_and_no_dots(client: Client):
    assert client.get("report").status == 422
    assert client.get("api/dots/0").status == 422
    assert client.get("api/dots/..%2f0").status == 404


def test_it_is_opened_at_what_the_command_states(preset: Preset):
    options = ApplyOptions(
        overrides=StateOverrides(f_number=8.0), knobs={"coma_gain": 2.0}
    )
    viewed = ViewedLens(preset, "prime", adjustments_of_options(options))
    start = viewed.start()
    assert start["camera"] == {
        "focal_length_mm": 50.0, "f_number": 8.0, "focus_distance_mm": 2000.0,
    }  # fmt: skip
    assert start["knobs"] == {"coma_gain": 2.0}
    plain = preset.at(50, 8, 2000).blur
    assert viewed.lens(LensAdjustments()).f_number == 8
    assert viewed.lens(LensAdjustments()).blur is not None
    assert plain is not None


def test_a_scaled_look_is_the_measured_lens_in_numbers_of_the_camera(preset: Preset):
    """Twice as long on a sensor twice as wide: everything is twice as far away."""
    own_mm = preset.camera.sensor_width_mm
    wide = {"sensor_width_mm": 2 * own_mm, "scale_to_sensor": True}
    opened = LensAdjustments(focal_length_mm=100.0, f_number=2.8)
    plain = LensAdjustments(focal_length_mm=50.0, f_number=2.8)
    lenses = [
        ViewedLens(preset, "prime", opened, **wide),
        ViewedLens(preset, "prime", plain),
        ViewedLens(preset, "prime", opened),
    ]
    point = {"x": 0.5, "y": -0.5}
    with served(LensServer(lenses[:2])) as client:
        scaled, measured = (
            one["camera"] for one in client.get("api/lens").json()["lenses"]
        )
        assert scaled["focal_length_mm"] == 2 * measured["focal_length_mm"]
        assert scaled["focus_distance_mm"] == 2 * measured["focus_distance_mm"]
        one, other = (
            client.post("point", lens=n, object_distance_mm=far, **point).json()
            for n, far in enumerate((3200, 1600))
        )
        assert one["picture"] == other["picture"]
        assert one["width_px"] == pytest.approx(other["width_px"])
        assert one["x_mm"] == pytest.approx(2 * other["x_mm"])
        notes = client.post("field", lens=0).json()["notes"]
        assert any("--scale-to-sensor" in note for note in notes)
    with served(LensServer(lenses[2:])) as client:
        refused = client.post("point")
        assert refused.status == 422
        assert "--scale-to-sensor" in refused.json()["error"]


def test_a_longer_look_on_the_same_sensor_spans_a_part_of_it(preset: Preset):
    viewed = ViewedLens(
        preset, "prime", LensAdjustments(focal_length_mm=100.0), scale_to_sensor=True
    )
    width_mm, height_mm = viewed.lens(LensAdjustments()).sensor_size_mm
    camera = preset.camera
    assert width_mm == pytest.approx(camera.sensor_width_mm / 2)
    assert height_mm == pytest.approx(camera.sensor_height_mm / 2)
    shortest, longest = viewed.start()["ranges"]["focal_length_mm"]
    assert shortest <= 50
    assert longest == 200
