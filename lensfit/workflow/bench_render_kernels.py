"""Kernels that vary over the frame, against a kernel of its own for every pixel."""

import time

import numpy as np

from lensfit.coords import Window
from lensfit.preset.schema import Preset
from lensfit.render.brute import exact_bank, exact_block
from lensfit.render.frame import render_stages
from lensfit.render.kernel_bank import RGB
from lensfit.render.stages import Stages, Switches, prepare_stages
from lensfit.workflow.bench_rows import Row

_WIDTH, _HEIGHT = 768, 576
_BLOCK_PX = 4
_RADII_PX = (0.0, -6.0, 6.0)
_AMPLITUDE = 0.02


def kernel_rows(preset: Preset) -> list[Row]:
    """Errors over field and depth at the default tolerance; time over brute force."""
    lens = preset.at(
        focal_length_mm=preset.entries[0].focal_length_mm,
        focus_distance_mm=preset.entries[0].focus_distance_mm,
    )
    frame = Window.of_size(_WIDTH, _HEIGHT)
    stages = prepare_stages(lens, frame, frame, switches=Switches(False, False, False))
    picture = one_over_f()
    kernels: list[float] = []
    squares: list[float] = []
    brute_s, first_s, next_s = 0.0, 0.0, 0.0
    for radius in _RADII_PX:
        assert stages.defocus is not None
        radius = max(radius, 0.9 * stages.defocus.circle.radius_px(np.float32(np.inf)))
        depth = np.full(
            picture.shape, stages.defocus.circle.depth_mm(radius), np.float32
        )
        began = time.perf_counter()
        found = _render(picture, depth, stages)
        first_s += time.perf_counter() - began
        began = time.perf_counter()
        _render(picture, depth, stages)
        next_s += time.perf_counter() - began
        for x, y in ((60, 40), (384, 288), (650, 480)):
            block = Window(x, y, x + _BLOCK_PX - 1, y + _BLOCK_PX - 1)
            began = time.perf_counter()
            exact = exact_block(picture, radius, block, stages.defocus)
            brute_s += time.perf_counter() - began
            part = found[y : y + _BLOCK_PX, x : x + _BLOCK_PX, 1]
            squares.append(float(np.mean((part - exact) ** 2)))
        kernels += _kernel_errors(radius, depth, stages)
    per_pixel = brute_s / (len(_RADII_PX) * 3 * _BLOCK_PX**2)
    share = first_s / len(_RADII_PX) / (per_pixel * picture.size)
    return [
        Row("kernels", "relative L2, median over field", _median(kernels), bar=0.05),
        Row(
            "kernels", "relative L2, 90th percentile", float(np.quantile(kernels, 0.9))
        ),
        Row(
            "kernels",
            "1/f picture, PSNR, dB",
            float(-10 * np.log10(np.mean(squares))),
            bar=50.0,
            least=True,
        ),
        Row(
            "kernels",
            "time over brute force, kernels made",
            share,
            bar=0.1,
            peers={"brute, s per pixel": per_pixel, "next frame, s": next_s / 3},
        ),
    ]


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


def _ninth_tenth(values: list[float]) -> float:
    return float(np.quantile(values, 0.9))


def _median(values: list[float]) -> float:
    return float(np.median(values))
