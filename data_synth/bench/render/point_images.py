"""Point lights of a fitted lens in a frame, against `Lens.psf`; and few rays against
many on a picture with the spectrum of natural ones."""

from pathlib import Path

import numpy as np

import lensfit
from data_synth.bench.result import Row
from lensfit.coords import Window
from lensfit.lens import Lens
from lensfit.preset.schema import Preset
from lensfit.rendering.circle import Circle
from lensfit.rendering.frame import render
from lensfit.rendering.render_stages import DEFAULT_TOLERANCE, Switches
from lensfit.rendering.uv import PlateGeometry

_WIDTH, _HEIGHT = 768, 576
_RADII_PX = (0.0, -6.0, 12.0)
_PLACES = ((60, 60), (300, 288), (700, 520), (700, 60))
_HALF = 32
_FINEST = 3e-5
_SWITCHES = Switches(False, False, False)


def bundled_preset() -> Path | None:
    """A fitted prime lens, where lensfit runs from a checkout that has its presets."""
    path = Path(lensfit.__file__).parents[1] / "presets" / "prime_50" / "preset.json"
    return path if path.is_file() else None


def point_rows(preset: Preset, *, quick: bool = False) -> list[Row]:
    """Errors over field and depth at the default tolerance.

    Parameters
    ----------
    quick : At one radius of blur only.
    """
    entry = preset.entries[0]
    lens = preset.at(
        focal_length_mm=entry.focal_length_mm,
        focus_distance_mm=entry.focus_distance_mm,
    )
    geometry = PlateGeometry.of(lens, Window.of_size(_WIDTH, _HEIGHT))
    circle = Circle.of(lens, geometry)
    farthest = -0.9 * circle.px_mm * circle.focus_vergence
    radii = [max(r, farthest) for r in (_RADII_PX[1:2] if quick else _RADII_PX)]
    depths = [circle.depth_mm(radius) for radius in radii]
    errors = np.concatenate([_light_errors(lens, geometry, mm) for mm in depths])
    squares = [_ray_error(lens, mm) for mm in depths]
    psnr_db = float(-10 * np.log10(np.mean(squares)))
    return [
        Row("points", "relative L2, median over field", float(np.median(errors)), 0.05),
        Row("points", "relative L2, 90th percentile", float(np.quantile(errors, 0.9))),
        Row("points", "1/f picture, PSNR, dB", psnr_db, bar=50.0, least=True),
    ]


def _light_errors(lens: Lens, geometry: PlateGeometry, depth_mm: float) -> np.ndarray:
    """Images of bright points in the frame, relative to `Lens.psfs`."""
    picture = np.full((_HEIGHT, _WIDTH, 3), 1e-6, np.float32)
    for x, y in _PLACES:
        picture[y, x] = 1000.0
    depth = np.full((_HEIGHT, _WIDTH), depth_mm, np.float32)
    found = render(picture, depth, lens, switches=_SWITCHES) / 1000.0
    pitch_mm = geometry.area_mm[0] / _WIDTH
    exact = lens.psfs(
        geometry.mm(np.array(_PLACES) + 0.5),
        depth_mm + float(lens.entrance_pupil_offset_mm),
        pixel_pitch_mm=pitch_mm,
        size_px=2 * _HALF + 1,
        with_lateral_colour=False,
    )
    padded = np.pad(found, ((_HALF, _HALF), (_HALF, _HALF), (0, 0)))
    errors = []
    for (x, y), kernels in zip(_PLACES, np.asarray(exact), strict=True):
        patch = np.moveaxis(padded[y : y + 2 * _HALF + 1, x : x + 2 * _HALF + 1], -1, 0)
        away = np.linalg.norm(patch - kernels, axis=(1, 2))
        errors.append(away / np.linalg.norm(kernels, axis=(1, 2)))
    return np.concatenate(errors)


def _ray_error(lens: Lens, depth_mm: float) -> float:
    """Mean squared error of a picture at the default tolerance, against many rays."""
    picture = np.repeat(one_over_f()[..., None], 3, -1)
    depth = np.full((_HEIGHT, _WIDTH), depth_mm, np.float32)
    found, finest = (
        render(picture, depth, lens, switches=_SWITCHES, tolerance=tolerance)
        for tolerance in (DEFAULT_TOLERANCE, _FINEST)
    )
    return float(np.mean((found - finest) ** 2))


def one_over_f() -> np.ndarray:
    """A picture with the spectrum of natural ones, mean 0.5, deviation 0.2."""
    noise = np.random.default_rng(0).standard_normal((_HEIGHT, _WIDTH))
    x, y = np.fft.fftfreq(_WIDTH), np.fft.fftfreq(_HEIGHT)[:, None]
    frequency = np.hypot(x, y)
    frequency[0, 0] = 1
    made = np.fft.ifft2(np.fft.fft2(noise) / frequency).real
    return (0.5 + 0.2 * (made - made.mean()) / made.std()).astype(np.float32)
