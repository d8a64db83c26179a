"""Pictures that explain a result: blur in pixels, the lens' dots, its kernels.

- ``circle-of-confusion``: signed diameter in pixels of the blur of each pixel, positive
  in front of the focus distance, for a thin lens of this focal length and stop; in
  channel Y, where the result has its pixels.
- ``aberration-dots``: the dot grid at the focus distance, as this lens would photograph
  it, at the plate's size.
- ``filter``: the kernels over a grid of field points, at the plate's pixels, for a
  point at infinity (R, G, B), at the focus distance (``focus``) and half as far
  (``near``).
"""

from pathlib import Path

import numpy as np

from lensfit.coords import Window
from lensfit.errors import ImageError
from lensfit.io.exr import ExrImage, ExrPart, read_exr
from lensfit.io.exr_views import views_of
from lensfit.plate.camera.plate_state import BLUR
from lensfit.plate.frame.flat_plate import plate_in_depth
from lensfit.plate.frame.plate_lens import PlateLens
from lensfit.plate.plate_file import colour_layers, plate_header
from lensfit.rendering.circle import Circle
from lensfit.rendering.lens_pictures import aberration_dots, kernel_mosaic
from lensfit.rendering.warp import nearest

_FAR_MM = 1e7
"""Chart distance for a lens that is focused at infinity."""


def explaining_picture(plate_lens: PlateLens, path: Path) -> ExrImage:
    """The picture that the options ask for in place of the result.

    Raises
    ------
    ImageError : The plate has no depth, f-number or focus distance where it is needed.
    LensfitError : The lens' blur cannot be known.
    """
    if len(views := views_of(plate_header(path))) > 1:
        names = ", ".join(view.name for view in views)
        raise ImageError(
            f"holds several views ({names}), and this picture is of one",
            remedy="write each view to a file of its own",
        )
    if plate_lens.options.output == "circle-of-confusion":
        return _circle_of_confusion(plate_lens, path)
    image = plate_header(path)
    part = image.parts[0]
    state = plate_lens.noted_state(image, path)
    lens = plate_lens.lens_at(state)
    geometry = plate_lens.geometry(state, part.display_window)
    state.require(*BLUR, use="this picture")
    assert lens.focus_distance_mm is not None
    focus_mm = min(lens.focus_distance_mm, _FAR_MM)
    if plate_lens.options.output == "aberration-dots":
        window = plate_lens.options.written(part.data_window, part.display_window)
        rgb = aberration_dots(lens, geometry, window, focus_mm)
        layers, display = {"": rgb}, part.display_window
    else:
        mosaics = {
            "": kernel_mosaic(lens, geometry, np.inf),
            "focus": kernel_mosaic(lens, geometry, focus_mm),
            "near": kernel_mosaic(lens, geometry, focus_mm / 2),
        }
        height = max(m.rgb.shape[0] for m in mosaics.values())
        width = max(m.rgb.shape[1] for m in mosaics.values())
        window = display = Window.of_size(width, height)
        layers = {
            name: _spaced_tiles(m.rgb, m.tile_px, display)
            for name, m in mosaics.items()
        }
    channels = {
        f"{name}.{leaf}" if name else leaf: np.ascontiguousarray(rgb[..., index])
        for name, rgb in layers.items()
        for index, leaf in enumerate("RGB")
    }
    made = ExrPart(
        channels, window, display, part.attributes, pixel_aspect=part.pixel_aspect
    )
    return ExrImage((plate_lens.with_signed_header(made, state),))


def _spaced_tiles(rgb: np.ndarray, tile_px: int, display: Window) -> np.ndarray:
    """Tiles in the middle of larger ones, so that all mosaics fit one another."""
    rows, columns = rgb.shape[0] // tile_px, rgb.shape[1] // tile_px
    size = display.height // rows
    before = (size - tile_px) // 2
    tiles = rgb.reshape(rows, tile_px, columns, tile_px, 3)
    pad = (before, size - tile_px - before)
    return np.pad(tiles, ((0, 0), pad, (0, 0), pad, (0, 0))).reshape(
        rows * size, columns * size, 3
    )


def _circle_of_confusion(plate_lens: PlateLens, path: Path) -> ExrImage:
    image = read_exr(path)
    state = plate_lens.noted_state(image, path)
    part = next((p for p in image.parts if colour_layers(p)), image.parts[0])
    found = plate_in_depth(plate_lens, part, state, image, path)
    if found is None:
        raise ImageError(
            "is wanted without depth of field, of which this picture is",
            remedy="leave --no-defocus out",
        )
    window = plate_lens.options.written(part.data_window, part.display_window)
    stages = plate_lens.stages_for(state, part.display_window, window)
    lens = plate_lens.lens_at(state)
    circle = Circle.of(lens, plate_lens.geometry(state, part.display_window))
    landed = nearest(found.seen_depth_mm, part.data_window, stages.maps[1])
    made = ExrPart(
        {"Y": (2 * circle.radius_px(landed)).astype(np.float32)},
        window,
        part.display_window,
        part.attributes,
        pixel_aspect=part.pixel_aspect,
    )
    return ExrImage((plate_lens.with_signed_header(made, state),))
