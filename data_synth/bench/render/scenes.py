"""Scenes that the renderer is measured on, and the plain script it is compared with."""

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from jaxtyping import Float32

from lensfit._strict import convert_strictly, read_json_object
from lensfit.coords import Window
from lensfit.errors import PresetError
from lensfit.io.exr import read_exr
from lensfit.plate.apply_options import ApplyOptions
from lensfit.plate.frame.flat_plate import plate_in_depth
from lensfit.plate.frame.plate_lens import PlateLens
from lensfit.preset.schema import Preset
from lensfit.preset.thin_lens import ThinCamera, thin_lens_preset
from lensfit.rendering.circle import Circle
from lensfit.rendering.frame import render_stages, window_with_margin
from lensfit.rendering.layer_stack import Mattes
from lensfit.rendering.render_plan import plan_of
from lensfit.rendering.render_stages import Stages, prepare_stages

_CHECKER_PX = 24


@dataclass(eq=False)
class Scene:
    """A plate with depth, the lens it is seen through, and what it should look like.

    Attributes
    ----------
    reference : The same frame path-traced through the lens; None where there is none.
    mattes : Coverage of objects, where the plate knows it.
    """

    name: str
    rgb: Float32[np.ndarray, "height width 3"]
    depth_mm: Float32[np.ndarray, "height width"]
    data_window: Window
    display_window: Window
    preset: Preset
    focus_mm: float
    reference: Float32[np.ndarray, "height width 3"] | None = None
    mattes: Mattes | None = None

    def __post_init__(self):
        self._stages: dict[float, Stages] = {}

    @property
    def megapixels(self) -> float:
        return self.display_window.width * self.display_window.height / 1e6

    def stages(self, tolerance: float) -> Stages:
        """Prepared once for each tolerance."""
        if tolerance not in self._stages:
            self._stages[tolerance] = prepare_stages(
                self.preset.at(focus_distance_mm=self.focus_mm),
                self.display_window,
                window_with_margin(self.display_window, self.data_window),
                tolerance=tolerance,
            )
        return self._stages[tolerance]

    def render(
        self,
        tolerance: float,
        *,
        rgb: np.ndarray | None = None,
        depth_mm: np.ndarray | None = None,
        mattes: bool = False,
    ) -> Float32[np.ndarray, "height width 3"]:
        """The display window, with other pixels or depth where given."""
        return render_stages(
            self.rgb if rgb is None else rgb,
            self.data_window,
            self.stages(tolerance),
            self.display_window,
            depth_mm=self.depth_mm if depth_mm is None else depth_mm,
            mattes=self.mattes if mattes else None,
        )

    def expected_error(self, tolerance: float) -> float:
        """What the plan says."""
        stages = self.stages(tolerance)
        window = self.display_window
        return plan_of(stages, window, tolerance, depth_mm=self.depth_mm).error

    def circle(self) -> Circle:
        """Radius of blur of a distance."""
        defocus = self.stages(1e-3).defocus
        assert defocus is not None
        return defocus.circle

    def undefocused(self) -> Float32[np.ndarray, "height width 3"]:
        """The plate as it is."""
        return self.rgb[self.inside]

    @property
    def inside(self) -> tuple[slice, slice]:
        data, shown = self.data_window, self.display_window
        top, left = shown.y_min - data.y_min, shown.x_min - data.x_min
        return slice(top, top + shown.height), slice(left, left + shown.width)


def camera_of_plate(folder: Path) -> ThinCamera:
    """The camera of the path-traced plate.

    Raises
    ------
    PresetError : There is no camera.json, or it describes none.
    """
    path = folder / "camera.json"
    tables = read_json_object(
        path,
        error=PresetError,
        source="give the folder of the plate with --data",
        mend="mend the file",
    )
    return convert_strictly(tables, ThinCamera, error=PresetError, where=path)


def plate_scene(folder: Path, preset: Preset, camera: ThinCamera) -> Scene:
    """The path-traced plate, read as `lensfit apply` reads it.

    Raises
    ------
    ImageError : A file cannot be read, or holds no colour or depth.
    """
    path = folder / "plate.0001.exr"
    image = read_exr(path)
    part = image.parts[0]
    lens = PlateLens(preset, ApplyOptions())
    state = lens.noted_state(image, path)
    found = plate_in_depth(lens, part, state, image, path)
    assert found is not None
    reference = read_exr(folder / "reference.0001.exr").parts[0].channels
    return Scene(
        "plate",
        np.stack([part.channels[c] for c in "RGB"], -1).astype(np.float32),
        found.depth_mm,
        part.data_window,
        part.display_window,
        preset,
        1000 * camera.focus_distance_m,
        np.stack([reference[c] for c in "RGB"], -1).astype(np.float32),
        found.mattes,
    )


def synthetic_scene(camera: ThinCamera, width: int, height: int) -> Scene:
    """A checkered floor that runs to a far wall, balls and bars before it, lights.

    Blur in pixels grows with the width, as a real frame's does.
    """
    y, x = np.mgrid[:height, :width].astype(np.float32)
    u, v = x / width, y / height
    focus_mm = 1000 * camera.focus_distance_m
    vergence = np.where(v > 0.45, 0.1 + 2.2 * (v - 0.45), 0.1).astype(np.float32)
    rng = np.random.default_rng(0)
    checks = ((x // _CHECKER_PX + y // _CHECKER_PX) % 2)[..., None]
    colour = (0.15 + 0.5 * checks * [1.0, 0.9, 0.7]).astype(np.float32)
    for _ in range(12):
        cu, cv, size = rng.uniform(0, 1), rng.uniform(0.2, 0.9), rng.uniform(0.02, 0.08)
        nearness = rng.uniform(0.5, 3.0)
        ball = ((u - cu) ** 2 + ((v - cv) * height / width) ** 2 < size**2) & (
            vergence < nearness
        )
        colour[ball] = rng.uniform(0.1, 0.8, 3)
        vergence[ball] = nearness
    for _ in range(6):
        at, lean, nearness = (
            rng.uniform(0, 1),
            rng.uniform(-0.3, 0.3),
            rng.uniform(1, 4),
        )
        bar = (np.abs(u - at - lean * v) < 0.0015) & (vergence < nearness)
        colour[bar], vergence[bar] = (0.6, 0.5, 0.3), nearness
    for _ in range(20):
        row, column = rng.integers(4, height - 4), rng.integers(4, width - 4)
        colour[row : row + 2, column : column + 2] = rng.uniform(50, 300, 3)
    window = Window.of_size(width, height)
    depth = (focus_mm / vergence).astype(np.float32)
    preset = thin_lens_preset(camera)
    return Scene("uhd", colour, depth, window, window, preset, focus_mm)


def layered_discs(scene: Scene) -> Float32[np.ndarray, "height width 3"]:
    """What forty lines make of it: pixels sorted into layers by whole pixels of blur,
    each convolved with a disc, near over far."""
    radius = scene.circle().radius_px(scene.depth_mm)
    steps = np.rint(radius).astype(int)
    result = np.zeros_like(scene.rgb)
    for step in np.unique(steps):
        here = (steps == step)[..., None].astype(np.float32)
        layer = np.concatenate([scene.rgb * here, here], -1)
        size = 2 * abs(int(step)) + 1
        t = np.arange(size) - size // 2
        disc = (t**2 + t[:, None] ** 2 <= max(abs(int(step)), 0.5) ** 2).astype(
            np.float32
        )
        spread = cv2.filter2D(
            layer, -1, disc / disc.sum(), borderType=cv2.BORDER_REPLICATE
        )
        behind = (steps <= step).astype(np.float32)
        known = cv2.filter2D(
            behind, -1, disc / disc.sum(), borderType=cv2.BORDER_REPLICATE
        )
        share = np.where(known > 1e-3, 1 / np.maximum(known, 1e-3), 0)[..., None]
        result = spread[..., :3] * share + result * (1 - spread[..., 3:] * share)
    return result[scene.inside]
