"""Simulated photographs of dots: area coverage, blur, gradient, noise; truth known."""

import cv2
import numpy as np

from lensfit.photograph import Photograph


def photograph(pixels, **kwargs) -> Photograph:
    """A photograph without a file."""
    pixels = np.asarray(pixels, np.float32)
    pixels = pixels if pixels.ndim == 3 else pixels[..., None]
    return Photograph(pixels, path="simulated.exr", sha256="", **kwargs)


def coverage(size, centres, shapes, *, blur_px=0.0):
    """Fraction of each pixel covered by ellipses v' S^-1 v <= 1, blurred by a lens.

    The blur of small dots comes before the pixels, as in a camera; for large ones the
    order makes no difference.
    """
    fine = 4 if np.sqrt(shapes.max()) < 3 else 1
    size = np.array(size) * fine
    cover = _sharp_coverage(size, np.asarray(centres) * fine, shapes * fine**2)
    if blur_px:
        cover = cv2.GaussianBlur(cover, (0, 0), blur_px * fine)
    return cv2.resize(cover, size // fine, interpolation=cv2.INTER_AREA)


def _sharp_coverage(size, centres, shapes):
    """Along x the chords are exact; across, each pixel row is cut into fine rows."""
    width, height = size
    out = np.zeros((height, width))
    for centre, shape in zip(centres, shapes, strict=True):
        reach = np.sqrt(np.diag(shape))
        x0, y0 = np.maximum(np.floor(centre - reach).astype(int), 0)
        x1, y1 = np.minimum(np.ceil(centre + reach).astype(int), size)
        if x1 <= x0 or y1 <= y0:
            continue
        fine = 64 if reach[1] < 6 else 16
        y = (np.arange((y1 - y0) * fine) + 0.5) / fine + y0 - centre[1]
        (a, b), (_, c) = np.linalg.inv(shape)
        square = b * b * y * y - a * (c * y * y - 1)
        half = np.sqrt(np.maximum(square, 0)) / a
        middle = centre[0] - b * y / a
        edge = np.arange(x0, x1 + 1)
        chord = np.clip(edge, (middle - half)[:, None], (middle + half)[:, None])
        patch = np.diff(chord, axis=1).reshape(y1 - y0, fine, x1 - x0).mean(1)
        out[y0:y1, x0:x1] += patch
    return np.clip(out, 0, 1)


def discs(radius_px, count):
    """Round shapes of one radius, or of one radius each."""
    return np.eye(2) * np.broadcast_to(radius_px, count)[:, None, None] ** 2


def shaded(cover, polarity, *, contrast=0.8, field=1.0):
    """Bright dots on near black, or dark dots on a bright field."""
    if polarity == "bright":
        return field * (0.01 + contrast * cover)
    return field * (0.9 - contrast * cover)


def noisy(picture, seed, *, read=0.0, well=np.inf):
    """Add Gaussian read noise and the light's own noise for a full well at 1."""
    rng = np.random.default_rng(seed)
    variance = read**2 + np.maximum(picture, 0) / well
    return picture + rng.normal(size=picture.shape) * np.sqrt(variance)


def grid(columns, rows):
    """Lattice indices, row by row."""
    j, i = np.mgrid[:rows, :columns]
    return np.stack([i.ravel(), j.ravel()], 1)


def view(lattice, centre, pitch_px, *, angle_deg=0.0, tilt_deg=0.0, barrel=0.0):
    """Positions of a lattice seen rotated, tilted and through barrel distortion.

    `barrel` is the fraction by which the farthest point is drawn in. Tilt is about the
    vertical axis, with the camera two target widths away.
    """
    flat = (lattice - lattice.mean(0)) * pitch_px
    turn, tilt = np.deg2rad([angle_deg, tilt_deg])
    rotation = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    x, y = rotation @ flat.T
    distance = 2 * np.ptp(flat[:, 0])
    depth = 1 + x * np.sin(tilt) / distance
    points = np.stack([x * np.cos(tilt), y], 1) / depth[:, None]
    radius = np.linalg.norm(points, axis=1, keepdims=True)
    k = barrel / (1 - barrel) / radius.max() ** 2
    return points / (1 + k * radius**2) + centre


def same_lattice(found, true, *, turned=False):
    """Whether indices agree up to an offset (and a symmetry of the lattice)."""
    if not len(found):
        return False
    design = np.column_stack([true, np.ones(len(true))])
    affine = np.linalg.lstsq(design, found, rcond=None)[0]
    exact = np.abs(design @ np.rint(affine) - found).max() < 1e-6
    linear = np.rint(affine[:2])
    unit = np.array_equal(np.abs(linear @ linear.T), np.eye(2))
    return exact and (unit if turned else np.array_equal(linear, np.eye(2)))
