"""One level of depth, blurred in tiles: what it shows, and how much it hides.

For a level k with kernel K_k, of everything that the pinhole sees (or that was filled
in behind it),

    a_k   coverage of what lies on the level
    l_k   its light, premultiplied
    E_k   1 where what is on or behind the level is known, 0 where nearer things hide it

the level shows (K_k * l_k) / (K_k * E_k) and hides the share
(K_k * a_k) / (K_k * E_k) of what lies behind. The division continues a surface under
what stands before it, so that no darkness leaks from there, and keeps a constant
constant whatever the kernels.

The convolution is a product of Fourier transforms of a tile and its surroundings. Where
kernels change over the frame, each source pixel's light is dealt to the four nodes
around it before it is spread (so none is lost), by weights that are bilinear in its
position; weights run on linearly into the surroundings of the tile.

Pure JAX: the same programs run on a GPU. Compiled for each size of tile, not of frame.

References
----------
Normalised layers: H. Ikoma et al., ICCP 2021. Spreading with interpolated kernels:
L. Denis et al., IJCV 115, 2015.
"""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Complex64, Float32, Int, Int16

_LEAST_KNOWN = 1e-3
"""Where less than this of the kernel's light is known, nothing is shown or hidden."""

_FAR_LEVEL = np.int32(1 << 20)

Layers = Float32[Array, "layers height width 4"]
Indices = Int16[Array, "layers height width"]


def kernel_transforms(
    kernels: Float32[np.ndarray, "nodes channels size size"], *, room: int
) -> Complex64[Array, "nodes channels room half"]:
    """Transforms of kernels, their middle at the origin, in tiles of `room` pixels.

    They are laid out before they are handed over, so that one program serves all sizes:
    with an animated focus every frame has its own.
    """
    half = kernels.shape[-1] // 2
    spare = room - kernels.shape[-1]
    padded = np.pad(kernels, ((0, 0), (0, 0), (0, spare), (0, spare)))
    return _transformed(np.roll(padded, (-half, -half), (-2, -1)))


@jax.jit
def _transformed(
    planes: Float32[Array, "nodes channels room room"],
) -> Complex64[Array, "nodes channels room half"]:
    return jnp.fft.rfft2(planes)


@partial(jax.jit, static_argnames=("tile", "room"))
def blurred_tiles(
    rgba: Layers,
    index: Indices,
    corners: Int[Array, "tiles 2"],
    level: Int[Array, ""],
    transforms: Complex64[Array, "nodes channels room half"],
    nodes: Int[Array, "tiles corners"],
    cells: Float32[Array, "tiles 4"],
    *,
    tile: int,
    room: int,
) -> tuple[Float32[Array, "tiles tile tile 3"], Float32[Array, "tiles tile tile c"]]:
    """What a level shows and hides over some tiles.

    Parameters
    ----------
    rgba, index : Layers front to back with a margin, and the level of each pixel.
    corners : Row and column, in those arrays, of the first pixel of the surroundings.
    level : Which.
    transforms : Of its kernels at all nodes; one channel, or three.
    nodes : The four nodes around each tile, or one: top left, top right, bottom ...
    cells : Left, top, width and height of each tile's cell, px, counted from `corners`.
    """
    light, cover, known = _patches(rgba, index, corners, level, room)
    planes = jnp.concatenate([light, cover[..., None], known[..., None]], -1)
    planes = jnp.moveaxis(planes, -1, 1)  # tiles, 5, room, room
    if nodes.shape[1] == 4:
        weights = _bilinear(cells, room)
        planes = planes[:, None] * weights[:, :, None]
    else:
        planes = planes[:, None]
    spectra = jnp.fft.rfft2(planes)  # tiles, corners, 5, room, half
    response = transforms[nodes]  # tiles, corners, channels, room, half
    colours = (spectra[:, :, :3] * response).sum(1)
    masks = (spectra[:, :, 3:, None] * response[:, :, None]).sum(1)
    margin = (room - tile) // 2
    inside = slice(margin, margin + tile)
    shown = jnp.fft.irfft2(colours, (room, room))[..., inside, inside]
    # Beside a light of 1e5 times white, rounding would leave black below zero.
    has_negative = (light < 0).any((1, 2))[..., None, None]
    shown = jnp.where(has_negative, shown, jnp.maximum(shown, 0))
    both = jnp.fft.irfft2(masks, (room, room))[..., inside, inside]
    hidden, reach = both[:, 0], both[:, 1]
    seen = reach > _LEAST_KNOWN
    share = jnp.where(seen, 1 / jnp.where(seen, reach, 1), 0)
    return (
        jnp.moveaxis(shown * share, 1, -1),
        jnp.moveaxis(jnp.clip(hidden * share, 0, 1), 1, -1),
    )


@partial(jax.jit, static_argnames=("tile",))
def sharp_tiles(
    rgba: Layers,
    index: Indices,
    corners: Int[Array, "tiles 2"],
    level: Int[Array, ""],
    *,
    tile: int,
) -> tuple[Float32[Array, "tiles tile tile 3"], Float32[Array, "tiles tile tile 1"]]:
    """`blurred_tiles` of a level whose kernel is a single pixel."""
    light, cover, _ = _patches(rgba, index, corners, level, tile)
    return light, cover[..., None]


def _patches(
    rgba: Array, index: Array, corners: Array, level: Array, room: int
) -> tuple[Array, Array, Array]:
    """Light, coverage and what is known of a level, over tiles with surroundings."""
    layers = rgba.shape[0]

    def cut(corner: Array) -> tuple[Array, Array]:
        y, x = corner[0], corner[1]
        none = jnp.zeros((), corner.dtype)
        return (
            jax.lax.dynamic_slice(rgba, (none, y, x, none), (layers, room, room, 4)),
            jax.lax.dynamic_slice(index, (none, y, x), (layers, room, room)),
        )

    colour, at = jax.vmap(cut)(corners)
    on_it = jnp.zeros_like(colour[:, 0])
    for i in reversed(range(layers)):  # back to front
        here = colour[:, i]
        over = here + on_it * (1 - here[..., 3:])
        on_it = jnp.where((at[:, i] == level)[..., None], over, on_it)
    known = _known(colour[..., 3], at.astype(jnp.int32), level.astype(jnp.int32))
    return on_it[..., :3], on_it[..., 3], known.astype(on_it.dtype)


def _known(alpha: Array, at: Array, level: Array) -> Array:
    """What is known of a level or of what lies behind it, 0 to 1, at each pixel.

    Where the first thing on or behind the level was filled in behind a nearer one, a
    level closer to the nearer one counts as the other side of that same surface, which
    nobody knows there: a curved thing must not let through what is behind it.
    """
    unhidden = jnp.ones_like(alpha[:, 0])
    known, decided = jnp.zeros_like(unhidden), jnp.zeros(unhidden.shape, bool)
    nearer = jnp.full(unhidden.shape, _FAR_LEVEL)
    for i in range(alpha.shape[1]):
        there, own = alpha[:, i] > 0, at[:, i]
        behind = there & (own <= level)
        close = level - own <= nearer - level
        known = jnp.where(behind & ~decided, jnp.where(close, 1, unhidden), known)
        decided = decided | behind
        in_front = there & ~decided
        unhidden = unhidden * jnp.where(in_front, 1 - alpha[:, i], 1)
        nearer = jnp.where(in_front, own, nearer)
    return jnp.where(decided, known, unhidden)


def _bilinear(cells: Array, room: int) -> Array:
    """Weights of the four nodes over each tile: (tiles, 4, room, room)."""
    centre = jnp.arange(room, dtype=jnp.float32) + 0.5
    u = (centre[None] - cells[:, :1]) / cells[:, 2:3]
    v = (centre[None] - cells[:, 1:2]) / cells[:, 3:4]
    across = jnp.stack([1 - u, u], 1)
    down = jnp.stack([1 - v, v], 1)
    both = down[:, :, None, :, None] * across[:, None, :, None, :]
    return both.reshape(cells.shape[0], 4, room, room)
