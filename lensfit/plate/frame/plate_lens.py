"""The lens for a plate: at its camera state, over its windows.

Computes for a plate the state of the lens, the position of the frame on the sensor and
the stages; keeps the stages while neither camera nor windows change.
"""

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import final

import msgspec
import numpy as np

from lensfit.coords import Window
from lensfit.errors import ImageError, LensfitError, error_at_frame
from lensfit.io.exr import ExrImage, ExrPart, read_exr
from lensfit.io.exr_deep import is_deep
from lensfit.io.exr_header import lens_attributes
from lensfit.lens import Lens
from lensfit.plate.apply_options import ApplyOptions
from lensfit.plate.camera.header_camera import (
    AppliedCamera,
    refuse_several_cameras,
    restated,
)
from lensfit.plate.camera.plate_camera import PlateCamera, SourcedValue
from lensfit.plate.camera.plate_state import PlateState, plate_state
from lensfit.plate.camera.sources import CameraSources
from lensfit.plate.frame.external_map import ExternalMap
from lensfit.plate.frame.plate_notes import border_note
from lensfit.plate.frame.provenance import (
    Fingerprint,
    fingerprint,
    part_with_signature,
    preset_digest,
    refuse_second_lens,
    refuse_second_straightening,
    signature,
)
from lensfit.plate.frame.tight_window import lit_window, reached_window
from lensfit.plate.notes import FrameNote, Notes
from lensfit.plate.pixel_shape import pixel_shape
from lensfit.plate.plate_depth import FOCUS_AT, depth_doubt, picked_depth_mm
from lensfit.plate.plate_file import header_entries, plate_header, plate_views
from lensfit.preset.knobs import NEUTRAL
from lensfit.preset.lens_of_entry import NO_BLUR
from lensfit.preset.scaled_look import check_corners, unscaled_error
from lensfit.preset.schema import Preset
from lensfit.rendering.circle import Circle
from lensfit.rendering.frame import window_with_margin
from lensfit.rendering.look.stack import light_spreads, look_of
from lensfit.rendering.render_stages import Stages, prepare_stages
from lensfit.rendering.uv import PlateGeometry, spanned_mm

_NEAREST_FOCAL_LENGTHS = 1.5
_LONGEST_SIDE_PX = 32766
"""That pictures are resampled over (OpenCV counts their pixels in 16 bits)."""


def _refuse_beyond_the_warp(window: Window) -> None:
    """Refuse a picture larger than can be rendered.

    Raises
    ------
    ImageError : It is.
    """
    if max(window.width, window.height) > _LONGEST_SIDE_PX:
        raise ImageError(
            f"would be rendered over {window.width} x {window.height} pixels, and "
            f"{_LONGEST_SIDE_PX} on a side is the most",
            remedy="crop its display window, or render it in parts",
        )


@final
class PlateLens:
    """A preset with the options that it is used by, and what was noted of the plates.

    Raises
    ------
    ImageError : The external map of the options cannot be used.
    LensfitError : A sidecar, camera or settings file of the options is malformed.
    """

    def __init__(self, preset: Preset, options: ApplyOptions):
        self.preset = preset
        self.options = options
        self.notes = Notes()
        stmap = options.stmap
        self._map = None if stmap is None else ExternalMap.read(stmap)
        self._sources = CameraSources(options.camera, options.overrides)
        self._digest = preset_digest(preset)
        self._lens_key: object = None
        self._lens: Lens | None = None
        self._key: object = None
        self._look_key: object = None
        self._stages: Stages | None = None
        self._stages_noted: Stages | None = None

    def state_of(
        self, image: ExrImage, path: Path, picked_in: ExrImage | None = None
    ) -> PlateState:
        """The camera state of a plate.

        Parameters
        ----------
        picked_in : Where the pixel lies that is in focus: the first view of a stereo
            plate, whose eyes are focused at one distance; in the plate itself if None.

        Raises
        ------
        LensfitError : A value is missing or impossible, or the plate carries a lens
            already; the line names the plate.
        """
        try:
            if not self.options.again:
                refuse_again = (
                    refuse_second_straightening
                    if self.options.output == "undistorted"
                    else refuse_second_lens
                )
                refuse_again(image.parts)
            return self._state_of(image, path, picked_in or image)
        except LensfitError as error:
            # To put a look elsewhere is no measurement that a photograph is freed of.
            straight = self.options.output == "undistorted"
            own = unscaled_error(error) if straight else error
            raise error_at_frame(own, path) from error

    def _state_of(self, image: ExrImage, path: Path, picked_in: ExrImage) -> PlateState:
        camera = self._camera(image, path)
        if self.options.camera.focus_at is None:
            return self._state(camera, image)
        focus, notes = self._picked_focus(camera, picked_in, path)
        state = self._state(camera.focused(focus), image)
        return state._replace(notes=(*state.notes, *notes))

    def _picked_focus(
        self, camera: PlateCamera, image: ExrImage, path: Path
    ) -> tuple[SourcedValue, tuple[str, ...]]:
        """What the user picked to be in focus; until it is known, the sky is."""
        pick = self.options.camera.focus_at
        assert pick is not None
        state = self._state(camera.focused(SourcedValue(math.inf, FOCUS_AT)), image)
        depth_mm, notes = picked_depth_mm(
            image,
            path,
            pick,
            self.options.depth,
            self.geometry(state, image.parts[0].display_window),
            self.cg_focal_length_mm(state),
        )
        return SourcedValue(depth_mm, FOCUS_AT, from_pupil=True), notes

    def _camera(self, image: ExrImage, path: Path) -> PlateCamera:
        display = image.parts[0].display_window
        camera = self._sources.of_plate(
            path,
            header_entries(image),
            (display.width, display.height),
            self.preset.camera.sensor_width_mm,
        )
        refuse_several_cameras(image.parts, camera)
        return camera

    def _state(self, camera: PlateCamera, image: ExrImage) -> PlateState:
        state = plate_state(
            self.preset,
            camera,
            header_entries(image),
            falloff=self.options.switches.falloff,
            knobs=self.options.knobs,
            scale_to_sensor=self.options.scale_to_sensor,
        )
        part = image.parts[0]
        shape = pixel_shape(
            self.preset,
            part.display_window,
            state.sensor_width_mm,
            part.pixel_aspect,
            self.options.pixel_aspect,
        )
        notes = (*state.notes, *([shape.note] if shape.note else []))
        state = state._replace(pixel_shape=shape.ratio, notes=notes)
        measured = self.preset.camera
        check_corners(
            spanned_mm(part.display_window, state.spanned_width_mm),
            (measured.sensor_width_mm, measured.sensor_height_mm),
        )
        return state

    def lens_at(self, state: PlateState) -> Lens:
        """The adjusted lens at the state of a plate; kept for the next."""
        key = (state.lens_key, state.knobs.aberration, state.knobs.bokeh)
        if self._lens is None or key != self._lens_key:
            self._lens = self.preset.at(*state.lens_key, knobs=state.knobs)
            self._lens_key = key
        return self._lens

    def noted_state(
        self, image: ExrImage, path: Path, picked_in: ExrImage | None = None
    ) -> PlateState:
        """The camera state of a plate; notes assumptions and inactive overrides."""
        state = self.state_of(image, path, picked_in)
        self.notes.add(*state.notes)
        # That blur was not measured matters only where depth of field is put on.
        self.notes.add(*(n for n in self.lens_at(state).notes if n != NO_BLUR))
        return state

    def fingerprint(self, plate: Path) -> Fingerprint:
        """What the frame of a plate would be made of now.

        Raises
        ------
        LensfitError : As `state_of`, or a file of the options cannot be read.
        """
        picks = self.options.camera.focus_at is not None
        whole = picks and not is_deep(plate)
        image = read_exr(plate) if whole else plate_header(plate)
        states = []
        for one in plate_views(image, plate):
            with one.named_errors(plate):
                states.append(self.state_of(one.header, plate, one.picked_in))
        return fingerprint(plate, self._digest, states, self.options)

    def signature(self, state: PlateState) -> str:
        """What is done to plates of this state, in a line."""
        return signature(self.preset.lens.name, self._digest, state, self.options)

    def with_signed_header(self, part: ExrPart, state: PlateState) -> ExrPart:
        """The part with a header that says what was done to it, and what lens it
        carries now in the standard's attributes."""
        attributes = self.standard_attributes(state, part)
        part = self.restated(part, state)
        return part_with_signature(part, self.signature(state), attributes)

    def standard_attributes(self, state: PlateState, part: ExrPart) -> dict:
        """The lens at a plate's state, as the OpenEXR standard describes it."""
        lens, name = self.lens_at(state), self.preset.lens
        camera = self._applied_camera(state, part)
        return lens_attributes(
            nominal_focal_length_mm=camera.focal_length_mm,
            pinhole_focal_length_mm=camera.pinhole_focal_length_mm,
            f_number=camera.f_number,
            focus_distance_mm=camera.focus_distance_mm,
            entrance_pupil_offset_mm=float(lens.entrance_pupil_offset_mm)
            * state.scaled.lengths,
            lens_model=name.name,
            lens_serial=name.serial,
        )

    def restated(self, part: ExrPart, state: PlateState) -> ExrPart:
        """The part, whose entries state no other camera than that of the state."""
        camera, aliases = self._applied_camera(state, part), state.camera.settings
        attributes = restated(part.attributes, camera, aliases.aliases)
        return replace(part, attributes=attributes)

    def _applied_camera(self, state: PlateState, part: ExrPart) -> AppliedCamera:
        lens, scaled = self.lens_at(state), state.scaled
        width, height = self.geometry(state, part.display_window).area_mm
        return AppliedCamera(
            self._focal_length_mm(state) * scaled.angles,
            float(lens.distortion.principal_distance_mm) * scaled.angles,
            state.applied("f_number"),
            state.of_plate("focus_distance_mm"),
            (width * scaled.lengths, height * scaled.lengths),
        )

    def geometry(self, state: PlateState, display: Window) -> PlateGeometry:
        """How a plate lies on the sensor."""
        lens = self.lens_at(state)
        return PlateGeometry.of(lens, display, state.spanned_width_mm)

    def cg_focal_length_mm(self, state: PlateState) -> float:
        """Focal length of the CG camera, on the sensor that `geometry` knows."""
        scaled = state.scaled
        return self._focal_length_mm(state) * scaled.angles / scaled.lengths

    def _focal_length_mm(self, state: PlateState) -> float:
        """Of the lens."""
        stated = state.lens_key[0]
        return self.preset.entries[0].focal_length_mm if stated is None else stated

    def stages_for(self, state: PlateState, display: Window, window: Window) -> Stages:
        """Maps and gains; made anew only when the camera or the windows change."""
        _refuse_beyond_the_warp(window)
        # Looks may change from frame to frame and need none of the maps anew.
        without_look = msgspec.structs.replace(state.knobs, look=NEUTRAL.look)
        spanned = (state.sensor_width_mm, state.pixel_shape)
        key = (state.lens_key, without_look, spanned, display, window)
        if self._stages is None or key != self._key:
            self._stages = None  # two sets need not be held in memory at once
            external = self._map
            self._stages = prepare_stages(
                self.lens_at(state),
                display,
                window,
                tolerance=self.options.tolerance,
                switches=self.options.switches,
                sensor_width_mm=state.spanned_width_mm,
                external=external and external.source_map(display, window),
                depth_levels=state.knobs.bokeh.depth_levels,
            )
            self._key, self._look_key = key, None
        look_key = (state.knobs.look, state.chromaticities)
        if look_key != self._look_key:
            look = look_of(
                state.knobs.look,
                self.lens_at(state),
                self.geometry(state, display),
                self.options.tolerance,
                state.chromaticities,
            )
            self._stages = replace(self._stages, look=look)
            self._look_key = look_key
        return self._stages

    def reach(
        self, window: Window, data_window: Window, display: Window, *, blurs: bool
    ) -> Window:
        """Pixels from which light may spread into `window`: all that the plate has, as
        far as an external map knows where they land, and the blur by depth reaches."""
        wanted = window_with_margin(window, data_window, display if blurs else None)
        if self._map is None:
            return wanted
        known = self._map.window(display)
        low = np.maximum(wanted[:2], known[:2])
        high = np.minimum(wanted[2:], known[2:])
        return window_with_margin(window, Window(*map(int, (*low, *high))))

    def note_border(self, stages: Stages, window: Window, source: Window) -> None:
        """Say so, once for a camera, when the lens looks beyond the plate."""
        if self._stages_noted is not stages:
            self.notes.add(border_note(stages, window, source))
            self._stages_noted = stages

    def lit_window(
        self,
        pictures: Sequence[np.ndarray],
        stages: Stages,
        source: Window,
        window: Window,
        state: PlateState,
        depth_mm: np.ndarray | None,
    ) -> Window | None:
        """The part of `window` that light of a plate with data window `source` comes
        to, of the pictures rendered over it; None if there is none."""
        lit = lit_window(pictures, window, self.options.tolerance)
        if lit is None or light_spreads(state.knobs.look):
            return lit
        blur_px = 0.0
        if depth_mm is not None and stages.defocus is not None:
            radius_px = stages.defocus.circle.radius_px(depth_mm)
            blur_px = float(np.abs(radius_px).max(initial=0.0))
        method = self.options.filter
        reached = reached_window(stages, source, window, method, blur_px)
        return reached and lit.common(reached)

    def note_focus(
        self,
        depth_mm: np.ndarray,
        unit_mm: float,
        state: PlateState,
        display: Window,
        path: Path,
    ) -> None:
        """Say so when the depths of a plate put everything out of focus."""
        circle = Circle.of(self.lens_at(state), self.geometry(state, display))
        doubt = depth_doubt(depth_mm, circle, unit_mm, display.width)
        if doubt is not None:
            self.notes.add(FrameNote(f"{path.name}: {doubt}", "doubtful depth"))

    def within_reach(self, depth_mm: np.ndarray, state: PlateState) -> np.ndarray:
        """Distances of which the lens has an image at all; nearer ones are noted."""
        lens = self.lens_at(state)
        nearest_mm = _NEAREST_FOCAL_LENGTHS * lens.focal_length_mm
        if lens.blur is not None:
            from_pupil = lens.blur.nearest_mm - float(lens.entrance_pupil_offset_mm)
            nearest_mm = max(nearest_mm, 1.05 * from_pupil)
        if not (depth_mm < nearest_mm).any():
            return depth_mm
        self.notes.add(
            f"depth nearer than {nearest_mm:.0f} mm, of which the lens has no image, "
            "is taken as that"
        )
        return np.maximum(depth_mm, np.float32(nearest_mm))
