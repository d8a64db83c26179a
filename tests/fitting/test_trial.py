"""Scores of sub-models against solving each of them from scratch."""

import numpy as np
import pytest

from lensfit.fitting.trial import Scores, Statistics, Trial, together

SIZE, ROWS = 12, 90
ALWAYS, TRIED, IDLE = np.array([0, 3, 4]), np.array([1, 2, 6, 7, 8, 9]), [5, 10, 11]


def _half(seed: int) -> Statistics:
    rng = np.random.default_rng(seed)
    rows, values = rng.normal(size=(ROWS, SIZE)), rng.normal(size=ROWS) * 3
    return Statistics(rows.T @ rows, rows.T @ values, float(values @ values), ROWS)


FIRST, SECOND = _half(0), _half(1)
PRECISION = np.random.default_rng(2).uniform(1, 9, SIZE)
OFFSET = np.random.default_rng(3).normal(0, 0.4, SIZE)


def _solved(one: Statistics, chosen: np.ndarray) -> np.ndarray:
    """The step of always + chosen that costs least, all others at their prior mean."""
    free = np.union1d(ALWAYS, chosen).astype(int)
    step = -OFFSET.copy()
    step[free] = 0.0
    gradient = (one.gradient + one.matrix @ step + PRECISION * (OFFSET + step))[free]
    matrix = one.matrix[np.ix_(free, free)] + np.diag(PRECISION[free])
    step[free] = -np.linalg.solve(matrix, gradient)
    return step


def _cost(one: Statistics, step: np.ndarray) -> float:
    return float(
        one.sum_of_squares + 2 * one.gradient @ step + step @ one.matrix @ step
    )


@pytest.mark.parametrize("chosen", [[], [2], [1, 6, 9], [1, 2, 6, 7, 8, 9]])
def test_scores_are_those_of_a_fit_from_scratch(chosen):
    chosen = np.array(chosen, int)
    trial = Trial((FIRST, SECOND), PRECISION, OFFSET, ALWAYS, TRIED)
    both = together((FIRST, SECOND))
    scores = trial.scores(chosen)
    total = _cost(both, _solved(both, chosen))
    free = len(ALWAYS) + len(chosen)
    expected = 2 * ROWS * np.log(total) + free * np.log(2 * ROWS)
    unseen = _cost(SECOND, _solved(FIRST, chosen))
    unseen += _cost(FIRST, _solved(SECOND, chosen))
    np.testing.assert_allclose(scores.bic, expected, rtol=1e-10)
    np.testing.assert_allclose(scores.held_out, unseen, rtol=1e-9)
    np.testing.assert_allclose(trial.step(chosen), _solved(both, chosen), atol=1e-9)


def test_each_part_is_predicted_by_all_others():
    parts = [_half(k) for k in range(3)]
    chosen = np.array([1, 6])
    held_out = Trial(parts, PRECISION, OFFSET, ALWAYS, TRIED).scores(chosen).held_out
    others = [together([p for p in parts if p is not part]) for part in parts]
    solved = [_solved(some, chosen) for some in others]
    expected = sum(_cost(p, step) for p, step in zip(parts, solved, strict=True))
    assert held_out == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize(
    ("falls", "better"),
    [((3.0, 2.0, 4.0), True), ((9.0, -2.0, -1.0), False), ((-1.0, -1.0, -1.0), False)],
)
def test_a_model_predicts_better_by_more_than_the_standard_error(falls, better):
    before = np.array([20.0, 30.0, 40.0])
    more, less = (Scores(1.0, 0.0, held) for held in (before - falls, before))
    assert more.predicts_better_than(less) is better
    assert not less.predicts_better_than(less)


def test_a_parameter_of_every_model_cannot_be_tried():
    with pytest.raises(ValueError, match="every model"):
        Trial((FIRST, SECOND), PRECISION, OFFSET, ALWAYS, np.array([3, 6]))


def test_what_rounding_takes_from_a_matrix_is_given_back():
    """Of two columns that single precision cannot tell apart."""
    rng = np.random.default_rng(8)
    rows = rng.normal(size=(ROWS, SIZE))
    rows[:, 4] = rows[:, 3] * (1 + 1e-7)
    matrix = (rows.T @ rows).astype(np.float32).astype(float)
    matrix[4, 4] -= 1e-6 * matrix[4, 4]
    assert np.linalg.eigvalsh(matrix).min() < 0
    values = rng.normal(size=ROWS)
    half = Statistics(matrix, rows.T @ values, float(values @ values), ROWS)
    trial = Trial((half, half), 1e-9 * PRECISION, 0 * OFFSET, ALWAYS, TRIED)
    assert np.isfinite(trial.step(np.array([1]))).all()


def test_what_no_number_is_said_to_leave_the_model_undetermined():
    broken = FIRST._replace(matrix=np.full((SIZE, SIZE), np.nan))
    with pytest.raises(ValueError, match="leave the model undetermined"):
        Trial((broken, SECOND), PRECISION, OFFSET, ALWAYS, TRIED)
