"""Kernels that vary over the frame, against a kernel of its own for every pixel."""

from pathlib import Path
from typing import NamedTuple

import numpy as np

import lensfit
from lensfit.coords import Window
from lensfit.preset.schema import Preset
from lensfit.render.brute import exact_bank, exact_block
from lensfit.render.frame import render_stages
from lensfit.render.kernel_bank import RGB
from lensfit.render.stages import Stages, Switches, prepare_stages
from lensfit.workflow.bench.rows import Row
from lensfit.workflow.bench.times import timed
from lensfit.workflow.stopwatch import stopwatch

_WIDTH, _HEIGHT = 768, 576
_BLOCK_PX = 4
_BLOCKS = ((60, 40), (384, 288), (650, 480))
_RADII_PX = (0.0, -6.0, 6.0)
_AMPLITUDE = 0.02


def bundled_preset() -> Path | None:
    """A fitted prime lens, where lensfit runs from a checkout that has its presets."""
    path = Path(lensfit.__file__).parents[1] / "presets" / "prime_50" / "preset.json"
    return path if path.is_file() else None


def kernel_rows(preset: Preset, *, quick: bool = False) -> list[Row]:
    """Errors over field and depth at the default tolerance; time over brute force.

    Parameters
    ----------
    quick : At one radius of blur only.
    """
    lens = preset.at(
        focal_length_mm=preset.entries[0].focal_length_mm,
        focus_distance_mm=preset.entries[0].focus_distance_mm,
    )
    frame = Window.of_size(_WIDTH, _HEIGHT)
    stages = prepare_stages(lens, frame, frame, switches=Switches(False, False, False))
    picture = one_over_f()
    radii_px = _RADII_PX[1:2] if quick else _RADII_PX
    found = [_at_radius(picture, radius, stages) for radius in radii_px]
    kernels = np.concatenate([one.kernels for one in found])
    squares = np.concatenate([one.squares for one in found])
    brute, first, after = (
        float(np.mean([getattr(one, name) for one in found]))
        for name in ("brute_s", "first_s", "next_s")
    )
    share = first / (brute * picture.size)
    psnr_db = float(-10 * np.log10(squares.mean()))
    peers = {"brute, s per pixel": brute, "first frame, s": first, "next, s": after}
    median, most = float(np.median(kernels)), float(np.quantile(kernels, 0.9))
    return [
        Row("kernels", "relative L2, median over field", median, bar=0.05),
        Row("kernels", "relative L2, 90th percentile", most),
        Row("kernels", "1/f picture, PSNR, dB", psnr_db, bar=50.0, least=True),
        Row("kernels", "time over brute force", share, bar=0.1, peers=peers),
    ]


class _AtRadius(NamedTuple):
    """Relative errors of kernels, squared errors of blocks, seconds: per pixel by brute
    force, of the first frame, of the next."""

    kernels: list[float]
    squares: list[float]
    brute_s: float
    first_s: float
    next_s: float


def _at_radius(picture: np.ndarray, radius_px: float, stages: Stages) -> _AtRadius:
    defocus = stages.defocus
    assert defocus is not None
    farthest = -defocus.circle.px_mm * defocus.circle.focus_vergence
    radius = max(radius_px, 0.9 * farthest)
    depth = np.full(picture.shape, defocus.circle.depth_mm(radius), np.float32)
    found, times = timed(lambda: _render(picture, depth, stages), 2)
    squares = []
    with stopwatch() as brute:
        for x, y in _BLOCKS:
            block = Window(x, y, x + _BLOCK_PX - 1, y + _BLOCK_PX - 1)
            exact = exact_block(picture, radius, block, defocus)
            part = found[y : y + _BLOCK_PX, x : x + _BLOCK_PX, 1]
            squares.append(float(np.mean((part - exact) ** 2)))
    brute_s = brute["seconds"] / (len(_BLOCKS) * _BLOCK_PX**2)
    errors = _kernel_errors(radius, depth, stages)
    return _AtRadius(errors, squares, brute_s, times.first_s, times.steady_s)


def one_over_f() -> np.ndarray:
    """A picture with the spectrum of natural ones, mean 0.5, deviation 0.2."""
    noise = np.random.default_rng(0).standard_normal((_HEIGHT, _WIDTH))
    x, y = np.fft.fftfreq(_WIDTH), np.fft.fftfreq(_HEIGHT)[:, None]
    frequency = np.hypot(x, y)
    frequency[0, 0] = 1
    made = np.fft.ifft2(np.fft.fft2(noise) / frequency).real
    return (0.5 + 0.2 * (made - made.mean()) / made.std()).astype(np.float32)


def _render(picture: np.ndarray, depth: np.ndarray, stages: Stages) -> np.ndarray:
    colour = np.repeat(picture[..., None], 3, -1)
    return render_stages(colour, stages.window, stages, stages.window, depth_mm=depth)


def _kernel_errors(radius: float, depth: np.ndarray, stages: Stages) -> list[float]:
    """Points too dim to count as highlights, so that the tiles make their image."""
    defocus = stages.defocus
    assert defocus is not None
    bank, level = exact_bank(defocus), defocus.levels.between(radius)
    places = [(x, y) for x in (60, 300, 700) for y in (60, 288, 520)]
    exact = bank.at(np.array(places) + 0.5, level, RGB)
    half = exact.shape[-1] // 2
    ground = np.full(depth.shape, 0.5, np.float32)
    without = _render(ground, depth, stages)
    errors = []
    for (x, y), kernels in zip(places, exact, strict=True):
        dotted = ground.copy()
        dotted[y, x] += _AMPLITUDE
        light = (_render(dotted, depth, stages) - without) / _AMPLITUDE
        padded = np.pad(light, ((half, half), (half, half), (0, 0)))
        patch = np.moveaxis(padded[y : y + 2 * half + 1, x : x + 2 * half + 1], -1, 0)
        away = np.linalg.norm(patch - kernels, axis=(1, 2))
        errors += (away / np.linalg.norm(kernels, axis=(1, 2))).tolist()
    return errors
