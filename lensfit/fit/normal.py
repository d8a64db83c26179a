"""Normal equations of the geometric fit, built from the structure of the problem.

A mark depends on the shared parameters and on those of its own photograph only, so
its Jacobian is taken with respect to those, and the products are gathered into the
full matrix: cost grows with the marks, not with marks times photographs. Parameters
are scaled and carry priors, which keeps the matrix well within float64.
"""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from lensfit.fit.geometry import Frame, View, whitened_residual
from lensfit.fit.parameters import Layout


def split(parameters: Array, layout: Layout) -> tuple[Array, Array]:
    """Shared parameters, and one row of local ones for each view."""
    local = parameters[layout.shared :].reshape(-1, layout.local)
    return parameters[: layout.shared], local


def residuals(
    parameters: Float[Array, " parameters"], views: View, layout: Layout, frame: Frame
) -> Float[Array, "views marks 2"]:
    """Whitened residuals of all marks of all (stacked) views."""
    shared, local = split(parameters, layout)
    each = jax.vmap(whitened_residual, (None, 0, 0, None, None))
    return each(shared, local, views, layout, frame)


def jacobian_blocks(
    parameters: Float[Array, " parameters"],
    views: View,
    layout: Layout,
    frame: Frame,
) -> tuple[Float[Array, "views rows both"], Float[Array, "views rows"]]:
    """Per view: d residual / d (shared, own local), and the residual."""
    shared, local = split(parameters, layout)

    def one(own, view):
        both = jnp.concatenate([shared, own])

        def flat(both):
            r = whitened_residual(
                both[: layout.shared], both[layout.shared :], view, layout, frame
            )
            return r.reshape(-1)

        value, push = jax.linearize(flat, both)
        unit = jnp.eye(both.size, dtype=both.dtype)
        return jax.vmap(push, out_axes=1)(unit), value

    return jax.vmap(one)(local, views)


def gather(
    blocks: Float[Array, "views rows both"],
    values: Float[Array, "views rows"],
    local: int,
) -> tuple[Float[Array, "parameters parameters"], Float[Array, " parameters"]]:
    """J^T J and J^T r of the whole problem: shared ones first, then each view's."""
    views = blocks.shape[0]
    k = blocks.shape[2] - local
    products = jnp.einsum("vra,vrb->vab", blocks, blocks)
    gradients = jnp.einsum("vra,vr->va", blocks, values)
    n = k + local * views
    rows = k + jnp.arange(local * views).reshape(views, local)
    shared = jnp.arange(k)
    matrix = jnp.zeros((n, n), blocks.dtype)
    matrix = matrix.at[:k, :k].set(jnp.sum(products[:, :k, :k], 0))
    across = products[:, :k, k:]
    matrix = matrix.at[shared[None, :, None], rows[:, None, :]].set(across)
    matrix = matrix.at[rows[:, :, None], shared[None, None, :]].set(
        jnp.swapaxes(across, 1, 2)
    )
    matrix = matrix.at[rows[:, :, None], rows[:, None, :]].set(products[:, k:, k:])
    gradient = jnp.concatenate(
        [jnp.sum(gradients[:, :k], 0), gradients[:, k:].reshape(-1)]
    )
    return matrix, gradient
