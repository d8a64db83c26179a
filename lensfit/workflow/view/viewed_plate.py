"""Data of the page of a preset on a plate: pictures, plan, focus and start values.

Everything is made by the code of `lensfit apply` and `lensfit plan`, from the adjusted
`ApplyOptions`, so that a picture at full quality is the frame that `apply` writes. A
proxy is a smaller plate at a coarser tolerance through the same code, and so is what is
shown between it and a large frame.
"""

import math
import tempfile
import threading
from collections import OrderedDict
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any, final

import msgspec
import numpy as np
from jaxtyping import Float32

from lensfit.errors import ImageError, LensfitError, error_at_frame
from lensfit.io.sequence import expand_frames
from lensfit.plate.apply_options import ApplyOptions
from lensfit.plate.camera.plate_state import PlateState
from lensfit.plate.camera.settings import NAME as SETTINGS_NAME
from lensfit.plate.camera.settings import file_stamp, settings_beside
from lensfit.plate.frame.frame_outcome import apply_frame
from lensfit.plate.frame.plate_lens import PlateLens
from lensfit.plate.frame.renderer import FrameRenderer
from lensfit.preset.knobs import active_knobs
from lensfit.preset.scaled_look import UNSCALED, ScaledLook
from lensfit.preset.schema import Preset
from lensfit.report.plain_numbers import plain_distance
from lensfit.workflow.plan_plate import plan_plate
from lensfit.workflow.view.lens_adjustments import (
    CAMERA,
    LensAdjustments,
    SavedSettings,
    adjusted_options,
    save_settings,
    settings_tables,
)
from lensfit.workflow.view.screen_picture import (
    MOST_PIXELS,
    MOST_PIXELS_OF_RAYS,
    Plate,
    Quality,
    frame_pixels,
    read_plate,
)

PROXY_TOLERANCE = 1e-2
_DIGITS = 6
"""Of a picked focus distance, so that the command line that repeats it is short."""
_PICTURES = 4


@final
class ViewedPlate:
    """A preset on a plate or a sequence.

    Parameters
    ----------
    plates : An EXR file, or a pattern such as ``plate.####.exr``.
    options : How plates are rendered before any adjustment.

    Raises
    ------
    LensfitError : There is no such plate, or an option cannot be followed.
    """

    def __init__(self, preset: Preset, plates: str, options: ApplyOptions):
        self.preset, self.plates, self.options = preset, plates, options
        self.frames = tuple(expand_frames(plates))
        self._reading, self._keeping = threading.Lock(), threading.Lock()
        self._plate: tuple[object, Plate] | None = None
        self._made: OrderedDict[object, Float32[np.ndarray, "height width 3"]]
        self._made = OrderedDict()
        of_rays = any(entry.blur is not None for entry in preset.entries)
        self._most_pixels = MOST_PIXELS_OF_RAYS if of_rays else MOST_PIXELS
        self.plate(0)

    def path(self, frame: int) -> Path:
        """The file of a frame.

        Raises
        ------
        ImageError : There are fewer frames.
        """
        if frame >= len(self.frames):
            raise ImageError(
                f"there is no frame {frame}; the last of these is "
                f"{len(self.frames) - 1}, counted from 0",
                remedy="ask for one of them",
            )
        return self.frames[frame][1]

    def plate(self, frame: int) -> Plate:
        """A frame, read once while no other is looked at.

        Raises
        ------
        ImageError : It cannot be read or shown.
        """
        path = self.path(frame)
        key = path, file_stamp(path)
        with self._reading:
            if self._plate is None or self._plate[0] != key:
                self._plate = None  # two need not be held in memory
                self._plate = key, read_plate(path, self.options, self._most_pixels)
            return self._plate[1]

    def pixels(
        self, wanted: LensAdjustments, quality: Quality
    ) -> Float32[np.ndarray, "height width 3"]:
        """The frame through the lens, scene-linear, over the display window.

        Raises
        ------
        LensfitError : It cannot be rendered so.
        """
        path = self.path(wanted.frame)
        settings = settings_beside(path.parent).paths
        stated = self.options.camera.settings
        files = (path, *settings, *([stated] if stated else []))
        key = _bare(wanted), quality, tuple(map(file_stamp, files))
        with self._keeping:
            found = self._made.get(key)
        if found is None:
            found = self._rendered_plate(wanted, quality)
            with self._keeping:
                self._made[key] = found
                while len(self._made) > _PICTURES:
                    self._made.popitem(last=False)
        return found

    def _rendered_plate(self, wanted: LensAdjustments, quality: Quality) -> np.ndarray:
        plate = self.plate(wanted.frame)
        options = replace(
            adjusted_options(self.options, wanted),
            layers=[plate.layer],
            output="result",
        )
        image = plate.smaller.get(quality, plate.image)
        if image is not plate.image:
            coarse = max(options.tolerance, PROXY_TOLERANCE)
            options = replace(options, tolerance=coarse)
        with _at(plate.path):
            made = FrameRenderer(self.preset, options).render_read(image, plate.path)
        return frame_pixels(made, plate.layer)

    def plate_pixels(self, frame: int) -> Float32[np.ndarray, "height width 3"]:
        """The plate as it is, over its display window."""
        plate = self.plate(frame)
        return frame_pixels(plate.image, plate.layer)

    def frame_exr(self, wanted: LensAdjustments) -> bytes:
        """The file that `lensfit apply` writes.

        Raises
        ------
        LensfitError : It cannot be rendered so.
        """
        path = self.path(wanted.frame)
        renderer = FrameRenderer(self.preset, adjusted_options(self.options, wanted))
        with tempfile.TemporaryDirectory() as folder:
            target = Path(folder) / path.name
            outcome = apply_frame(renderer, path, target)
            if outcome.failure is not None:
                raise LensfitError(outcome.failure)
            return target.read_bytes()

    def plan(self, wanted: LensAdjustments) -> dict[str, Any]:
        """What a frame needs and costs, as `lensfit plan` says it.

        Raises
        ------
        LensfitError : It cannot be rendered so.
        """
        path, options = self.path(wanted.frame), adjusted_options(self.options, wanted)
        with _at(path):
            plan, notes = plan_plate(self.preset, path, options)
        return plan.facts() | {"notes": notes}

    def focus_distance_mm(self, wanted: LensAdjustments, x: float, y: float) -> float:
        """The focus distance that is sharp at a pixel of the frame, from the sensor.

        Parameters
        ----------
        x, y : From the corner of the display window, pixels.

        Raises
        ------
        ImageError : The plate has no depth there.
        """
        free = LensAdjustments(
            frame=wanted.frame, focal_length_mm=wanted.focal_length_mm,
            f_number=wanted.f_number,
        )  # fmt: skip
        options = adjusted_options(self.options, free)
        options = replace(options, camera=replace(options.camera, focus_at=(x, y)))
        options = replace(
            options, overrides=replace(options.overrides, focus_distance_mm=None)
        )
        found = self._state(options, self.plate(wanted.frame)).of_plate(CAMERA[2])
        return math.inf if found is None else float(f"{found:.{_DIGITS}g}")

    def start(self, frame: int) -> dict[str, Any]:
        """What the lens and the plate state before any adjustment: the camera, knobs
        that are not neutral, and ranges; a sentence where the camera is not known."""
        plate = self.plate(frame)
        display = plate.image.parts[0].display_window
        camera: dict[str, float | None] = dict.fromkeys(CAMERA)
        said, knobs, scaled = None, {}, UNSCALED
        try:
            state = self._state(self.options, plate)
            camera = {name: state.of_plate(name) for name in CAMERA}
            knobs, scaled = active_knobs(state.knobs), state.scaled
        except LensfitError as error:
            said = str(error)
        return {
            "camera": {name: plain_distance(value) for name, value in camera.items()},
            "knobs": {n: v for n, v in knobs.items() if not isinstance(v, str)},
            "error": said,
            "defocus": self.options.switches.defocus,
            "width": display.width,
            "height": display.height,
            "pixel_aspect": plate.image.parts[0].pixel_aspect,
            "qualities": plate.qualities,
            "frames": [path.name for _, path in self.frames],
            "ranges": lens_ranges(self.preset, scaled),
        }

    def _state(self, options: ApplyOptions, plate: Plate) -> PlateState:
        lens = PlateLens(self.preset, options)
        with _at(plate.path):
            # The samples go along: focus may be picked in them.
            return lens.state_of(
                plate.image if options.camera.focus_at else plate.header, plate.path
            )

    @property
    def settings_path(self) -> Path:
        """The settings file that belongs to the plate."""
        return self.options.camera.settings or self.path(0).parent / SETTINGS_NAME

    def save(self, wanted: LensAdjustments) -> SavedSettings:
        """Write the adjustments to the settings file.

        Raises
        ------
        LensfitError : The file cannot be changed.
        """
        plate = self.plate(wanted.frame)
        # What no lens can be is refused before anything is written.
        then = self._state(adjusted_options(self.options, wanted), plate)
        changed = save_settings(self.settings_path, settings_tables(wanted))
        now = self._state(self.options, plate)
        if (now.lens_key, now.knobs) == (then.lens_key, then.knobs):
            return SavedSettings(changed, _unsaved_options(wanted))
        note = (
            f"{self.settings_path} is written, but something that counts before it "
            "says otherwise: a table [[frames]], a sidecar or an option here"
        )
        return SavedSettings(changed, [note, *_unsaved_options(wanted)])


def _unsaved_options(wanted: LensAdjustments) -> list[str]:
    """What a settings file does not hold."""
    if wanted.defocus is None:
        return []
    return ["Depth of field is switched here alone: the command below does it as well"]


def lens_ranges(preset: Preset, scaled: ScaledLook = UNSCALED) -> dict[str, Any]:
    """What was measured, for the ends of sliders: focal lengths, the widest f-number
    (None where nobody states one) and the nearest focus distance.

    Parameters
    ----------
    scaled : How the look is put on a camera that it was not measured on: its focal
        lengths reach to half and twice that camera's.
    """
    focal = [entry.focal_length_mm for entry in preset.entries]
    stops = [f.f_number for e in preset.entries for f in e.fall_off if f.f_number]
    focus = [e.focus_distance_mm for e in preset.entries if e.focus_distance_mm]
    near = min((mm for mm in focus if math.isfinite(mm)), default=20 * min(focal))
    reached = list(focal)
    if scaled != UNSCALED:
        reached += [scaled.focal_length_mm / 2, scaled.focal_length_mm * 2]
    return {
        "focal_length_mm": [min(reached), max(reached)],
        "widest_f_number": min(stops, default=None),
        "nearest_focus_mm": near * scaled.distances,
    }


def _bare(wanted: LensAdjustments) -> bytes:
    """The adjustments alone, without what a message adds to them."""
    values = {name: getattr(wanted, name) for name in LensAdjustments.__struct_fields__}
    return msgspec.json.encode(values, order="sorted")


@contextmanager
def _at(path: Path) -> Iterator[None]:
    """Errors that name the frame they happened at, as those of `apply` do."""
    try:
        yield
    except LensfitError as error:
        raise error_at_frame(error, path) from error
