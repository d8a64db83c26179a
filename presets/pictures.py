"""The picture of a preset: a frame through the lens, and what the lens does.

Four panels. A CG plate as the lens photographs it; the kernels over the frame, or the
lateral colour where blur was not measured; the distorted square grid; the fall-off.
"""

import io
from pathlib import Path

import cv2
import matplotlib as mpl
import numpy as np
from jaxtyping import Float, Float32
from matplotlib.figure import Figure
from PIL import Image

import lensfit
from data_synth import plate
from lensfit.coords import Window
from lensfit.lens import Lens
from lensfit.preset.schema import Preset
from lensfit.report.kernels import width_of_blur_mm

TOLERANCE = 0.01
FOCUS_MM = 2000.0
"""The sphere in the middle of the plate is sharp at 28 mm of focal length; the scene
moves away in proportion for longer lenses."""
SPHERE_Z_MM = 3100.0
FIELD = ((-0.85, -0.43, 0.0, 0.43, 0.85), (-0.8, 0.0, 0.8))
KERNEL_PX = 48
LEAST_PIXEL_MM = 0.01
TAILS = 1.5
"""Wider than for light as it is: so high a gamma shows fainter tails."""
GAMMA = 0.4
QUALITY = 85
DPI = 100


def write_picture(preset: Preset, path: Path) -> None:
    """Draw the first focal length of a preset, wide open, and write a JPEG."""
    mpl.rcParams["font.size"] = 8
    lens, focus_mm = _chosen(preset)
    figure = Figure(figsize=(11.0, 6.2), dpi=DPI, layout="constrained")
    panels = figure.subplots(2, 2, width_ratios=(1.25, 1.0))
    _draw_frame(panels[0, 0], lens, focus_mm)
    if lens.blur is not None:
        _draw_kernels(panels[0, 1], lens, focus_mm)
    else:
        _draw_colour(panels[0, 1], lens)
    _draw_grid(panels[1, 0], lens)
    _draw_fall_off(panels[1, 1], lens)
    figure.suptitle(preset.lens.name)
    page = io.BytesIO()
    figure.savefig(page, format="png")
    picture = Image.open(page).convert("RGB")
    picture.save(path, quality=QUALITY, optimize=True, subsampling=0)


def _chosen(preset: Preset) -> tuple[Lens, float]:
    """The lens wide open, at the focus distance nearest to the middle sphere's."""
    focal_mm = preset.entries[0].focal_length_mm
    wanted_mm = FOCUS_MM * focal_mm / plate.FOCAL_MM
    known = {
        entry.focus_distance_mm
        for entry in preset.entries
        if entry.focal_length_mm == focal_mm
    }
    focus_mm = min(
        (distance for distance in known if distance is not None),
        key=lambda distance: abs(1 / distance - 1 / wanted_mm),
    )
    lens = preset.at(focal_length_mm=focal_mm, focus_distance_mm=focus_mm)
    return lens, focus_mm


def _draw_frame(axes, lens: Lens, focus_mm: float) -> None:
    """The plate of the demo through the lens; with depth of field where it is known.

    The scene is scaled so that the middle sphere is in focus.
    """
    rgb, depth_mm, half = halved_plate()
    depth_mm = depth_mm * (focus_mm / SPHERE_Z_MM)
    frame = lensfit.render(
        rgb,
        depth_mm if lens.blur is not None else None,
        lens,
        tolerance=TOLERANCE,
        data_window=half,
        display_window=frame_within(lens),
    )
    axes.imshow(shown(frame))
    axes.set_axis_off()
    stop = f"f/{lens.f_number:g}, " if lens.f_number else ""
    said = "" if lens.blur is not None else "; blur not measured, none drawn"
    axes.set_title(
        f"CG plate through it: {lens.focal_length_mm:g} mm, {stop}"
        f"focused at {focus_mm / 1000:g} m{said}"
    )


def halved_plate() -> tuple[
    Float32[np.ndarray, "height width 3"], Float32[np.ndarray, "height width"], Window
]:
    """The demo's plate at half its size: colour, depth in mm, and its data window."""
    radiance, depth_m, window = plate.render_plate()
    # Rows and columns of two plate pixels become one: begin and end on even ones.
    left, top = (value % 2 for value in (window.x_min, window.y_min))
    half = Window(
        (window.x_min + left) // 2,
        (window.y_min + top) // 2,
        (window.x_max - 1) // 2,
        (window.y_max - 1) // 2,
    )
    rgb = cv2.resize(
        radiance[top : top + 2 * half.height, left : left + 2 * half.width],
        (half.width, half.height),
        interpolation=cv2.INTER_AREA,
    )
    depth_mm = depth_m[top::2, left::2][: half.height, : half.width] * 1000
    return rgb.astype(np.float32), depth_mm.astype(np.float32), half


def frame_within(lens: Lens) -> Window:
    """The middle of the halved plate, as wide as the lens can be served from it.

    An anamorphic lens sees so far to the sides that the plate's overscan is too little.
    """
    half_mm = np.asarray(lens.sensor_size_mm) / 2
    rim = np.column_stack([np.ones(9), np.linspace(-1.0, 1.0, 9)]) * half_mm
    seen = np.asarray(lens.undistorted_from_distorted(rim))[:, 0].max() / half_mm[0]
    served = 1 + plate.OVERSCAN_PERCENT / 100
    width, height = (side // 2 for side in plate.SIZE_PX)
    margin = round(width * max(1 - served / seen, 0.0) / 2)
    return Window.of_size(width, height).grown(-margin, 0)


def shown(linear: Float[np.ndarray, "height width 3"]) -> np.ndarray:
    """sRGB code values of scene-linear light."""
    light = np.clip(linear, 0.0, 1.0)
    return np.where(
        light <= 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055
    )


def _draw_kernels(axes, lens: Lens, focus_mm: float) -> None:
    """Green kernels over the frame, of points half as far again as the focus."""
    half_mm = np.asarray(lens.sensor_size_mm) / 2
    points = np.array([(x, y) for y in FIELD[1] for x in FIELD[0]]) * half_mm
    object_mm = 1.5 * focus_mm
    distances_mm = np.full(len(points), object_mm)
    width_mm = width_of_blur_mm(lens, points, distances_mm, LEAST_PIXEL_MM)
    width_mm *= TAILS
    kernels = np.asarray(
        lens.psfs(
            points,
            object_mm,
            ("r", "g", "b"),
            pixel_pitch_mm=width_mm / KERNEL_PX,
            size_px=KERNEL_PX,
            tolerance=TOLERANCE,
        )
    )
    tiles = np.maximum(kernels, 0.0) / kernels.max((1, 2, 3), keepdims=True)
    tiles = np.moveaxis(tiles**GAMMA, 1, -1)
    tiles = tiles.reshape(len(FIELD[1]), len(FIELD[0]), KERNEL_PX, KERNEL_PX, 3)
    axes.imshow(np.concatenate(np.concatenate(tiles, axis=1), axis=1))
    axes.set_axis_off()
    axes.set_title(
        f"Point-spread functions over the frame, points at {object_mm / 1000:g} m\n"
        f"(tiles {1000 * width_mm:.0f} µm wide, each against its own peak)"
    )


def _draw_colour(axes, lens: Lens) -> None:
    """Where red and blue land against green, enlarged."""
    points = _lattice(lens, 13, 9)
    green = np.asarray(lens.distorted_from_undistorted(points))
    for channel, colour in (("r", "tab:red"), ("b", "tab:blue")):
        moved = np.asarray(lens.distorted_from_undistorted(points, channel)) - green
        axes.quiver(
            *green.T, *moved.T, color=colour, angles="xy", width=0.003, label=channel
        )
    _frame_of(axes, lens)
    largest = 1000 * float(np.hypot(*moved.T).max())
    axes.set_title(f"Lateral colour (blue up to {largest:.1f} µm)")


def _draw_grid(axes, lens: Lens) -> None:
    """A square grid of the scene as the lens images it."""
    across = np.linspace(-1.0, 1.0, 81)
    half_mm = np.asarray(lens.sensor_size_mm) / 2
    for place in np.linspace(-1.0, 1.0, 13):
        for line in (
            np.column_stack([across, np.full_like(across, place)]),
            np.column_stack([np.full_like(across, place), across]),
        ):
            straight = line * half_mm
            bent = np.asarray(lens.distorted_from_undistorted(straight))
            axes.plot(*straight.T, color="0.8", linewidth=0.6)
            axes.plot(*bent.T, color="tab:orange", linewidth=0.9)
    _frame_of(axes, lens)
    axes.set_title("Distortion: squares (grey) as the lens draws them (orange)")


def _draw_fall_off(axes, lens: Lens) -> None:
    """Green relative illumination."""
    shape = (61, 81)
    points = _lattice(lens, shape[1], shape[0])
    light = np.asarray(lens.relative_illumination(points)).reshape(shape)
    half_x, half_y = (side / 2 for side in lens.sensor_size_mm)
    shown = axes.imshow(
        light, extent=(-half_x, half_x, half_y, -half_y), cmap="gray", vmin=0, vmax=1
    )
    levels = np.linspace(0.1, 1.0, 10)
    lines = axes.contour(
        *points.reshape(*shape, 2).transpose(2, 0, 1), light, levels, cmap="viridis"
    )
    axes.clabel(lines, fmt="%.1f")
    axes.figure.colorbar(shown, ax=axes)
    _frame_of(axes, lens)
    axes.set_title(f"Relative illumination, f/{lens.f_number:g}")


def _lattice(lens: Lens, columns: int, rows: int) -> Float[np.ndarray, "points 2"]:
    """Points all over the sensor, row by row, mm."""
    half_x, half_y = (side / 2 for side in lens.sensor_size_mm)
    x, y = np.linspace(-half_x, half_x, columns), np.linspace(-half_y, half_y, rows)
    return np.stack(np.meshgrid(x, y), -1).reshape(-1, 2)


def _frame_of(axes, lens: Lens) -> None:
    """The sensor's outline, millimetres, row 0 on top."""
    half_x, half_y = (side / 2 for side in lens.sensor_size_mm)
    axes.set_aspect("equal")
    axes.set_xlim(-1.08 * half_x, 1.08 * half_x)
    axes.set_ylim(1.08 * half_y, -1.08 * half_y)
    axes.set_xlabel("mm")
