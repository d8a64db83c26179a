"""The lens' dots land where its chief rays do, with all their light."""

import numpy as np
import pytest
from ideal_lens import HEIGHT, WIDTH, depth_of, ideal_lens
from radial_lens import RadialLens

from lensfit.coords import Window
from lensfit.rendering import lens_pictures
from lensfit.rendering.lens_pictures import aberration_dots, kernel_mosaic
from lensfit.rendering.uv import PlateGeometry

DISPLAY = Window(10, 20, 249, 179)


class SpotLens(RadialLens):
    """Blur is a spot of two fine Gaussians, red beside the others."""

    def psfs(
        self, points_mm, object_distance_mm, *, pixel_pitch_mm, size_px, tolerance
    ):
        at = (np.arange(size_px) + 0.5 - size_px / 2) * pixel_pitch_mm
        kernels = []
        for shift_mm in (0.2, 0, 0):
            x = np.exp(-((at - shift_mm) ** 2) / (2 * 0.15**2))
            y = np.exp(-(at**2) / (2 * 0.15**2))
            kernels.append(np.outer(y, x) / (x.sum() * y.sum()))
        return np.tile(np.array(kernels), (len(points_mm), 1, 1, 1))


LENS = SpotLens(k=0.06, drop=0.5)
GEOMETRY = PlateGeometry.of(LENS, DISPLAY)


@pytest.fixture(scope="module")
def picture():
    return aberration_dots(LENS, GEOMETRY, DISPLAY, 2000.0)


def test_each_dot_lies_where_its_chief_ray_lands(picture):
    pitch = DISPLAY.width / lens_pictures.DOTS_ACROSS
    centre = np.array([DISPLAY.x_min + 120, DISPLAY.y_min + 80])
    y, x = np.indices(picture.shape[:2]) + 0.5
    for index in [(0, 0), (3, 2), (-5, 4), (6, -3)]:
        wanted = centre + np.array(index) * pitch
        landed = GEOMETRY.distorted(LENS, "g")(wanted[None])[0] - DISPLAY[:2]
        near = (np.abs(x - landed[0]) < 6) & (np.abs(y - landed[1]) < 6)
        for channel, shift_px in ((0, 0.2 / 36 * 240), (1, 0)):
            light = picture[..., channel] * near
            found = [(light * a).sum() / light.sum() for a in (x, y)]
            assert found[0] - shift_px == pytest.approx(landed[0], abs=0.15)
            assert found[1] == pytest.approx(landed[1], abs=0.15)


def test_a_dot_holds_its_light_and_the_corner_dims(picture):
    middle = picture[70:91, 110:131, 1].sum()
    assert middle == pytest.approx(lens_pictures.DOT_AREA_PX, rel=1e-3)
    pitch = DISPLAY.width / lens_pictures.DOTS_ACROSS
    far = np.array([[DISPLAY.x_min + 120 + 6 * pitch, DISPLAY.y_min + 80]])
    at = GEOMETRY.distorted(LENS, "g")(far)
    gain = LENS.relative_illumination(GEOMETRY.mm(at))[0]
    x = round(float(at[0, 0])) - DISPLAY.x_min
    dot = picture[70:91, x - 6 : x + 7, 1].sum()
    assert gain < 0.9
    assert dot == pytest.approx(gain * lens_pictures.DOT_AREA_PX, rel=5e-3)


def test_another_window_shows_the_same_grid(picture):
    wide = aberration_dots(LENS, GEOMETRY, DISPLAY.grown(16, 8), 2000.0)
    assert np.abs(wide[8:-8, 16:-16] - picture).max() < 1e-6


def test_kernels_stand_side_by_side():
    mosaic = kernel_mosaic(LENS, GEOMETRY, np.inf)
    columns, rows = lens_pictures.FIELD_GRID
    assert mosaic.rgb.shape == (rows * mosaic.tile_px, columns * mosaic.tile_px, 3)
    tile = mosaic.rgb[: mosaic.tile_px, -mosaic.tile_px :]
    assert tile.sum((0, 1)) == pytest.approx(1, abs=1e-5)
    middle = mosaic.tile_px // 2
    assert np.unravel_index(tile[..., 1].argmax(), tile.shape[:2]) == (middle, middle)


@pytest.mark.slow
def test_tiles_have_room_for_a_wide_blur():
    """Arrays of kernels sum to 1 however much of the light falls beside them."""
    lens, frame = ideal_lens(), Window.of_size(WIDTH, HEIGHT)
    distance_mm = float(depth_of(13.0)) + float(lens.entrance_pupil_offset_mm)
    mosaic = kernel_mosaic(lens, PlateGeometry.of(lens, frame), distance_mm)
    assert mosaic.tile_px == 33
    columns = np.flatnonzero(mosaic.rgb[:33, :33, 1].sum(0) > 1e-4)
    assert columns[-1] - columns[0] + 1 == pytest.approx(26, abs=2)
