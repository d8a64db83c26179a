"""The kernel of a lens without measured blur: a thin lens' disc, in closed form.

Such a lens counts as perfect (`lensfit.psf.lens_blur.perfect_blur`); its blur is one
disc all over the frame, to some 3 % of `Lens.psf`, and costs no rays. Diffraction is
left out, so the disc serves only where that is much smaller than a pixel.
"""

import numpy as np
from jaxtyping import Float32

_ROWS = 16
"""Chords per pixel; along a chord the integral is exact."""
_UNSEEN_PX = 0.15
_WAVELENGTH_MM = 5.5e-4
_AIRY_SIGMA = 0.42


def disc_kernel(
    radius_px: float, half: int, finer: int = 1
) -> Float32[np.ndarray, "size size"]:
    """Share of a disc's light in each pixel; sums to 1.

    Parameters
    ----------
    radius_px : In pixels of the plate; its sign does not matter.
    half : Pixels of the kernel on either side of the middle one.
    finer : Pixels of the kernel per pixel of the plate.
    """
    radius = abs(radius_px) * finer
    size = 2 * half + 1
    rows = (np.arange(size * _ROWS) + 0.5) / _ROWS - size / 2
    chord = np.sqrt(np.maximum(radius * radius - rows * rows, 0))[:, None]
    edges = np.arange(size + 1) - size / 2
    inside = np.clip(edges[None], -chord, chord)
    shares = np.diff(inside, axis=1).reshape(size, _ROWS, size).sum(1)
    if shares.sum() <= 0 or radius < 1 / _ROWS:
        shares = np.zeros((size, size))
        shares[half, half] = 1
    return (shares / shares.sum()).astype(np.float32)


def diffracts(f_number: float, pixel_pitch_mm: float) -> bool:
    """Whether diffraction widens the blur by what a pixel may show."""
    sigma_mm = _AIRY_SIGMA * _WAVELENGTH_MM * f_number
    return sigma_mm > _UNSEEN_PX * pixel_pitch_mm
