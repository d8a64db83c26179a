"""A whole shoot: photographs, what a photographer knows, what only the tracer knows.

Writes one picture per shot, `shoot.toml` for `lensfit calibrate`, `NAME_truth.json` per
shot and `truth_lens.json` with chief rays and relative illumination over the frame for
every setting of the lens. A fit may read the pictures and the shoot file, never the
truth.
"""

import math
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
from jaxtyping import Float

from data_synth.aim import chief_landings_mm, tracer_from_object
from data_synth.chart import DICTIONARY, MARKER_RATIO, Chart, Pose
from data_synth.dots import DotTruth, expose_dots, expose_dots_from_maps
from data_synth.files import (
    ENCODINGS,
    PictureFormat,
    picture_name,
    write_json,
    write_picture,
)
from data_synth.irradiance import plane_irradiance
from data_synth.lens import SetLens, set_lens
from data_synth.noise_draws import keep_the_light
from data_synth.patterns import expose_pattern, expose_white
from data_synth.prescription import Prescription
from data_synth.psf_truth import (
    WavefrontTruth,
    settings_for,
    wavefront_truth,
    write_truth,
)
from data_synth.sensor import (
    CHANNELS,
    MOSAIC,
    Band,
    Frame,
    Sensor,
    camera_bands,
    digitise,
)
from lensfit.atomic import write_text_atomic
from lensfit.atomic_set import atomic_output_set

SHOOT_FILE = "shoot.toml"
BRIGHTEST = 0.75
"""Automatic exposure puts the brightest half per mille of a picture here."""
AT_ONCE = 2
"""Photographs; more of them wait for each other's Python between blocks of rays."""
FIELD_STEPS = (13, 11)


@dataclass(frozen=True)
class Shot:
    """One photograph to take; angles and lengths as in `Pose`.

    Attributes
    ----------
    exposure : Gain; None exposes automatically.
    brightest : Automatic exposure puts the brightest sample here; None puts the
        brightest half per mille of the picture at 0.75.
    rays_per_wavelength : Per dot, by brute force.
    from_maps : Dots are drawn from pupil maps in place of brute force.
    pupil_cells : Across the pupil, through each of which other charts are seen.
    """

    name: str
    chart: Chart
    pose: Pose
    f_number: float
    focus_distance_mm: float
    focal_length_mm: float | None = None
    form: PictureFormat = "exr"
    exposure: float | None = None
    brightest: float | None = None
    says_distance: bool = True
    rays_per_wavelength: int = 2048
    from_maps: bool = False
    pupil_cells: int = 7


@dataclass(frozen=True)
class Camera:
    """The body: its frame, its sensor, its colour filters and the lens' iris.

    Attributes
    ----------
    wavelengths : Of each colour band.
    """

    frame: Frame
    sensor: Sensor
    blades: int = 7
    blade_rotation_deg: float = 10.0
    wavelengths: int = 3


@dataclass(frozen=True, eq=False)
class Taken:
    """A noise-free picture and what is known of it."""

    image: Float[np.ndarray, "height width 3"]
    dots: DotTruth | None
    misfit_px: float


def take(
    prescription: Prescription,
    camera: Camera,
    shot: Shot,
    *,
    seed: int = 0,
    change: Callable | None = None,
) -> tuple[SetLens, Taken]:
    """Set the lens for one shot and photograph its chart, without noise."""
    lens = _set(
        prescription, camera, shot.focal_length_mm, change,
        shot.f_number, shot.focus_distance_mm,
    )  # fmt: skip
    taken = _taken(lens, camera, shot, seed)
    if not shot.chart.dark:
        return lens, taken
    few = camera_bands(min(camera.wavelengths, 3))
    white = expose_white(lens, shot.pose, camera.frame, few)
    return lens, replace(taken, image=np.maximum(white - taken.image, 0.0))


def _taken(lens: SetLens, camera: Camera, shot: Shot, seed: int) -> Taken:
    """Its chart through the lens, bright where a dark one is black."""
    bands = camera_bands(camera.wavelengths)
    if shot.from_maps and shot.chart.kind == "dot-grid":
        image, dots = expose_dots_from_maps(
            lens, shot.chart, shot.pose, camera.frame, bands
        )
        return Taken(image, dots, 0.0)
    if shot.chart.kind == "dot-grid":
        image, dots = expose_dots(
            lens, shot.chart, shot.pose, camera.frame, bands,
            rays_per_wavelength=shot.rays_per_wavelength, seed=seed,
        )  # fmt: skip
        return Taken(image, dots, 0.0)
    # Where it is sharp, a pattern shows no more of a band than its mean and width.
    few = camera_bands(min(camera.wavelengths, 3))
    image, misfit_px = expose_pattern(
        lens, shot.chart, shot.pose, camera.frame, few,
        pupil_cells_across=shot.pupil_cells,
    )  # fmt: skip
    return Taken(image, None, misfit_px)


def _set(
    prescription, camera: Camera, focal_length_mm, change, f_number, focus_distance_mm
) -> SetLens:
    return set_lens(
        prescription,
        focal_length_mm=focal_length_mm,
        f_number=f_number,
        focus_distance_mm=focus_distance_mm,
        blades=camera.blades,
        blade_rotation_rad=math.radians(camera.blade_rotation_deg),
        change=change,
    )


def write_shoot(
    folder: Path,
    prescription: Prescription,
    camera: Camera,
    shots: list[Shot],
    *,
    seed: int = 0,
    change: Callable | None = None,
    with_wavefront: bool = False,
    keep_light: bool = False,
    progress: Callable[[str], None] = lambda _: None,
) -> None:
    """Photograph every shot and write pictures, shoot file and truth into a folder.

    They appear at the end, together; a shoot that is interrupted leaves nothing.

    Parameters
    ----------
    change : A tolerance error of the lens (see `set_lens`).
    with_wavefront : Also write `truth_wavefront.npz` (see `data_synth.psf_truth`).
    keep_light : Also write what each picture would be without noise (see
        `data_synth.noise_draws`).
    progress : Told the name of each shot before it is taken.
    """
    with atomic_output_set(folder, last=(SHOOT_FILE,)) as made:

        def photograph(number: int, shot: Shot) -> tuple[str, SetLens]:
            progress(shot.name)
            lens, taken = take(
                prescription, camera, shot, seed=seed + 100 * number, change=change
            )
            gain = shot.exposure or _exposure(taken.image, shot.brightest)
            light = taken.image * gain
            if keep_light:
                keep_the_light(made, shot.name, light)
            picture = digitise(light, camera.sensor, seed + 100 * number + 1)
            write_picture(made / picture_name(shot.name, shot.form), picture, shot.form)
            write_json(
                made / f"{shot.name}_truth.json",
                _truth(camera, shot, lens, taken, gain),
            )
            setting = f"f{shot.f_number:g}_{shot.focus_distance_mm:g}mm"
            return f"{lens.focal_length_mm:.2f}mm_{setting}", lens

        with ThreadPoolExecutor(AT_ONCE) as pool:
            states = dict(pool.map(photograph, range(len(shots)), shots))
        write_text_atomic(made / SHOOT_FILE, shoot_toml(prescription, camera, shots))
        write_json(made / "truth_lens.json", lens_truth(prescription, camera, states))
        if with_wavefront:
            progress("truth_wavefront")
            write_truth(made, _wavefront(prescription, camera, shots, change))


def _wavefront(
    prescription: Prescription, camera: Camera, shots: list[Shot], change
) -> WavefrontTruth:
    """Of the focal length of the first shot, at the settings of square takes of its
    chart."""
    kind = shots[0].chart.kind
    square = [s for s in shots if s.chart.kind == kind and s.says_distance]
    seen = [(s.f_number, s.focus_distance_mm, s.pose.distance_mm) for s in square]
    state = prescription.state_nearest(shots[0].focal_length_mm)
    return wavefront_truth(
        partial(_set, prescription, camera, shots[0].focal_length_mm, change),
        camera.frame,
        camera_bands(camera.wavelengths),
        settings_for(tuple(dict.fromkeys(seen))),
        state.focal_length_mm,
    )


def _exposure(
    image: Float[np.ndarray, "height width 3"], brightest: float | None
) -> float:
    if brightest is not None:
        return brightest / max(float(image.max()), 1e-9)
    return BRIGHTEST / max(float(np.quantile(image, 0.9995)), 1e-9)


def _truth(
    camera: Camera, shot: Shot, lens: SetLens, taken: Taken, gain: float
) -> dict:
    table = {
        "conventions": "pixel (0, 0) covers [0, 1) x [0, 1), row 0 on top; chart X"
        " right, Y down; z from the sensor; flux in white level x pixels, unexposed",
        "lens": lens.prescription.name,
        "focal_length_mm": round(lens.focal_length_mm, 6),
        "f_number": shot.f_number,
        "focus_distance_mm": shot.focus_distance_mm,
        "stop_radius_mm": round(lens.stop.radius_mm, 6),
        "entrance_pupil_from_sensor_mm": round(-lens.pupil_z_mm, 6),
        "chart": asdict(shot.chart),
        "pose": asdict(shot.pose),
        "sensor": asdict(camera.sensor),
        "exposure": round(gain, 6),
    }
    if taken.dots is None:
        return table | {"ray_map_misfit_px": float(f"{taken.misfit_px:.2g}")}
    positions = ["chief", "centroid"]
    names = [f"{p}_{c}_{axis}_px" for p in positions for c in CHANNELS for axis in "xy"]
    columns = ["i", "j", *names, *(f"flux_{c}" for c in CHANNELS)]
    return table | {"columns": columns, "dots": _dot_rows(taken.dots)}


def _dot_rows(dots: DotTruth) -> list[list[float | None]]:
    table = np.concatenate(
        [
            dots.chief_px.transpose(1, 0, 2).reshape(len(dots.index), 6).round(4),
            dots.centroid_px.transpose(1, 0, 2).reshape(len(dots.index), 6).round(4),
            dots.flux.T.round(5),
        ],
        axis=1,
    )
    return [
        [*map(int, index), *(None if math.isnan(v) else v for v in row)]
        for index, row in zip(dots.index, table.tolist(), strict=True)
    ]


def lens_truth(prescription: Prescription, camera: Camera, states: dict) -> dict:
    """Chief rays and relative illumination of every setting, over the whole frame.

    For a flat object square to the axis at the focus distance (or at a thousand focal
    lengths when focused at infinity). Rows that no light reaches are left out.
    """
    table: dict = {
        "lens": prescription.name,
        "title": prescription.title,
        "source": prescription.source,
        "columns": ["x_mm", "y_mm", "z_mm"]
        + [f"chief_{c}_{axis}_px" for c in CHANNELS for axis in "xy"]
        + [f"relative_illumination_{c}" for c in CHANNELS],
    }
    for key, lens in states.items():
        table[key] = field_table(lens, camera.frame, camera.wavelengths)
    return table


def field_table(lens: SetLens, frame: Frame, wavelengths: int = 3) -> list[list[float]]:
    """Rows of object point, chief ray per channel (px) and relative illumination."""
    distance_mm = lens.focus_distance_mm
    if not math.isfinite(distance_mm):
        distance_mm = 1000 * lens.focal_length_mm
    scale = (distance_mm + lens.pupil_z_mm) / lens.focal_length_mm
    half = 0.5 * np.array(frame.size_mm) * scale * 1.08
    half[0] *= lens.prescription.squeeze
    axes = [np.linspace(-h, h, n) for h, n in zip(half, FIELD_STEPS, strict=True)]
    grid = np.stack(np.meshgrid(*axes), -1).reshape(-1, 2)
    object_mm = np.column_stack([grid, np.full(len(grid), distance_mm)])
    columns = [object_mm.round(3)]
    light = []
    with_centre = np.concatenate([object_mm, [[0.0, 0.0, distance_mm]]])
    for band in camera_bands(wavelengths):
        columns.append(_chiefs_px(lens, frame, object_mm, band).round(4))
        middle_nm = band.wavelengths_nm[len(band.wavelengths_nm) // 2]
        irradiance = plane_irradiance(lens, with_centre, middle_nm)
        light.append((irradiance[:-1] / irradiance[-1]).round(4))
    rows = np.column_stack([*columns, *light])
    return rows[np.isfinite(rows).all(axis=1) & (rows[:, -3:] > 0).all(axis=1)].tolist()


def _chiefs_px(lens: SetLens, frame: Frame, object_mm, band: Band):
    points = tracer_from_object(object_mm)
    landing = sum(
        share * chief_landings_mm(lens, points, wavelength_nm)
        for wavelength_nm, share in zip(band.wavelengths_nm, band.weights, strict=True)
    )
    return frame.px_from_mm(np.asarray(landing))


def shoot_toml(prescription: Prescription, camera: Camera, shots: list[Shot]) -> str:
    """The shoot file: what a photographer knows, in lensfit's format."""
    width, height = camera.frame.size_mm
    lines = ["[lens]", f'name = "{prescription.title}"', "", "[camera]"]
    lines += [f"sensor_width_mm = {width}", f"sensor_height_mm = {height}"]
    lines += [f'mosaic = "{MOSAIC}"'] * camera.sensor.bayer + [""]
    names = {}
    for shot in shots:
        if shot.chart not in names:
            names[shot.chart] = f"{shot.chart.kind}-{len(names) + 1}"
            lines += _target_lines(names[shot.chart], shot.chart)
    for shot in shots:
        lines += _take_lines(prescription, shot, names[shot.chart])
    return "\n".join(lines)


def _target_lines(name: str, chart: Chart) -> list[str]:
    lines = ["[[target]]", f'name = "{name}"', f'kind = "{chart.kind}"']
    lines.append(f"pitch_mm = {chart.pitch_mm}")
    if chart.kind == "dot-grid":
        lines.append(f"hole_diameter_mm = {chart.mark_mm}")
    if chart.kind == "line-grid":
        lines.append(f"line_width_mm = {chart.mark_mm}")
    if chart.kind == "charuco":
        lines.append(f"squares = {list(chart.squares)}")
        lines.append(f'dictionary = "{DICTIONARY}"')
        lines.append(f"marker_ratio = {MARKER_RATIO}")
    elif chart.kind != "checkerboard":
        lines.append(f'polarity = "{"dark" if chart.dark else "bright"}"')
    return [*lines, ""]


def _take_lines(prescription: Prescription, shot: Shot, target: str) -> list[str]:
    state = prescription.state_nearest(shot.focal_length_mm)
    lines = [
        "[[take]]",
        f'image = "{picture_name(shot.name, shot.form)}"',
        f'target = "{target}"',
        f"focal_length_mm = {state.focal_length_mm}",
        f"f_number = {shot.f_number}",
        f"focus_distance_mm = {shot.focus_distance_mm}",
    ]
    if prescription.squeeze != 1.0:
        lines.append(f"anamorphic_squeeze = {prescription.squeeze}")
    if shot.says_distance:
        lines.append(f"target_distance_mm = {shot.pose.distance_mm}")
    if ENCODINGS[shot.form] != "linear" or shot.form == "png16":
        lines.append(f'encoding = "{ENCODINGS[shot.form]}"')
    return [*lines, ""]
