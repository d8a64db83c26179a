"""Gathered normal equations against the dense Jacobian of a small, complete case."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from lensfit.fitting import normal
from lensfit.fitting.adjust import Problem, Stated, both_halves, total, with_statements
from lensfit.fitting.geometry import BoardPose, Frame
from lensfit.fitting.levenberg import short_residual, with_prior
from lensfit.fitting.parameters import Layout
from lensfit.fitting.view_stack import Detections

pytestmark = pytest.mark.slow

LAYOUT = Layout(radial=2, free_degree=3, bend_degree=2, stretch_degree=2, apertures=1)
VIEWS, CHUNKS, DETECTIONS = 3, 5, 6
OF_VIEW = [0, 1, 2, 2, 0]


@pytest.fixture(scope="module")
def problem() -> Problem:
    rng = np.random.default_rng(0)
    size = LAYOUT.size(VIEWS)
    turns = Rotation.from_rotvec(rng.normal(0, 0.2, (VIEWS, 3))).as_matrix()
    views = BoardPose(
        rotation=jnp.asarray(turns),
        translation_mm=jnp.asarray(rng.normal([0, 0, 900], 20.0, (VIEWS, 3))),
        aperture=jnp.asarray([0, 1, 0]),
        half_board_mm=jnp.full((VIEWS, 2), 250.0),
        whole_board=jnp.asarray([1.0, 0.0, 1.0]),
    )
    detections = Detections(
        view=jnp.asarray(OF_VIEW),
        chunks=jnp.asarray(CHUNKS),
        board=jnp.asarray(rng.uniform(-1, 1, (CHUNKS, DETECTIONS, 2))),
        observed_mm=jnp.asarray(rng.normal(0, 4, (CHUNKS, DETECTIONS, 2))),
        whitening=jnp.asarray(rng.normal(0, 30, (CHUNKS, DETECTIONS, 2, 2))),
    )
    frame = Frame(
        jnp.asarray(30.0),
        jnp.asarray(15.0),
        jnp.zeros(2),
        jnp.asarray(1.05),
        jnp.array([[-0.8, -0.6], [0.8, 0.6]]),
        jnp.asarray(900.0),
    )
    free = np.ones(size)
    free[[3, 9, 40, size - 2]] = 0.0
    return Problem(
        views=views,
        detections=detections,
        frame=frame,
        prior_mean=jnp.asarray(rng.normal(0, 0.002, size)),
        prior_precision=jnp.asarray(rng.uniform(1, 50, size) * free),
        free=jnp.asarray(free),
        stated=_stated(rng, size),
    )


def _stated(rng: np.random.Generator, size: int) -> Stated:
    """Three made-up statements."""
    rows, wanted = rng.normal(0, 20, (3, size)), rng.normal(0, 1, 3)
    parts = rows.T @ rows, rows.T @ wanted, wanted @ wanted
    return Stated(*map(jnp.asarray, parts))


def _at(scale: float = 0.002) -> jnp.ndarray:
    size = LAYOUT.size(VIEWS)
    return jnp.asarray(np.random.default_rng(1).normal(0, scale, size))


def _whitened(parameters, problem: Problem):
    detections = problem.detections
    predicted = normal.predictions_mm(
        parameters,
        problem.views,
        detections.view,
        detections.board,
        LAYOUT,
        problem.frame,
    )
    off = predicted - detections.observed_mm
    return jnp.einsum("cmij,cmj->cmi", detections.whitening, off)


_value = jax.jit(_whitened)
_jacobian = jax.jit(jax.jacfwd(_whitened))
_equations = jax.jit(normal.equations, static_argnames="layout")


def _equations_at(parameters, problem: Problem) -> normal.Equations:
    return _equations(
        parameters, problem.views, problem.detections, LAYOUT, problem.frame
    )


@pytest.mark.parametrize("scale", [0.002, 0.3])
def test_equations_of_each_half_are_those_of_the_dense_jacobian(problem, scale):
    """Also where the guard against folding is at work, at the larger scale."""
    at = _at(scale)
    value = np.asarray(_value(at, problem))
    jacobian = np.asarray(_jacobian(at, problem))
    found = _equations_at(at, problem)
    for half in (0, 1):
        rows = jacobian[:, half::2].reshape(-1, len(at))
        values = value[:, half::2].ravel()
        dense = rows.T @ rows
        root = np.sqrt(np.diag(dense)) + 1e-30
        scale_of = np.outer(root, root)
        np.testing.assert_allclose(
            found.matrix[half] / scale_of, dense / scale_of, atol=1e-10
        )
        np.testing.assert_allclose(
            found.gradient[half] / root, rows.T @ values / root, rtol=1e-9, atol=1e-6
        )
        np.testing.assert_allclose(found.chi_squared[half], values @ values)


def test_batches_that_are_not_in_use_count_nothing(problem, monkeypatch):
    """As if none of their points were known, and whatever they hold."""
    monkeypatch.setattr(normal, "BATCH", 2)
    four = jax.tree.map(lambda a: a[:4] if a.ndim else a, problem.detections)
    nowhere = four.observed_mm.at[2:].set(jnp.nan)
    unused = four._replace(chunks=jnp.asarray(2), observed_mm=nowhere)
    unknown = four._replace(
        chunks=jnp.asarray(4), whitening=four.whitening.at[2:].set(0.0)
    )
    equations = jax.jit(normal.equations, static_argnames="layout")
    used, alone = (
        equations(_at(), problem.views, some, LAYOUT, problem.frame)
        for some in (unused, unknown)
    )
    for mine, expected in zip(used, alone, strict=True):
        np.testing.assert_allclose(mine, expected, rtol=1e-12, atol=1e-9)


def test_the_short_residual_has_the_same_equations(problem):
    """c.c is chi-squared with priors, its Jacobian gives their gradient and matrix."""
    at = _at()

    def short(parameters):
        value, found = short_residual(
            parameters, lambda y: both_halves(y, problem, LAYOUT), problem.prior
        )
        return value, (value, found)

    jacobian, (value, found) = jax.jit(jax.jacfwd(short, has_aux=True))(at)
    effective = jnp.where(problem.free > 0, at, problem.prior_mean)
    matrix, gradient, chi_squared = with_prior(
        with_statements(total(found), effective, problem.stated),
        effective,
        problem.prior,
    )
    root = np.sqrt(np.diag(matrix))
    scaled = np.outer(root, root)
    np.testing.assert_allclose(value @ value, chi_squared, rtol=1e-12)
    np.testing.assert_allclose(
        jacobian.T @ jacobian / scaled, matrix / scaled, atol=1e-10
    )
    np.testing.assert_allclose(value @ jacobian / root, gradient / root, rtol=1e-8)


def test_fixed_parameters_have_identity_rows(problem):
    found = _equations_at(_at(), problem)
    matrix, gradient, _ = with_prior(total(found), _at(), problem.prior)
    fixed = np.asarray(problem.free) == 0
    np.testing.assert_array_equal(matrix[fixed], np.eye(len(fixed))[fixed])
    assert not np.asarray(gradient)[fixed].any()
    assert np.asarray(matrix)[~fixed][:, ~fixed].any(1).all()
