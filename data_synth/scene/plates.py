"""The CG plates of a scene: what an ideal pinhole camera renders.

The pinhole stands at the centre of the lens' paraxial entrance pupil at this focus. Its
focal length is the principal distance of the lens' paraxial chief rays (height on the
sensor over slope in the scene, green), so that plate and photograph agree in scale on
the axis at every depth. At the focus distance that is the paraxial magnification times
the depth. Pixels are as large as the photograph's and the axis meets the middle of
both; the plate is wider by its overscan.

Colours are premultiplied by coverage and averaged over each pixel; depths do not mix.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.ndimage import binary_dilation
from scipy.stats import qmc

from data_synth.aim import chief_landings_mm, tracer_from_object
from data_synth.irradiance import BITS
from data_synth.lens import REFERENCE_NM, SetLens
from data_synth.scene.crossings import crossings
from data_synth.scene.layers import Layer, Scene, SceneRays
from data_synth.scene.shapes import Everywhere
from data_synth.sensor import Frame
from data_synth.spots import object_points_mm
from lensfit.coords import Window

RAYS_AT_ONCE = 1 << 18
LAMP_RAYS = 1 << 10
"""Of each pixel that a lamp touches: small bright things need finer coverage."""
SCAN_STEPS = 3
LEAST_OVERSCAN_PERCENT = 10
PARAXIAL_SLOPE = 1e-4


@dataclass(frozen=True)
class PinholeCamera:
    """The camera of the plates.

    Attributes
    ----------
    focal_length_mm : Sensor height over slope.
    frame : The photograph's pixels.
    margin_px : Of overscan, on the left and right, and above and below.
    """

    focal_length_mm: float
    frame: Frame
    margin_px: tuple[int, int]

    @property
    def window(self) -> Window:
        """The plate's pixels; the photograph's begin at 0, 0."""
        return Window.of_size(*self.frame.size_px).grown(*self.margin_px)

    def rays(self, position_px: Float[np.ndarray, "points 2"]) -> SceneRays:
        """Rays through positions in the photograph's pixel coordinates."""
        slope = self.frame.mm_from_px(position_px) / self.focal_length_mm
        return SceneRays(np.zeros_like(slope), slope)

    def px_of_scene(
        self, scene_mm: Float[np.ndarray, "points 3"]
    ) -> Float[np.ndarray, "points 2"]:
        """Where scene points appear, in the photograph's pixel coordinates."""
        slope = scene_mm[:, :2] / scene_mm[:, 2:]
        return self.frame.px_from_mm(slope * self.focal_length_mm)


@dataclass(frozen=True, eq=False)
class Plate:
    """Premultiplied colour with coverage, and depth, over the plate's window.

    Attributes
    ----------
    depth_mm : Along the axis from the entrance pupil, of the surface that covers most
        of the pixel, mean over its part; infinite where there is none.
    """

    rgba: Float[np.ndarray, "height width 4"]
    depth_mm: Float[np.ndarray, "height width"]


def pinhole_camera(lens: SetLens, frame: Frame) -> PinholeCamera:
    """The camera that renders plates for a lens; see the top of this file.

    The overscan is 10 %, or what the lens' distortion needs to see the whole frame.
    """
    far_mm = 1e3 * lens.focal_length_mm
    x_mm = PARAXIAL_SLOPE * far_mm
    point = np.array([[x_mm, 0.0, lens.pupil_z_mm - far_mm]])
    landing = chief_landings_mm(lens, point, REFERENCE_NM)[0, 0]
    focal_mm = float(landing / PARAXIAL_SLOPE)
    percent = max(LEAST_OVERSCAN_PERCENT, _distortion_percent(lens, frame, focal_mm))
    margin = tuple(round(n * percent / 200) for n in frame.size_px)
    return PinholeCamera(focal_mm, frame, (margin[0], margin[1]))


def _distortion_percent(lens: SetLens, frame: Frame, focal_mm: float) -> float:
    """How much wider than the frame the pinhole's picture of what it shows is, in
    whole percent."""
    steps = np.linspace(-0.5, 0.5, 9)
    border = np.concatenate(
        [
            [(side, s) for s in steps for side in (-0.5, 0.5)],
            [(s, side) for s in steps for side in (-0.5, 0.5)],
        ]
    )
    distance_mm = min(lens.focus_distance_mm, 1e3 * lens.focal_length_mm)
    objects = object_points_mm(lens, border * np.array(frame.size_mm), distance_mm)
    depth = lens.pupil_z_mm - tracer_from_object(objects)[:, 2:]
    seen = np.abs(objects[:, :2] / depth * focal_mm / np.array(frame.size_mm))
    return float(np.ceil(200 * (seen.max() - 0.5)))


@dataclass(frozen=True, eq=False)
class PixelSamples:
    """Places within each pixel of a plate: the same for all plates of a scene.

    Where no more than one layer covers a part of a pixel, the layers laid over each
    other are then exactly the flat plate.

    Attributes
    ----------
    rays_per_pixel : A power of two.
    fine : Pixels, row by row, that get at least 1024 rays: lamps touch them.
    flips : Binary digits of the Sobol sequence that are flipped, of each pixel.
    """

    rays_per_pixel: int
    fine: Bool[np.ndarray, " pixels"]
    flips: Int[np.ndarray, "pixels 2"]

    def blocks(
        self, covered: Bool[np.ndarray, " pixels"]
    ) -> Iterator[tuple[Int[np.ndarray, " some"], Float[np.ndarray, "some rays 2"]]]:
        """Numbers of the pixels that may be covered, and places within each."""
        for pixels, rays in (
            (np.flatnonzero(covered & ~self.fine), self.rays_per_pixel),
            (np.flatnonzero(self.fine), max(self.rays_per_pixel, LAMP_RAYS)),
        ):
            digits = qmc.Sobol(2, scramble=False, bits=BITS).random(rays) * 2**BITS
            at_once = max(1, RAYS_AT_ONCE // rays)
            for start in range(0, len(pixels), at_once):
                some = pixels[start : start + at_once]
                flipped = digits.astype(np.int64) ^ self.flips[some][:, None]
                yield some, (flipped + 0.5) / 2**BITS


def pixel_samples(
    camera: PinholeCamera, scene: Scene, rays_per_pixel: int, seed: int
) -> PixelSamples:
    """Where the plates of a scene are sampled."""
    flips = np.random.default_rng(seed).integers(2**BITS, size=(camera.window.area, 2))
    return PixelSamples(rays_per_pixel, _touched_by_lamps(camera, scene), flips)


def layer_plate(camera: PinholeCamera, layer: Layer, samples: PixelSamples) -> Plate:
    """One layer alone, with its lamps, as if nothing stood before or behind it."""
    return flat_plate(camera, Scene((layer,)), samples)


def flat_plate(camera: PinholeCamera, scene: Scene, samples: PixelSamples) -> Plate:
    """Everything that the pinhole sees, nearer layers covering farther ones."""
    window = camera.window
    light = np.zeros((window.area, 4))
    depth_mm = np.full(window.area, np.inf)
    for some, drawn in samples.blocks(_touched_by_shapes(camera, scene)):
        light[some], depth_mm[some] = _seen(camera, scene, some, drawn)
    shape = (window.height, window.width)
    return Plate(light.reshape(*shape, 4), depth_mm.reshape(shape))


def _touched_by_lamps(camera: PinholeCamera, scene: Scene):
    """Which pixels, row by row, may show a part of a lamp."""
    window = camera.window
    touched = np.zeros((window.height, window.width), bool)
    for layer in scene.layers:
        if layer.lamps is None:
            continue
        centre = layer.plane.scene_mm(layer.lamps.centre_mm)
        corner = np.array([window.x_min, window.y_min])
        at_px = camera.px_of_scene(centre) - corner
        scale = camera.focal_length_mm / centre[:, 2] / min(camera.frame.pitch_mm)
        reach_px = layer.lamps.radius_mm * scale * 1.5 + 1
        for (x, y), reach in zip(at_px, reach_px, strict=True):
            rows = slice(max(int(y - reach), 0), max(int(y + reach) + 1, 0))
            columns = slice(max(int(x - reach), 0), max(int(x + reach) + 1, 0))
            touched[rows, columns] = True
    return touched.ravel()


def _touched_by_shapes(camera: PinholeCamera, scene: Scene):
    """Which pixels, row by row, may show a part of a layer.

    Nine rays a pixel find what is at least a third of a pixel wide, and what is thinner
    somewhere within reach of the two pixels that are added around.
    """
    window = camera.window
    shape = (window.height, window.width)
    if any(isinstance(layer.shape, Everywhere) for layer in scene.layers):
        return np.ones(shape, bool).ravel()
    found = np.zeros(shape, bool)
    steps = (np.arange(SCAN_STEPS) + 0.5) / SCAN_STEPS - 0.5
    for step in np.stack(np.meshgrid(steps, steps), -1).reshape(-1, 2):
        rays = camera.rays((window.pixel_centres() + step).reshape(-1, 2))
        for layer in scene.layers:
            depth = layer.plane.depth_mm(rays)
            met = np.flatnonzero(np.isfinite(depth))
            place = layer.plane.place_mm(rays.some(met), depth[met])
            found.ravel()[met] |= layer.shape.contains(place)
    return binary_dilation(found, np.ones((3, 3)), iterations=2).ravel()


def _seen(camera: PinholeCamera, scene: Scene, pixels, drawn):
    """Mean colour and coverage of pixels, and the depth of what covers most of each."""
    window = camera.window
    count, rays_each = drawn.shape[:2]
    corner = np.stack([pixels % window.width, pixels // window.width], -1)
    corner = corner + np.array([window.x_min, window.y_min])
    rays = camera.rays((corner[:, None] + drawn).reshape(-1, 2))
    light = np.zeros((count, 4))
    share = np.zeros((len(scene.layers), count))
    depth_sum = np.zeros((len(scene.layers), count))
    for met in crossings(scene.layers, rays):
        radiance = scene.layers[met.number].radiance(met.place_mm, lamps_lit=True)
        own = met.rays // rays_each
        for channel in range(3):
            brought = met.share * radiance[:, channel]
            light[:, channel] += np.bincount(own, brought, count)
        covered = np.bincount(own, met.share, count)
        light[:, 3] += covered
        share[met.number] += covered
        depth_sum[met.number] += np.bincount(own, met.share * met.depth_mm, count)
    most = share.argmax(axis=0)
    at = most, np.arange(count)
    depth = np.full(count, np.inf)
    np.divide(depth_sum[at], share[at], out=depth, where=share[at] > 0)
    return light / rays_each, depth
