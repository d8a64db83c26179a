"""Choosing terms on linear problems whose answer is known."""

from itertools import pairwise

import numpy as np
import pytest

from lensfit.fitting.parameters import DRIFT_PARAMETERS, POSE_PARAMETERS, Layout
from lensfit.fitting.select import (
    Step,
    TermDecision,
    bend_steps,
    choose,
    shared_term_groups,
)
from lensfit.fitting.trial import Statistics

ROWS, POSES = 600, 6
FIELD = np.linspace(-1, 1, ROWS)
RADIAL = np.stack([FIELD ** (2 * k + 1) for k in range(1, 5)], -1)
OTHER = np.stack([np.cos(3 * FIELD), np.sin(7 * FIELD)], -1)
POSE = np.random.default_rng(9).normal(0, 1, (ROWS, POSES))
DESIGN = np.concatenate([POSE, RADIAL, OTHER], -1)
ALWAYS = np.arange(POSES)
TERMS = {
    "radial": [Step(f"radial_{k}", np.arange(POSES, POSES + k)) for k in range(1, 5)],
    "other": [Step("other", np.arange(POSES + 4, POSES + 6))],
}


def _choose(
    truth: np.ndarray, noise: float, seed: int, offset: np.ndarray | None = None
):
    """Choose for data = DESIGN @ truth + noise, linearised at `offset`."""
    rng = np.random.default_rng(seed)
    offset = np.zeros(DESIGN.shape[1]) if offset is None else offset
    data = DESIGN @ truth + rng.normal(0, noise, ROWS)
    residual = (DESIGN @ offset - data) / max(noise, 1e-9)
    design = DESIGN / max(noise, 1e-9)
    first = rng.random(ROWS) < 0.5
    halves = [
        Statistics(
            design[h].T @ design[h],
            design[h].T @ residual[h],
            float(residual[h] @ residual[h]),
            int(h.sum()),
        )
        for h in (first, ~first)
    ]
    precision = np.full(DESIGN.shape[1], 1e-2)
    return choose(halves, precision, offset, ALWAYS, TERMS)


def _truth(**at: float) -> np.ndarray:
    truth = np.zeros(DESIGN.shape[1])
    truth[:POSES] = 0.3
    for index, value in at.items():
        truth[POSES + int(index[1:])] = value
    return truth


def test_noise_asks_for_no_term():
    asked = [bool(_choose(_truth(), 0.1, seed).kept) for seed in range(40)]
    assert sum(asked) <= 1


def test_a_term_that_exists_is_kept_and_the_others_are_not():
    for seed in range(10):
        kept, decisions, _ = _choose(_truth(t0=0.1), 0.1, seed)
        assert kept == {"radial": 1}
        assert {v.name for v in decisions if v.kept} == {"radial_1"}


def test_the_search_looks_past_a_step_that_does_not_help_by_itself():
    """A polynomial orthogonal to its own lower steps needs all of them at once."""
    columns = np.concatenate([POSE, RADIAL[:, :2]], -1)
    solution = np.linalg.lstsq(columns, RADIAL[:, 2])[0]
    truth = _truth(t0=-solution[POSES], t1=-solution[POSES + 1], t2=1.0)
    kept, decisions, _ = _choose(truth, 0.005, 0)
    assert kept["radial"] == 3
    assert {v.name for v in decisions if v.kept} == {"radial_1", "radial_2", "radial_3"}


def test_two_families_are_found_together():
    kept, _, _ = _choose(_truth(t0=0.2, t4=0.2, t5=0.1), 0.1, 3)
    assert kept == {"radial": 1, "other": 1}


def test_the_answer_does_not_depend_on_where_it_was_linearised():
    elsewhere = np.random.default_rng(2).normal(0, 0.5, DESIGN.shape[1])
    here, there = (_choose(_truth(t0=0.1), 0.1, 4, o) for o in (None, elsewhere))
    assert here[0] == there[0]
    for a, b in zip(here[1], there[1], strict=True):
        np.testing.assert_allclose(a.bic_gain, b.bic_gain, rtol=1e-3, atol=0.05)


def test_evidence_is_the_textbooks_bic():
    """Against two least-squares fits made here; the prior is far too weak to matter."""
    rng = np.random.default_rng(6)
    _, decisions, _ = _choose(_truth(t0=0.1), 0.1, 6)
    data = DESIGN @ _truth(t0=0.1) + rng.normal(0, 0.1, ROWS)
    both = np.concatenate([POSE, RADIAL[:, :1]], -1)
    left = [np.sum((data - a @ np.linalg.lstsq(a, data)[0]) ** 2) for a in (POSE, both)]
    expected = ROWS * np.log(left[0] / left[1]) - np.log(ROWS)
    mine = next(v.bic_gain for v in decisions if v.name == "radial_1")
    np.testing.assert_allclose(mine, expected, rtol=1e-3)


def test_reasons_are_sentences_that_say_which_way():
    _, decisions, _ = _choose(_truth(t0=0.1), 0.1, 0)
    reasons = {v.name: v.reason for v in decisions}
    assert reasons["radial_1"].startswith("kept: BIC gain +")
    assert reasons["other"].startswith("left out: the BIC gain is too small")


@pytest.mark.parametrize(
    ("gain", "says"),
    [
        (1.0, "-100 %"),
        (0.99, "-90 %"),
        (0.75, "-50 %"),
        (0.19, "-10 %"),
        (0.0396, "-2 %"),
        (0.0, "+0 %"),
        (1e-6, "+0 %"),
        (-0.0201, "+1 %"),
        (-0.44, "+20 %"),
        (-3.0, "+100 %"),
        (-15.0, "+300 %"),
    ],
)
def test_a_reason_says_what_became_of_the_held_out_rms_error(gain, says):
    """Of the sum of squares a share is gone; of its root less. No more than all of it,
    while it may grow by any factor."""
    reason = TermDecision("radial_1", True, 20.0, gain).reason
    assert reason == f"kept: BIC gain +20, held-out error {says}"


@pytest.mark.parametrize("layout", [Layout(), Layout(free_degree=5, apertures=2)])
def test_steps_of_a_family_are_nested_and_families_are_apart(layout):
    found = shared_term_groups(layout)
    seen: set[int] = set()
    for steps in found.values():
        for small, large in pairwise(steps):
            assert set(small.indices) < set(large.indices)
        last = set(steps[-1].indices.tolist())
        assert not last & seen
        seen |= last
    assert ("free_field" in found) == (layout.free_degree > 0)
    assert ("aperture_shift" in found) == (layout.apertures > 0)
    assert max(seen) < layout.shared


def test_bends_belong_to_every_photograph_and_leave_poses_alone():
    layout = Layout(bend_degree=3)
    steps = bend_steps(layout, views=4)
    assert [len(s.indices) for s in steps] == [4 * 3, 4 * 7]
    within = (steps[-1].indices - layout.shared) % layout.local
    assert within.min() == POSE_PARAMETERS + DRIFT_PARAMETERS


def test_room_for_another_states_model_adds_no_terms():
    own = Layout(radial=3, free_degree=3, apertures=1)
    found = shared_term_groups(Layout(free_degree=7, apertures=3), own)
    expected = shared_term_groups(own)
    assert {
        name: [(s.name, len(s.indices)) for s in steps] for name, steps in found.items()
    } == {
        name: [(s.name, len(s.indices)) for s in steps]
        for name, steps in expected.items()
    }


def test_a_prism_enters_on_top_of_decentering_and_never_alone():
    layout = Layout()
    found = shared_term_groups(layout)
    blocks = layout.blocks
    prism = np.arange(blocks["thin_prism"].start, blocks["thin_prism"].stop)
    first = np.arange(blocks["decentering"].start, blocks["decentering"].start + 2)
    assert "thin_prism" not in found
    with_prism = [
        step
        for steps in found.values()
        for step in steps
        if np.isin(prism, step.indices).any()
    ]
    assert {step.name for step in with_prism} >= {"thin_prism_2", "thin_prism_4"}
    for step in with_prism:
        assert np.isin(first, step.indices).all()
