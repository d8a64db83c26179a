"""One frame twice: by Cycles through the lens, and by lensfit on a pinhole plate.

The plate has depth and overscan, and is what a CG department delivers: rendered by a
pinhole in the entrance pupil whose focal length is the lens' principal distance. It
goes through `lensfit apply` flat. The renderer is given the scene's own layers too,
which holds what a plate hides. The reference is the mean of two pictures of other
random numbers; their difference tells its noise.

The scene is a checkered floor and wall, solids and lights. Places are shares of the
frame: x and y in halves of its width at the place's own distance, distances in that of
focus; sizes in halves of the frame's width at the focus distance. Surfaces shine by
themselves, as a sun would light them, so that every ray that meets a point brings the
same, and a picture needs no samples but those of the lens.
"""

import math
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple, final

import numpy as np
from jaxtyping import Float32
from scipy.ndimage import distance_transform_edt

from data_synth.bench.cycles.shaded_lens import Cycles, ShadedLens
from lensfit.coords import Window
from lensfit.errors import LensfitError
from lensfit.exchange.samples import ExchangeFrame
from lensfit.io.exr import ExrImage, ExrPart, read_exr, write_exr
from lensfit.plate.apply_options import ApplyOptions
from lensfit.rendering.frame import render
from lensfit.rendering.layer_stack import LayerStack
from lensfit.rendering.overscan import window_of_percent
from lensfit.rendering.render_stages import Switches
from lensfit.units import m_from_mm
from lensfit.workflow.apply import apply

Thing = dict[str, Any]
_WOOD, _SLATE = [0.42, 0.3, 0.2], [0.12, 0.15, 0.19]
_RED, _CREAM = [0.6, 0.08, 0.06], [0.7, 0.65, 0.5]
_GREEN, _LEAF = [0.1, 0.4, 0.12], [0.35, 0.5, 0.1]
_BLUE, _SKY = [0.08, 0.15, 0.5], [0.4, 0.55, 0.7]
_WALL, _PLASTER = [0.3, 0.26, 0.28], [0.2, 0.2, 0.24]
_LAMP = [[10.0, 8.0, 5.0]]
_FLOOR, _BACK = 0.47, 3.0
"""Below the axis, in halves of the frame's width at the focus distance; the wall."""
_LAMPS = (
    (-0.85, -0.38), (-0.52, -0.2), (-0.26, -0.42), (0.04, -0.27),
    (0.12, -0.44), (0.45, -0.36), (0.8, -0.22),
)  # fmt: skip


class SceneScale(NamedTuple):
    """Millimetres of the scene's units.

    Attributes
    ----------
    focus_mm : Distance of the plane of focus from the entrance pupil.
    half_mm : Half the frame's width there.
    """

    focus_mm: float
    half_mm: float

    def solid(
        self,
        shape: str,
        at: tuple[float, float, float],
        size: float | tuple[float, float, float],
        colours: list[list[float]],
        check: float = 0.0,
        turn_deg: float = 0.0,
        *,
        shaded: bool = True,
    ) -> Thing:
        """A thing as `cycles_job` takes it."""
        x, y, z = at
        sizes = size if isinstance(size, tuple) else (size,) * 3
        return {
            "shape": shape,
            "at_mm": [x * z * self.half_mm, y * z * self.half_mm, z * self.focus_mm],
            "size_mm": [one * self.half_mm for one in sizes],
            "colours": colours,
            "check_mm": check * self.half_mm,
            "turn_deg": turn_deg,
            "shaded": shaded,
        }


def small_scene(scale: SceneScale) -> list[list[Thing]]:
    """Things of each layer, the nearest first; those of one layer hide nothing of each
    other.

    They stand before the focus, in it and behind it; a thin bar crosses the frame and a
    light's disc, and the floor goes through the focus.
    """
    solid, deep = scale.solid, scale.focus_mm / scale.half_mm
    floor_z = 0.5 * (0.35 + _BACK)
    lamps = [solid("ball", (x, y, 2.8), 0.035, _LAMP, shaded=False) for x, y in _LAMPS]
    floor = solid(
        "box",
        (0, (_FLOOR + 0.005) / floor_z, floor_z),
        (12.0, 0.01, (_BACK - 0.35) * deep),
        [_WOOD, _SLATE],
        0.25,
    )
    wall = solid("box", (0, 0, _BACK), (12.0, 8.0, 0.02), [_WALL, _PLASTER], 0.4)
    return [
        [solid("bar", (0.08, 0, 0.5), (0.012, 1.5, 0.012), [_GREEN], 0.0, 14.0)],
        [solid("ball", (0.62, 0.3, 0.6), 0.2, [_BLUE, _SKY], 0.06)],
        [solid("ball", (-0.38, 0.235, 1.0), 0.46, [_RED, _CREAM], 0.07)],
        [solid("box", (0.3, 0.12, 1.45), (0.5, 0.5, 0.5), [_LEAF, _GREEN], 0.09)],
        [solid("ball", (-0.62, 0.02, 2.2), 0.6, [_SKY, _BLUE], 0.15)],
        lamps,
        [floor],
        [wall],
    ]


Picture = Float32[np.ndarray, "height width 3"]
_OVERSCAN_PERCENT = 12.0
_PLATE_SAMPLES = 64
_FAR_MM = 1e7
"""Where a pixel of a layer shows nothing."""


@dataclass(frozen=True, eq=False)
class SameFrame:
    """The pictures, over the display window.

    Attributes
    ----------
    halves : Through the lens' shader, of other random numbers each.
    by_apply, by_layers : From the flat plate, and from the scene's layers.
    sharp : By `lensfit apply` without depth of field.
    plate : Of the pinhole.
    """

    halves: tuple[Picture, Picture]
    by_apply: Picture
    by_layers: Picture
    sharp: Picture
    plate: Picture

    @property
    def by_cycles(self) -> Picture:
        """The mean of both halves."""
        return (self.halves[0] + self.halves[1]) / 2

    @property
    def noise_db(self) -> float:
        """PSNR that a frame without fault would have against `by_cycles`."""
        first, second = (np.clip(one, 0, 1) for one in self.halves)
        square = float(np.mean(((first - second) / 2) ** 2))
        return -10 * math.log10(square) if square else math.inf


@final
class PinholePlate:
    """The scene as a pinhole in the entrance pupil of a lens sees it, with overscan."""

    def __init__(self, seen: ShadedLens):
        width, height = seen.frame.size_px
        self.display = Window.of_size(width, height)
        self.data = window_of_percent(self.display, _OVERSCAN_PERCENT)
        wide_mm = seen.frame.sensor_width_mm * self.data.width / width
        size = self.data.width, self.data.height
        self._cycles = Cycles(seen.cycles.python, ExchangeFrame(size, wide_mm))
        self._camera: dict[str, Any] = {
            "focal_length_mm": seen.principal_mm,
            "axis_mm": np.asarray(seen.lens.distortion.principal_point_mm).tolist(),
        }
        self._layers = small_scene(SceneScale(seen.focus_mm, seen.half_width_mm))

    @property
    def things(self) -> list[dict[str, Any]]:
        """Of the whole scene."""
        return [thing for layer in self._layers for thing in layer]

    def flat(self) -> tuple[Picture, Float32[np.ndarray, "height width"]]:
        """Colours and depth in mm."""
        camera = self._camera | {"things": self.things}
        rgba = self._cycles.picture(samples=_PLATE_SAMPLES, **camera)
        return rgba[..., :3], self._cycles.depth_mm(**camera)

    def stack(self) -> LayerStack:
        """Each layer by itself."""
        pictures, depths = [], []
        for layer in self._layers:
            camera = self._camera | {"things": layer, "transparent": True}
            pictures.append(self._cycles.picture(samples=_PLATE_SAMPLES, **camera))
            depths.append(filled_depth(self._cycles.depth_mm(**camera)))
        return LayerStack(np.stack(pictures), np.stack(depths))


def filled_depth(depth_mm: np.ndarray) -> np.ndarray:
    """A pixel whose centre misses the layer has the depth of the nearest that does not:
    it may still show some of it."""
    nothing = depth_mm > _FAR_MM
    if nothing.all():
        return np.full_like(depth_mm, _FAR_MM)
    places = distance_transform_edt(
        nothing, return_distances=False, return_indices=True
    )
    rows, columns = np.asarray(places)
    return depth_mm[rows, columns]


def same_frame(seen: ShadedLens, samples: int) -> SameFrame:
    """Render all of it.

    Parameters
    ----------
    samples : Of a pixel of each of the two pictures through the lens.

    Raises
    ------
    LensfitError : Blender does not run, or a plate cannot be rendered.
    """
    plate = PinholePlate(seen)
    first, second = (
        seen.picture(samples=samples, seed=seed, things=plate.things) for seed in (1, 2)
    )
    rgb, depth_mm = plate.flat()
    with tempfile.TemporaryDirectory() as name:
        path = Path(name) / "plate.exr"
        _write_plate(path, seen, plate, rgb, depth_mm)
        by_apply = _applied(seen, path, Path(name) / "frame", ApplyOptions())
        without = ApplyOptions(switches=Switches(defocus=False))
        sharp = _applied(seen, path, Path(name) / "sharp", without)
    by_layers = render(
        plate.stack(),
        None,
        seen.lens,
        data_window=plate.data,
        display_window=plate.display,
    )
    left, top = (
        plate.display.x_min - plate.data.x_min,
        plate.display.y_min - plate.data.y_min,
    )
    inside = np.s_[top : top + plate.display.height, left : left + plate.display.width]
    return SameFrame(
        (first, second),
        by_apply,
        np.asarray(by_layers)[..., :3],
        sharp,
        rgb[inside],
    )


def _write_plate(
    path: Path,
    seen: ShadedLens,
    plate: PinholePlate,
    rgb: np.ndarray,
    depth_mm: np.ndarray,
) -> None:
    """With the header that a renderer writes."""
    focal, stop, focus_mm = seen.state
    channels = {c: rgb[..., n].copy() for n, c in enumerate("RGB")}
    channels["Z"] = depth_mm / np.float32(1000)
    header = {
        "lens/focal": focal,
        "lens/fstop": stop,
        "lens/focus": m_from_mm(focus_mm),
        "lens/aperture": seen.frame.sensor_width_mm,
        "depth/kind": "perpendicular",
    }
    part = ExrPart(channels, plate.data, plate.display, header)
    write_exr(path, ExrImage((part,)))


def _applied(seen: ShadedLens, path: Path, out: Path, options: ApplyOptions) -> Picture:
    done = apply(seen.preset, path, out, options=options)
    if done.failures:
        raise LensfitError(done.failures[0])
    channels = read_exr(done.written[0]).parts[0].channels
    return np.stack([channels[c] for c in "RGB"], -1).astype(np.float32)
