"""Kernels that change over the frame and with colour, against one for every pixel."""

from types import SimpleNamespace

import cv2
import numpy as np
import pytest
from radial_lens import IdentityLens

from lensfit.coords import Window
from lensfit.errors import LensfitError
from lensfit.lens import Lens
from lensfit.render.brute import exact_block
from lensfit.render.frame import render
from lensfit.render.kernel_bank import RGB
from lensfit.render.plate_defocus import Defocus
from lensfit.render.uv import PlateGeometry

WIDTH, HEIGHT = 180, 120
FRAME = Window.of_size(WIDTH, HEIGHT)


class SwellingLens(IdentityLens):
    """Gaussian kernels that are wider to the right, wider again in blue, and whose
    middle wanders to the right too."""

    blur = SimpleNamespace(reference_distance_mm=2000.0, is_ideal=False)
    entrance_pupil_offset_mm = 0.0
    distortion = SimpleNamespace(principal_distance_mm=36.0)
    largest_blur_mm = None
    blue_grows = 1.15
    blur_per_vergence = Lens.blur_per_vergence

    def psfs(
        self, points, distances, channels, *, pixel_pitch_mm, size_px, tolerance, **_
    ):
        across = np.asarray(points)[:, 0] / 36.0 + 0.5
        t = (np.arange(size_px) - size_px // 2) * pixel_pitch_mm / 0.2
        found = []
        for u in across:
            for channel in channels:
                sigma = (1.2 + 1.6 * u) * (self.blue_grows if channel == "b" else 1)
                row = np.exp(-((t - 0.8 * u) ** 2) / (2 * sigma**2))
                kernel = np.exp(-(t**2) / (2 * sigma**2))[:, None] * row
                found.append(kernel / kernel.sum())
        shape = (len(across), len(channels), size_px, size_px)
        return np.reshape(found, shape)


def defocus_of(lens):
    return Defocus(lens, PlateGeometry.of(lens, FRAME), 1e-3)


def smooth_noise():
    values = np.random.default_rng(5).uniform(0, 1, (HEIGHT, WIDTH)).astype(np.float32)
    return 3 * (cv2.GaussianBlur(values, (0, 0), 1.5) - 0.5) + 0.5


def test_a_picture_agrees_with_a_kernel_for_every_pixel():
    lens, picture = SwellingLens(), smooth_noise()
    depth = np.full(picture.shape, 3000.0, np.float32)
    found = render(np.repeat(picture[..., None], 3, -1), depth, lens)
    defocus = defocus_of(lens)
    radius = float(defocus.circle.radius_px(depth[:1, :1])[0, 0])
    for x, y in ((40, 30), (130, 80)):
        block = Window(x, y, x + 5, y + 5)
        for index, channel in enumerate(RGB):
            exact = exact_block(picture, radius, block, defocus, channel)
            part = found[y : y + 6, x : x + 6, index]
            assert np.sqrt(np.mean((part - exact) ** 2)) < 3e-3  # 50 dB


def test_the_image_of_a_point_is_within_five_percent_everywhere():
    lens = SwellingLens()
    depth = np.full((HEIGHT, WIDTH), 3000.0, np.float32)
    ground = np.full((HEIGHT, WIDTH, 3), 0.5, np.float32)
    flat = render(ground, depth, lens)
    assert np.abs(flat - 0.5).max() < 1e-5
    errors = []
    for x, y in ((30, 40), (77, 60), (100, 80), (150, 50)):
        dotted = ground.copy()
        dotted[y, x] += 0.05
        light = (render(dotted, depth, lens) - flat) / 0.05
        point = PlateGeometry.of(lens, FRAME).mm(np.array([[x + 0.5, y + 0.5]]))
        exact = lens.psfs(
            point, None, RGB, pixel_pitch_mm=0.2, size_px=41, tolerance=None
        )[0]
        patch = light[y - 20 : y + 21, x - 20 : x + 21]
        away = np.linalg.norm(np.moveaxis(patch, -1, 0) - exact, axis=(1, 2))
        errors += (away / np.linalg.norm(exact, axis=(1, 2))).tolist()
    assert np.median(errors) < 0.05
    assert max(errors) < 0.1


def test_colours_of_one_kernel_share_it():
    levels = {0: 0.0}
    assert defocus_of(SwellingLens()).setup(FRAME, levels).chromatic
    plain = SwellingLens()
    plain.blue_grows = 1.0
    setup = defocus_of(plain).setup(FRAME, levels)
    assert not setup.chromatic
    assert setup.grid.varies


def test_a_probe_foresees_what_the_kernels_come_to():
    """From a few kernels, the same levels, grid and colours; reach and tiles nearly."""
    defocus = defocus_of(SwellingLens())
    found = {n: float(n) for n in range(-12, 13)}
    foreseen, made = defocus.probe(FRAME, found), defocus.setup(FRAME, found)
    assert foreseen.levels == made.levels
    assert (foreseen.grid, foreseen.chromatic) == (made.grid, made.chromatic)
    assert foreseen.rooms.keys() == made.rooms.keys()
    for level in made.levels:
        assert abs(foreseen.reaches[level] - made.reaches[level]) <= 1
    assert foreseen.tile == made.tile


def test_a_plan_makes_few_kernels():
    class CountingLens(SwellingLens):
        asked = 0

        def psfs(self, points, distances, channels, **options):
            CountingLens.asked += len(points) * len(channels)
            return super().psfs(points, distances, channels, **options)

    lens = CountingLens()
    found = {n: float(n) for n in range(-12, 13)}
    defocus_of(lens).probe(FRAME, found)
    planned = lens.asked
    defocus_of(lens).setup(FRAME, found)
    assert planned < 0.7 * (lens.asked - planned)


def test_blur_too_wide_to_convolve_is_refused(monkeypatch):
    defocus = defocus_of(SwellingLens())
    monkeypatch.setattr("lensfit.render.tile_sides._TILES", ((1, 64), (2, 128)))
    for asked in (defocus.setup, defocus.probe):
        with pytest.raises(LensfitError, match=r"blur reaches [\d.]+ px, and 2 px is"):
            asked(FRAME, {12: 12.0})
