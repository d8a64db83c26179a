"""The plan says what is run, what is left out and why; the renderer keeps to it."""

import cv2
import numpy as np
import pytest
from ideal_lens import HEIGHT, WIDTH, depth_of, depth_plane, ideal_lens, noise
from radial_lens import RadialLens

from lensfit.coords import Window
from lensfit.rendering.frame import render_stages
from lensfit.rendering.layer_stack import LayerStack
from lensfit.rendering.render_plan import plan_of
from lensfit.rendering.render_stages import Switches, prepare_stages

FRAME = Window.of_size(WIDTH, HEIGHT)


def planned(lens, depth_mm=None, tolerance=1e-3, **options):
    stages = prepare_stages(
        lens, FRAME, FRAME, tolerance=tolerance, switches=options.pop("switches", None)
    )
    plan = plan_of(stages, FRAME, tolerance, depth_mm=depth_mm, **options)
    return {stage.stage: stage for stage in plan.stages}, plan


def stepped():
    depth = depth_plane(-4.0)
    depth[:, : WIDTH // 2] = depth_of(6.0)
    return depth


def test_an_ideal_lens_in_focus_needs_nothing():
    stages, plan = planned(ideal_lens(), depth_plane(0.0))
    assert not any(stage.runs for stage in stages.values())
    assert plan.seconds == plan.first_s == 0


def test_each_stage_is_run_where_it_shows():
    stages, _ = planned(RadialLens(k=0.06, lateral=2e-3, drop=0.5))
    assert [name for name, stage in stages.items() if stage.runs] == [
        "distortion",
        "lateral colour",
        "fall-off",
    ]
    stages, _ = planned(RadialLens(k=0.06, lateral=2e-5, drop=0.5), tolerance=3e-2)
    assert not stages["lateral colour"].runs
    assert "not seen" in stages["lateral colour"].reason


def test_depth_without_steps_has_no_outlines():
    stages, _ = planned(ideal_lens(), depth_plane(6.0))
    assert stages["depth of field"].runs
    assert not stages["outlines"].runs
    stages, _ = planned(ideal_lens(), stepped())
    assert stages["outlines"].runs


def test_what_is_not_wanted_or_not_there_is_said():
    off = Switches(defocus=False)
    stages, _ = planned(ideal_lens(), stepped(), switches=off)
    assert stages["depth of field"].reason == "not wanted"
    stages, _ = planned(ideal_lens())
    assert "no depth" in stages["depth of field"].reason


def test_a_deep_plate_needs_no_outlines_taken_apart():
    rgba = np.ones((2, HEIGHT, WIDTH, 4), np.float32)
    layers = LayerStack(rgba, np.stack([stepped(), depth_plane(-5.0)]))
    stages, _ = planned(ideal_lens(), layers=layers)
    assert stages["depth of field"].runs
    assert not stages["outlines"].runs


def test_a_looser_tolerance_is_cheaper_and_says_so():
    radius = np.linspace(-6, 12, HEIGHT)[:, None].repeat(WIDTH, 1)
    depth = depth_of(radius).astype(np.float32)
    plans = [planned(ideal_lens(), depth, t)[1] for t in (1e-3, 3e-3, 1e-2)]
    assert plans[0].error < plans[1].error < plans[2].error
    assert plans[0].seconds > plans[1].seconds > plans[2].seconds
    for plan in plans:
        assert plan.error == pytest.approx(plan.tolerance, rel=0.5)


def test_the_expected_error_is_what_the_renderer_makes_of_it():
    radius = np.linspace(-6, 12, HEIGHT)[:, None].repeat(WIDTH, 1)
    depth = depth_of(radius).astype(np.float32)
    picture = 3 * (cv2.GaussianBlur(noise(1), (0, 0), 1.5) - 0.5) + 0.5

    def rendered(tolerance):
        stages = prepare_stages(ideal_lens(), FRAME, FRAME, tolerance=tolerance)
        return render_stages(picture, FRAME, stages, FRAME, depth_mm=depth)

    finest = rendered(3e-4)
    for tolerance in (3e-3, 1e-2):
        _, plan = planned(ideal_lens(), depth, tolerance)
        made = np.sqrt(np.mean((rendered(tolerance) - finest) ** 2))
        assert made < 2 * plan.error
