"""A drawn scene on disk: what a compositor gets, and the photograph it should match.

    photo_reference.exr  the photograph, no noise but that of finitely many rays
    photo_noise.exr      standard error of each of its samples
    cg_flat.exr          RGBA and Z (mm along the axis from the entrance pupil) of the
                         pinhole plate, with overscan as a data window
    cg_layerNN.exr       the same of each layer alone, nearest first
    cg_deep.exr          all layers as deep samples
    scene.json           the camera, the layers, the lamps, and the noise

Layers may pass through each other: their order is that of their middles.
"""

import dataclasses
import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float

from data_synth.files import write_json
from data_synth.lens import SetLens, set_lens
from data_synth.prescription import Prescription
from data_synth.scene.draw import drawn_scene
from data_synth.scene.exposure import Exposed, expose_scene
from data_synth.scene.layers import Layer, Scene
from data_synth.scene.plates import (
    PinholeCamera,
    Plate,
    flat_plate,
    layer_plate,
    pinhole_camera,
    pixel_samples,
)
from data_synth.scene.sampling import Sampling
from data_synth.sensor import Frame
from lensfit.atomic_set import atomic_output_set
from lensfit.coords import Window
from lensfit.errors import LensfitError
from lensfit.io.exr import ExrImage, ExrPart, write_exr
from lensfit.io.exr_deep import DeepPart, write_deep

SCENE_FILE = "scene.json"
BLADES, BLADE_ROTATION_DEG = 7, 10.0
"""The iris of `data_synth.shoot.Camera`, so that a fit to its photographs applies."""


@dataclass(frozen=True, eq=False)
class Sitting:
    """A scene in front of a set lens.

    Attributes
    ----------
    nominal_focal_length_mm : As engraved; what plates state.
    """

    lens: SetLens
    nominal_focal_length_mm: float
    camera: PinholeCamera
    scene: Scene

    @property
    def focus_depth_mm(self) -> float:
        """From the entrance pupil to the plane in focus."""
        return self.lens.focus_distance_mm + self.lens.pupil_z_mm


def drawn_sitting(
    prescription: Prescription,
    frame: Frame,
    *,
    focus_distance_mm: float,
    f_number: float | None = None,
    focal_length_mm: float | None = None,
    seed: int = 0,
) -> Sitting:
    """Set a lens and draw a scene that suits it.

    Raises
    ------
    LensfitError : The lens is anamorphic: no single pinhole stands for it.
    """
    if prescription.squeeze != 1.0:
        raise LensfitError(
            "is anamorphic, and its two sections see from two places",
            where=prescription.name,
            remedy="photograph scenes through a spherical lens",
        )
    lens = set_lens(
        prescription,
        focal_length_mm=focal_length_mm,
        f_number=f_number,
        focus_distance_mm=focus_distance_mm,
        blades=BLADES,
        blade_rotation_rad=math.radians(BLADE_ROTATION_DEG),
    )
    camera = pinhole_camera(lens, frame)
    depth_mm = focus_distance_mm + lens.pupil_z_mm
    scene = drawn_scene(camera, depth_mm, 2 * lens.pupil_radius_mm, seed)
    state = prescription.state_nearest(focal_length_mm)
    return Sitting(lens, state.focal_length_mm, camera, scene)


def write_scene(
    folder: Path,
    sitting: Sitting,
    sampling: Sampling | None = None,
    *,
    seed: int = 0,
    progress: Callable[[str], None] = lambda _: None,
) -> None:
    """Photograph the scene, render its plates, and write all of it into a folder.

    The files appear at the end, together.

    Parameters
    ----------
    seed : Of the rays; the same seed gives the same files.
    progress : Told what is being done.

    Raises
    ------
    OutputError : The folder cannot be written.
    """
    sampling = sampling or Sampling()
    scene, camera = sitting.scene, sitting.camera
    with atomic_output_set(folder, last=(SCENE_FILE,)) as made:
        progress("plates")
        samples = pixel_samples(camera, scene, sampling.plate_rays_per_pixel, seed)
        flat = flat_plate(camera, scene, samples)
        _write_plate(made / "cg_flat.exr", flat, sitting)
        plates = [layer_plate(camera, layer, samples) for layer in scene.layers]
        for number, plate in enumerate(plates):
            _write_plate(made / f"cg_layer{number:02d}.exr", plate, sitting)
        write_deep(made / "cg_deep.exr", _deep(plates, sitting))
        exposed = expose_scene(
            sitting.lens, scene, camera.frame, sampling, seed=seed, progress=progress
        )
        _write_photograph(made / "photo_reference.exr", exposed.image)
        _write_photograph(made / "photo_noise.exr", exposed.standard_error)
        table = (
            scene_table(sitting)
            | noise_figures(exposed)
            | {
                "sampling": dataclasses.asdict(sampling),
                "seed": seed,
            }
        )
        write_json(made / SCENE_FILE, table)


def scene_table(sitting: Sitting) -> dict:
    """What `scene.json` says of the camera, the layers and the lamps.

    Depths and places in scene coordinates (`data_synth.scene`), mm.
    """
    lens, camera = sitting.lens, sitting.camera
    frame = camera.frame
    layers = sitting.scene.layers
    return {
        "lens": lens.prescription.name,
        "nominal_focal_length_mm": sitting.nominal_focal_length_mm,
        "f_number": lens.f_number,
        "focus_from_sensor_mm": lens.focus_distance_mm,
        "focus_depth_from_pupil_mm": sitting.focus_depth_mm,
        "entrance_pupil_z_mm": lens.pupil_z_mm,
        "entrance_pupil_diameter_mm": 2 * lens.pupil_radius_mm,
        "efl_mm": lens.focal_length_mm,
        "blades": lens.stop.blades,
        "blade_rotation_deg": math.degrees(lens.stop.rotation_rad),
        "cg_focal_length_mm": camera.focal_length_mm,
        "cg_focal_px": camera.focal_length_mm / frame.pitch_mm[0],
        "photo_size": list(frame.size_px),
        "plate_size": [camera.window.width, camera.window.height],
        "sensor_size_mm": list(frame.size_mm),
        "pixel_pitch_mm": frame.pitch_mm[0],
        "layers": [_layer_entry(layer) for layer in layers],
        "highlights": [
            {"layer": number, **lamp}
            for number, layer in enumerate(layers)
            for lamp in _lamp_entries(layer, camera)
        ],
    }


def _layer_entry(layer: Layer) -> dict:
    plane = layer.plane
    return {
        "name": layer.name,
        "origin_mm": plane.origin_mm.tolist(),
        "right": plane.right.tolist(),
        "down": plane.down.tolist(),
        "opacity": layer.opacity,
    }


def _lamp_entries(layer: Layer, camera: PinholeCamera) -> list[dict]:
    lamps = layer.lamps
    if lamps is None:
        return []
    centre = layer.plane.scene_mm(lamps.centre_mm)
    return [
        {
            "centre_mm": place.tolist(),
            "plate_px": px.tolist(),
            "radius_mm": float(radius),
            "rgb": radiance.tolist(),
        }
        for place, px, radius, radiance in zip(
            centre, camera.px_of_scene(centre), lamps.radius_mm, lamps.radiance,
            strict=True,
        )
    ]  # fmt: skip


def noise_figures(exposed: Exposed) -> dict:
    """The photograph's own noise, as shown (clipped to 0 ... 1) and in 4 x 4 means.

    Returns
    -------
    noise_rms : Root mean square of the standard errors of samples below 1.
    noise_psnr_4x4_db : What a perfect rendering would score against this photograph,
        both clipped and averaged over 4 x 4 pixels.
    """
    variance = np.where(exposed.image < 1.0, exposed.standard_error**2, 0.0)
    mean = float(variance.mean())
    psnr = -10 * math.log10(mean / 16) if mean > 0 else math.inf
    return {"noise_rms": math.sqrt(mean), "noise_psnr_4x4_db": round(psnr, 2)}


def _attributes(sitting: Sitting) -> dict[str, float]:
    lens, camera = sitting.lens, sitting.camera
    return {
        "lens/focal": sitting.nominal_focal_length_mm,
        "lens/fstop": lens.f_number,
        "lens/focus": lens.focus_distance_mm / 1000,
        "lens/aperture": camera.frame.size_mm[0],
        "lens/overscan": 200.0 * camera.margin_px[0] / camera.frame.size_px[0],
    }


def _plate_part(sitting: Sitting, channels: dict[str, np.ndarray]) -> ExrPart:
    return ExrPart(
        channels=channels,
        data_window=sitting.camera.window,
        display_window=Window.of_size(*sitting.camera.frame.size_px),
        attributes=_attributes(sitting),
    )


def _write_plate(path: Path, plate: Plate, sitting: Sitting) -> None:
    channels = _half_channels("RGBA", plate.rgba)
    channels["Z"] = plate.depth_mm.astype(np.float32)
    write_exr(path, ExrImage((_plate_part(sitting, channels),)), compression="zip")


def _deep(plates: list[Plate], sitting: Sitting) -> DeepPart:
    """A sample of each layer that covers any of a pixel, nearest first."""
    depth = np.stack([plate.depth_mm for plate in plates], -1)
    colour = np.stack([plate.rgba for plate in plates], -2)
    order = np.argsort(depth, axis=-1, kind="stable")
    depth = np.take_along_axis(depth, order, -1)
    colour = np.take_along_axis(colour, order[..., None], -2)
    there = colour[..., 3] > 0
    samples = _half_channels("RGBA", colour[there])
    samples["Z"] = depth[there].astype(np.float32)
    return DeepPart(_plate_part(sitting, {}), there.sum(axis=-1), samples)


def _write_photograph(path: Path, image: Float[np.ndarray, "height width 3"]) -> None:
    window = Window.of_size(image.shape[1], image.shape[0])
    channels = _half_channels("RGB", image)
    part = ExrPart(channels=channels, display_window=window, data_window=window)
    write_exr(path, ExrImage((part,)), compression="zip")


def _half_channels(names: str, values) -> dict[str, np.ndarray]:
    """The last axis taken apart, in half floats."""
    return {
        name: np.ascontiguousarray(values[..., k].astype(np.float16))
        for k, name in enumerate(names)
    }
