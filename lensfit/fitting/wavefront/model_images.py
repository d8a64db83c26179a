"""Model images of dots behind a mosaic, on the cells of their patches.

In all colours, of a brightness of 1 each, and with the sharp edges that dot apertures
have. Behind a mosaic the fit takes dot apertures for Gaussians (`known_dots`). At the
finest detail, which is what aliases, a Gaussian of 1.5 pixels has three times as much
as a disc.
"""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from scipy.special import j1

from lensfit.batches import in_batches
from lensfit.fitting.wavefront.dot_arrays import Dots
from lensfit.fitting.wavefront.dot_data import DotData
from lensfit.fitting.wavefront.normal import as_float32
from lensfit.fitting.wavefront.parameters import Layout, Scale
from lensfit.fitting.wavefront.rays import spot_and_pullback
from lensfit.fitting.wavefront.shapes import Colour, colours_of
from lensfit.fitting.wavefront.stages import Stage, with_iris
from lensfit.fitting.wavefront.waves import Transfer, basis_of
from lensfit.psf.spot import diffraction_variance_mm2, image_of

_BATCH = 512


def model_images(
    stage: Stage, dot_data: DotData, place_mm: Float[np.ndarray, "dots 3 2"]
) -> Float[np.ndarray, "dots 3 rows columns"]:
    """Light of every cell.

    Parameters
    ----------
    stage : Where the fit ended.
    dot_data : The dots, which need not be those of the fit.
    place_mm : Of each channel's chief ray, from the corner of the cells.
    """
    dots, cells = with_iris(dot_data, stage.blades), dot_data.light.shape[-1]
    image = in_batches(
        lambda part: _images(
            as_float32(jnp.asarray(stage.parameters)),
            jax.tree.map(as_float32, part),
            as_float32(jnp.asarray(dot_data.wavelengths_nm)),
            stage.layout,
            jax.tree.map(as_float32, dot_data.scale),
            (stage.points.image, cells),
        ),
        (dots, dot_data.transfer, -place_mm),
        _BATCH,
    ).astype(float)
    # Behind cylinders a dot aperture is no disc; a broad dot is drawn with its rims.
    if dots.sections is not None or dots.broad is not None:
        return image
    f_number = jnp.asarray(dot_data.f_numbers)[dots.stop]
    variance_mm2 = dots.variance_mm2.mean(-1)
    variance_mm2 = variance_mm2 - np.asarray(diffraction_variance_mm2(f_number))
    radius = 2 * np.sqrt(np.maximum(variance_mm2, 0.0)) / dots.cell_mm[:, 0]
    return sharp_edged_images(image, radius)


@partial(jax.jit, static_argnames=("layout", "points_and_cells"))
def _images(
    parameters: Array,
    part: tuple[Dots, Transfer | None, Array],
    wavelengths_nm: Array,
    layout: Layout,
    scale: Scale,
    points_and_cells: tuple[int, int],
) -> Array:
    """Dots of all channels on their cells, each of a brightness of 1; dot apertures
    that are not broad as Gaussians."""
    points, cells = points_and_cells

    def of_dot(one: tuple[Dots, Transfer | None, Array]) -> Array:
        dot, transfer, corners_mm = one

        def channel(colour: Colour, corner_mm: Array) -> Array:
            spot, _ = spot_and_pullback(parameters, dot, colour, layout, scale, points)
            basis = basis_of(corner_mm, dot.cell_mm, cells, transfer)
            profile = basis.profile(spot, dot.variance_mm2)
            return basis.cell_light(image_of(spot, profile))

        colours = colours_of(parameters, dot, wavelengths_nm, layout)
        return jax.vmap(channel)(colours, corners_mm)

    return jax.lax.map(of_dot, part)


def sharp_edged_images(
    image: Float[np.ndarray, "dots 3 rows columns"], radius: Float[np.ndarray, " dots"]
) -> Float[np.ndarray, "dots 3 rows columns"]:
    """Images of Gaussian dot apertures as those of discs of the same second moments.

    Parameters
    ----------
    radius : Of the discs, in cells.
    """
    size = image.shape[-1]
    wave = 2 * np.pi * np.hypot(np.fft.fftfreq(size)[:, None], np.fft.rfftfreq(size))
    x = np.maximum(radius[:, None, None, None] * wave, 1e-9)
    ratio = 2 * j1(x) / x * np.exp(x**2 / 8)
    return np.fft.irfft2(np.fft.rfft2(image) * ratio, s=(size, size))
