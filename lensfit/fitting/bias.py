"""Centroid of a dot's image minus the image of its centre.

The image of a dot of finite size, photographed obliquely or through distortion, is not
symmetric about the image of its centre: the near half is larger. The dot's radiance is
uniform, so its centroid is that of the area inside its outline, an integral along the
outline. The outline is interpolated by a trigonometric polynomial through eight points,
which is exact for every quadratic map, the leading term.

Check: for a flat dot tilted by `a` the shift is f (r/Z)^2 sin(a) cos(a).
"""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from lensfit.fitting import normal
from lensfit.fitting.geometry import BoardPose, Frame, predicted_mm
from lensfit.fitting.parameters import Layout
from lensfit.programs import kept_program

_CORNERS = 8
_ANGLES = 2 * np.pi * np.arange(_CORNERS) / _CORNERS
_OUTLINE = np.stack([np.cos(_ANGLES), np.sin(_ANGLES)], -1)
_APART = np.subtract.outer(np.arange(_CORNERS), np.arange(_CORNERS))
_SLOPE = (-1.0) ** _APART / 2 / np.tan(np.pi / _CORNERS * np.where(_APART, _APART, 4))
"""Derivative along the angle of the trigonometric polynomial through eight points."""


@kept_program(static_argnames=("layout",))
def centroid_shift_mm(
    parameters: Float[Array, " parameters"],
    views: BoardPose,
    view_of_chunk: Int[Array, " chunks"],
    board: Float[Array, "chunks marks 2"],
    radius_mm: Float[Array, " views"],
    layout: Layout,
    frame: Frame,
) -> Float[Array, "chunks marks 2"]:
    """Centroid of the image of each dot minus the image of its centre, mm.

    `radius_mm` is that of the dots on the board; zero gives zero.
    """
    shared, local = normal.split(parameters, layout)
    points = jnp.concatenate([jnp.zeros((1, 2)), jnp.asarray(_OUTLINE)])

    def shift(mark, own, view, radius):
        def image(point):
            around = mark + point * radius / view.half_board_mm
            return predicted_mm(around, shared, own, view, layout, frame)

        # One loop over the nine points keeps the program small.
        images = jax.lax.map(image, points)
        return _centroid(images[1:] - images[:1])

    def chunk_shifts(board, k):
        view = jax.tree.map(lambda a: a[k], views)
        of_marks = jax.vmap(shift, (0, None, None, None))
        return of_marks(board, local[k], view, radius_mm[k])

    shifts_mm = jax.vmap(chunk_shifts)(board, view_of_chunk)
    return jnp.where((radius_mm[view_of_chunk] > 0)[:, None, None], shifts_mm, 0.0)


def _centroid(outline: Float[Array, "corners 2"]) -> Float[Array, "2"]:
    """Centroid of the area inside an outline, relative to the origin inside it.

    From Green's theorem: 2/3 of the mean of the outline, weighed by x dy - y dx.
    """
    slope = jnp.asarray(_SLOPE, outline.dtype) @ outline
    cross = outline[:, 0] * slope[:, 1] - outline[:, 1] * slope[:, 0]
    area = jnp.sum(cross)
    safe = jnp.where(area == 0, 1.0, area)
    return 2 * (cross @ outline) / (3 * safe)
