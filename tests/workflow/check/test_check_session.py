"""A session of checks: the same detection as calibrate's, light, sides, plan, speed."""

import math
import os
import shutil
import time
from pathlib import Path

import cv2
import numpy as np
import pytest
import tifffile
from bundled_shoot import DEMO
from drawn_views import dot_centres, dots, noisy, write_linear

from lensfit.errors import ImageError
from lensfit.photograph import Photograph
from lensfit.progress import silent
from lensfit.workflow.calibration.observe import observe_shoot
from lensfit.workflow.check import session as module
from lensfit.workflow.check.check_records import Problem
from lensfit.workflow.check.photographs import new_photographs
from lensfit.workflow.check.sentences import sharpening_problems
from lensfit.workflow.check.session import CheckSession
from lensfit.workflow.shoot.shoot_file import load_shoot

HEAD = """
[lens]
name = "drawn"
[camera]
sensor_width_mm = 24.0
[[target]]
name = "dots"
kind = "dot-grid"
pitch_mm = 36.0
hole_diameter_mm = 3.0
"""


def take_text(image: str, focus_mm: float, f_number: float = 2.8) -> str:
    return f"""
[[take]]
image = "{image}"
target = "dots"
focal_length_mm = 30.0
f_number = {f_number}
focus_distance_mm = {focus_mm}
target_distance_mm = 1000.0
encoding = "linear"
"""


def breathing_shoot(folder: Path, focus_mm: dict[str, float]) -> Path:
    """One in focus, one imaged larger, two imaged smaller, with these statements."""
    drawn = {
        "in": (1.0, 0.6),
        "near": (1.006, 3.0),
        "far": (0.994, 3.0),
        "far2": (0.996, 2.0),
    }
    text = HEAD
    for seed, (name, (scale, variance)) in enumerate(drawn.items()):
        picture = dots(dot_centres(scale), 3.0, variance * np.eye(2))
        write_linear(folder / f"{name}.png", picture, seed)
        text += take_text(f"{name}.png", focus_mm[name])
    (folder / "shoot.toml").write_text(text)
    return folder / "shoot.toml"


STATED = {"in": 1000.0, "near": 800.0, "far": 1300.0, "far2": 1200.0}


@pytest.mark.slow
def test_what_is_found_is_what_calibrate_uses(monkeypatch):
    shoot = load_shoot(DEMO / "shoot.toml")
    used = observe_shoot(shoot, None, silent)
    seen = []
    original = module.detections_of
    monkeypatch.setattr(
        module, "detections_of", lambda *a: seen.append(original(*a)) or seen[-1]
    )
    session = CheckSession(shoot)
    for one in used:
        judged = session.check(DEMO / one.image)
        assert judged.take == one.image
        assert one.take is not None
        theirs = one.take.observations
        assert judged.points == len(theirs)
        assert np.array_equal(seen[-1].points_px, theirs.points_px)
        assert np.array_equal(seen[-1].lattice, theirs.lattice)


def test_light_halved_is_one_stop(tmp_path):
    picture = dots(dot_centres(), 3.0, np.eye(2))
    below = []
    for k, factor in enumerate((1.0, 0.5)):
        write_linear(tmp_path / f"{k}.png", factor * picture)
        (tmp_path / "shoot.toml").write_text(HEAD + take_text(f"{k}.png", 1000))
        judged = CheckSession(load_shoot(tmp_path / "shoot.toml")).check(
            tmp_path / f"{k}.png"
        )
        assert judged.exposure is not None
        below.append(judged.exposure.below_clipping_stops)
    assert below[1] - below[0] == pytest.approx(1.0, abs=0.02)
    peak = 0.01 + 0.6 * (picture.max() - 0.01) / 0.6
    assert below[0] == pytest.approx(-math.log2(peak), abs=0.1)


def test_clipped_dots_are_to_be_shot_again(tmp_path):
    write_linear(tmp_path / "a.png", 4 * dots(dot_centres(), 3.0, np.eye(2)))
    (tmp_path / "shoot.toml").write_text(HEAD + take_text("a.png", 1000))
    session = CheckSession(load_shoot(tmp_path / "shoot.toml"))
    judged = session.check(tmp_path / "a.png")
    assert judged.level == "bad"
    assert [problem.kind for problem in judged.problems] == ["clipping"]
    assert session.plan[0].state == "again"


def test_sides_of_focus_agree_with_true_statements(tmp_path):
    shoot = load_shoot(breathing_shoot(tmp_path, STATED))
    session = CheckSession(shoot)
    judged = [session.check(shoot.image_path(take)) for take in shoot.takes]
    assert all(one.level == "good" for one in judged)
    sides = [one.focus for one in judged]
    assert [side and side.stated for side in sides] == [
        "on the target",
        "nearer than the target",
        "beyond the target",
        "beyond the target",
    ]
    assert [side and side.agrees for side in sides] == [None, None, True, True]
    near, far = sides[1], sides[2]
    assert near is not None
    assert far is not None
    assert near.breathing_percent == pytest.approx(0.6, abs=0.02)
    assert far.breathing_percent == pytest.approx(-0.6, abs=0.02)
    assert near.reference == "in.png"


def test_a_swapped_statement_is_found_as_soon_as_it_can_be(tmp_path):
    swapped = STATED | {"far2": 850.0}
    shoot = load_shoot(breathing_shoot(tmp_path, swapped))
    session = CheckSession(shoot)
    judged = [session.check(shoot.image_path(take)) for take in shoot.takes]
    assert [one.level for one in judged] == ["good", "good", "good", "bad"]
    (problem,) = judged[3].problems
    assert problem.kind == "focus_side"
    assert "near.png" in problem.text


def test_stated_in_focus_but_blurrier_than_out_of_focus(tmp_path):
    wrong = STATED | {"in": 800.0, "near": 1000.0}
    shoot = load_shoot(breathing_shoot(tmp_path, wrong))
    session = CheckSession(shoot)
    session.check(tmp_path / "in.png")
    judged = session.check(tmp_path / "near.png")
    assert "focus" in [problem.kind for problem in judged.problems]
    assert judged.level == "bad"


def shrunk(path: Path, factor: float) -> None:
    """The photograph saved again with fewer pixels."""
    picture = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    assert picture is not None
    small = cv2.resize(
        picture, None, fx=factor, fy=factor, interpolation=cv2.INTER_AREA
    )
    cv2.imwrite(str(path), small)


def test_a_photograph_of_another_size_is_named_and_its_blur_not_compared(tmp_path):
    """Half as many pixels halve a blur in pixels: no view is sharper by that."""
    shoot = load_shoot(breathing_shoot(tmp_path, STATED))
    shrunk(tmp_path / "far.png", 0.5)
    session = CheckSession(shoot)
    names = ("far.png", "in.png", "near.png", "far2.png")
    odd, *others = [session.check(tmp_path / name) for name in names]
    assert odd.level == "good"
    first, second, third = [
        [p for p in one.problems if p.kind == "photograph_size"] for one in others
    ]
    # Of two nobody knows which is the odd one; the third decides, and it is named once.
    assert "in.png is 800 x 600 px (scaled, or" in first[0].text
    assert "far.png is 400 x 300 px" in second[0].text
    assert second[0].level == "caution"
    assert third == []
    near = others[1].focus
    assert near is not None
    assert near.reference == "in.png"
    assert {p.kind for one in others for p in one.problems} == {"photograph_size"}
    again = session.check(tmp_path / "far.png")
    assert again.level == "bad"
    assert [p.kind for p in again.problems] == ["photograph_size"]
    assert again.focus is not None
    assert again.focus.reference == "far.png"


def test_a_smaller_photograph_is_not_sharper(tmp_path):
    """In focus at full size, out of focus at a quarter of it."""
    shoot = load_shoot(breathing_shoot(tmp_path, STATED))
    shrunk(tmp_path / "far2.png", 0.25)
    session = CheckSession(shoot)
    session.check(tmp_path / "far2.png")
    judged = session.check(tmp_path / "in.png")
    assert "focus" not in [problem.kind for problem in judged.problems]


def test_a_photograph_taken_anew_is_no_longer_of_another_size(tmp_path):
    shoot = load_shoot(breathing_shoot(tmp_path, STATED))
    right = (tmp_path / "near.png").read_bytes()
    shrunk(tmp_path / "near.png", 0.75)
    session = CheckSession(shoot)
    session.check(tmp_path / "in.png")
    assert session.check(tmp_path / "near.png").level == "bad"
    (tmp_path / "near.png").write_bytes(right)
    assert session.check(tmp_path / "near.png").level == "good"


def test_sharpness_is_the_drawn_blur_in_every_zone(tmp_path):
    shoot = load_shoot(breathing_shoot(tmp_path, STATED))
    judged = CheckSession(shoot).check(tmp_path / "near.png")
    assert judged.sharpness is not None
    true = 4 * math.sqrt(3.0 + 1 / 12)
    assert judged.sharpness.centre_px == pytest.approx(true, rel=0.03)
    zones = np.array(judged.sharpness.zones_px, float)
    assert np.allclose(zones, true, rtol=0.04)


def test_one_exposure_under_two_names_is_not_two_views(tmp_path):
    write_linear(tmp_path / "a.png", dots(dot_centres(), 3.0, np.eye(2)))
    shutil.copy(tmp_path / "a.png", tmp_path / "b.png")
    text = HEAD + take_text("a.png", 1000) + take_text("b.png", 1000)
    (tmp_path / "shoot.toml").write_text(text)
    session = CheckSession(load_shoot(tmp_path / "shoot.toml"))
    assert session.check(tmp_path / "a.png").level == "good"
    again = session.check(tmp_path / "b.png")
    assert [problem.kind for problem in again.problems] == ["repeated"]
    assert "a.png" in again.problems[0].text


def test_a_view_of_the_plan_is_missing_until_it_is_there(tmp_path):
    text = HEAD + take_text("a.png", 1000) + take_text("b.png", 800)
    (tmp_path / "shoot.toml").write_text(text)
    write_linear(tmp_path / "a.png", dots(dot_centres(), 3.0, np.eye(2)))
    session = CheckSession(load_shoot(tmp_path / "shoot.toml"))
    session.check(tmp_path / "a.png")
    assert [view.state for view in session.plan] == ["done", "missing"]


def test_a_photograph_without_a_chart_is_bad_and_says_so(tmp_path):
    rng = np.random.default_rng(0)
    write_linear(tmp_path / "a.png", rng.uniform(0.1, 0.6, (300, 400)))
    judged = CheckSession().check(tmp_path / "a.png")
    assert judged.level == "bad"
    assert [problem.kind for problem in judged.problems] == ["target"]


def test_new_photographs_come_once_when_they_are_whole(tmp_path):
    looks = iter(range(8))
    growing = tmp_path / "b.png"

    def go_on() -> bool:
        look = next(looks, None)
        if look == 2:
            growing.write_bytes(b"half")
        if look == 3:
            growing.write_bytes(b"half and the rest")
        return look is not None

    (tmp_path / "a.png").write_bytes(b"there")
    (tmp_path / "notes.txt").write_bytes(b"no picture")
    arrived = list(new_photographs(tmp_path, go_on, poll_s=0.0))
    assert arrived == [tmp_path / "a.png", growing]
    assert growing.read_bytes() == b"half and the rest"


def test_a_folder_that_is_none_is_one_line(tmp_path):
    with pytest.raises(ImageError, match="cannot be listed"):
        next(new_photographs(tmp_path / "nowhere"))


def test_a_camera_that_sharpens_is_told_while_it_can_be_switched_off():
    squares = np.kron(np.indices((12, 16)).sum(0) % 2, np.ones((40, 40)))
    blurred = cv2.GaussianBlur(0.05 + 0.5 * squares, (0, 0), 0.8)
    sharpened = blurred + 1.2 * (blurred - cv2.GaussianBlur(blurred, (0, 0), 1.2))

    def problems(light: np.ndarray) -> list[Problem]:
        pixels = light.astype(np.float32)[..., None]
        return list(sharpening_problems(Photograph(pixels, Path("a.jpg"), "", "srgb")))

    (problem,) = problems(np.maximum(sharpened, 0))
    assert problem.level == "caution"
    assert "of the contrast darker" in problem.text
    assert "switch sharpening off" in problem.remedy
    assert not problems(blurred)


TEN_MEGAPIXELS_PX = (3648, 2736)
LARGE_PITCH_PX = 96
LARGE_SHOOT = """
[lens]
name = "drawn"
[[target]]
name = "dots"
kind = "dot-grid"
pitch_mm = 30.0
hole_diameter_mm = 1.0
[[take]]
image = "ten.tif"
target = "dots"
focal_length_mm = 50.0
encoding = "linear"
"""


@pytest.mark.slow
def test_ten_megapixels_cost_less_than_six_seconds_of_processor(tmp_path):
    """Processor time, so that whatever else runs on the machine has no part in it."""
    drawn = np.zeros(TEN_MEGAPIXELS_PX[::-1], np.float32)
    drawn[48::LARGE_PITCH_PX, 48::LARGE_PITCH_PX] = 20.0
    picture = 0.002 + cv2.GaussianBlur(drawn, (0, 0), 2.0)
    grey = np.clip(65535 * noisy(picture), 0, 65535).astype(np.uint16)
    tifffile.imwrite(tmp_path / "ten.tif", np.repeat(grey[..., None], 3, 2))
    (tmp_path / "shoot.toml").write_text(LARGE_SHOOT)
    session = CheckSession(load_shoot(tmp_path / "shoot.toml"), tmp_path / "checks")
    first = session.check(tmp_path / "ten.tif")
    assert first.points > 1000
    before = time.process_time()
    again = CheckSession(session.shoot, tmp_path / "checks").check(tmp_path / "ten.tif")
    assert again.sharpness is not None
    assert time.process_time() - before < 6.0
    assert os.path.getsize(tmp_path / "checks" / "ten_check.png") > 0
