"""Data of the page of a preset: point-spread functions, maps and their errors.

Everything is computed by the lens of the preset at the adjusted state, and drawn by the
code of the report.
"""

import math
from dataclasses import replace
from typing import Annotated, Any, Literal, final

import cv2
import msgspec
import numpy as np
from jaxtyping import Float
from msgspec import Meta

from lensfit.errors import LensfitError
from lensfit.lens import Lens
from lensfit.preset.blocks import Camera
from lensfit.preset.entry import Entry
from lensfit.preset.knobs import active_knobs, adjusted_knobs
from lensfit.preset.scaled_look import UNSCALED, ScaledLook, scaled_look
from lensfit.preset.schema import Preset
from lensfit.report.kernels import (
    GAMMA,
    expected_errors,
    field_tiles,
    width_of_blur_mm,
    width_of_field_mm,
)
from lensfit.report.pictures import png, png_address, sheet_of
from lensfit.report.plain_numbers import distance_of, plain, plain_distance
from lensfit.report.plots import breathing, entry_figures
from lensfit.report.svg import Figure
from lensfit.report.through import (
    BEYOND,
    defocus_of,
    f_numbers_of,
    through_tiles,
    usual_defocus,
    width_through_mm,
)
from lensfit.workflow.view.lens_adjustments import CAMERA, Distance, LensAdjustments
from lensfit.workflow.view.lens_curves import breathing_facts, lens_facts
from lensfit.workflow.view.viewed_plate import lens_ranges

_MOST_STOPS = 5
_FINE_PX = 96
_FINE_TOLERANCE = 0.02
_DRAWS = 12
_KEPT_WIDTHS = 64
Tiles = Literal["field", "point", "through"]
"""Drawings made of tiles, whose width they choose."""
_Share = Annotated[float, Meta(ge=-1, le=1)]


class LensQuery(LensAdjustments, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A state of a lens, an object and a point of the frame.

    Attributes
    ----------
    lens : Place among the lenses that are looked at.
    object_distance_mm : From the sensor; that of focus if left out.
    x, y : Of the point, as shares of the way from the middle of the frame to its right
        and its lower edge.
    newest : Whether a newer request takes its place.
    one_scale : Whether tiles are as wide on the sensor as those of the other lens.
    """

    lens: Annotated[int, Meta(ge=0, le=1)] = 0
    object_distance_mm: Distance | None = None
    x: _Share = 0.0
    y: _Share = 0.0
    newest: bool = False
    one_scale: bool = False


@final
class ViewedLens:
    """A preset and the state that it is opened at.

    Parameters
    ----------
    name : As it was given.
    opened : What the command states of the camera and of knobs.
    sensor_width_mm : Width that a scaled look is put on; the photographed one if None.
    scale_to_sensor : Put the look on cameras that it was not measured on; numbers of
        the camera and of the scene are then those of such a camera, figures those of
        the measured lens, over the part of it that the frame spans.

    Raises
    ------
    ImageError : The sensor has no width.
    """

    def __init__(
        self,
        preset: Preset,
        name: str,
        opened: LensAdjustments,
        *,
        sensor_width_mm: float | None = None,
        scale_to_sensor: bool = False,
    ):
        self.preset, self.name = preset, name
        self._opened = opened
        self._widths_mm: dict[tuple[str, bytes], float] = {}
        self._sensor_width_mm, self._scales = sensor_width_mm, scale_to_sensor
        self._start = _start_camera(preset, opened)
        if opened.focus_distance_mm is None:
            measured_mm = self._start["focus_distance_mm"]
            _, focus_mm = self._scaled_look(opened).plate_state(None, measured_mm)
            self._start["focus_distance_mm"] = focus_mm

    def start(self) -> dict[str, Any]:
        """Name, verdict, the state it is opened at, and ranges."""
        preset, verdict = self.preset, self.preset.verdict
        knobs = active_knobs(adjusted_knobs(preset.knobs, self._opened.knobs))
        return {
            "lens": preset.lens.name,
            "serial": preset.lens.serial,
            "file": self.name,
            "verdict": None if verdict is None else verdict.headline,
            "camera": {n: plain_distance(v) for n, v in self._start.items()},
            "knobs": {n: v for n, v in knobs.items() if not isinstance(v, str)},
            "aspect": preset.camera.sensor_width_mm / preset.camera.sensor_height_mm,
            "ranges": lens_ranges(preset, self._scaled_look(self._opened)),
        }

    def lens(self, wanted: LensAdjustments, f_number: float | None = None) -> Lens:
        """The adjusted lens, maybe at another f-number.

        Raises
        ------
        LensfitError : The preset does not reach that state.
        """
        camera, scaled = self._start | wanted.camera, self._scaled_look(wanted)
        stop = camera["f_number"] if f_number is None else f_number
        focal, focus = scaled.measured_state(
            camera["focal_length_mm"], camera["focus_distance_mm"]
        )
        knobs = adjusted_knobs(
            self.preset.knobs, {**self._opened.knobs, **wanted.knobs}
        )
        lens = self.preset.at(focal, stop, focus, knobs=knobs)
        if scaled.note is None:
            return lens
        spanned = self._spanned_camera(scaled)
        return replace(
            lens,
            sensor_size_mm=(spanned.sensor_width_mm, spanned.sensor_height_mm),
            notes=(*lens.notes, scaled.note),
        )

    def _scaled_look(self, wanted: LensAdjustments) -> ScaledLook:
        """How the adjusted camera stands for the one that the lens was measured on."""
        if not self._scales:
            return UNSCALED
        focal = (self._start | wanted.camera)["focal_length_mm"]
        return scaled_look(self.preset, focal, self._sensor_width_mm)

    def _spanned_camera(self, scaled: ScaledLook) -> Camera:
        """What the frame spans of the photographed sensor."""
        own = self.preset.camera
        if scaled == UNSCALED:
            return own
        share = scaled.measured_width_mm / own.sensor_width_mm
        return msgspec.structs.replace(
            own,
            sensor_width_mm=scaled.measured_width_mm,
            sensor_height_mm=own.sensor_height_mm * share,
        )

    def _pixel_mm(self, lens: Lens) -> float:
        """Of the measured lens' picture."""
        return lens.sensor_size_mm[0] / self.preset.camera.image_width_px

    def width_mm(self, name: Tiles, wanted: LensQuery) -> float:
        """Width of a tile of a drawing that holds what it shows, on the sensor of the
        camera that is looked at.

        Raises
        ------
        LensfitError : It cannot be drawn at that state.
        """
        state = msgspec.structs.replace(wanted, lens=0, newest=False)
        key = name, msgspec.json.encode(state)
        if key not in self._widths_mm:
            if len(self._widths_mm) >= _KEPT_WIDTHS:
                self._widths_mm.clear()
            to_plate = self._scaled_look(wanted).lengths
            self._widths_mm[key] = self._width_mm(name, wanted) * to_plate
        return self._widths_mm[key]

    def _width_mm(self, name: Tiles, wanted: LensQuery) -> float:
        lens = self.lens(wanted)
        pixel_mm, point = self._pixel_mm(lens), _point_mm(lens, wanted)
        if name == "through":
            widest = self.lens(wanted, self._stops(lens)[0])
            defocus = self._defocus(lens, widest, wanted)
            return width_through_mm(widest, point, defocus, pixel_mm)
        distance = self._object_distance_mm(lens, wanted)
        if name == "field":
            return width_of_field_mm(lens, distance, pixel_mm)
        return width_of_blur_mm(lens, point, np.array([distance]), pixel_mm)

    def _defocus(
        self, lens: Lens, widest: Lens, wanted: LensQuery
    ) -> tuple[float, ...]:
        """Of the distances through focus."""
        wanted_mm = self._object_distance_mm(lens, wanted)
        vergence = 1 / (wanted_mm - float(lens.entrance_pupil_offset_mm))
        to_focus = lens.blur_per_vergence()[1]
        usual = usual_defocus(widest, self._pixel_mm(lens))
        return _through_focus(vergence - to_focus, usual, -to_focus)

    def field(self, wanted: LensQuery, least_mm: float = 0.0) -> dict[str, Any]:
        """Point-spread functions over the field, and how well they are known.

        Parameters
        ----------
        least_mm : Width of a tile, where the blur needs no wider one.

        Raises
        ------
        LensfitError : They are not known at that state.
        """
        lens = self.lens(wanted)
        distance, pixel_mm = (
            self._object_distance_mm(lens, wanted),
            self._pixel_mm(lens),
        )
        to_plate = self._scaled_look(wanted).lengths
        width_mm = max(self.width_mm("field", wanted), least_mm) / to_plate
        tiles = field_tiles(lens, distance, width_mm)
        return {
            "picture": png_address(png(sheet_of(tiles))),
            "width_px": width_mm / pixel_mm,
            "width_mm": width_mm * to_plate,
            "errors": expected_errors(lens, distance, width_mm),
            "notes": lens.notes,
        }

    def point(self, wanted: LensQuery, least_mm: float = 0.0) -> dict[str, Any]:
        """The point-spread function of one point in colour, and its deviation in green.

        Parameters
        ----------
        least_mm : As of `field`.

        Raises
        ------
        LensfitError : It is not known at that state.
        """
        lens, to_plate = self.lens(wanted), self._scaled_look(wanted).lengths
        distance, point = (
            self._object_distance_mm(lens, wanted),
            _point_mm(lens, wanted),
        )
        pixel_mm = self._pixel_mm(lens)
        width_mm = max(self.width_mm("point", wanted), least_mm) / to_plate
        drawn: dict[str, Any] = {
            "pixel_pitch_mm": width_mm / _FINE_PX,
            "size_px": _FINE_PX,
            "tolerance": _FINE_TOLERANCE,
        }
        psfs = np.asarray(lens.psfs(point, distance, **drawn)[0])
        peak = float(psfs.max()) or 1.0
        found = {
            "picture": png_address(_colour_png(psfs / peak)),
            "width_px": width_mm / pixel_mm,
            "width_mm": width_mm * to_plate,
            "x_mm": round(float(point[0, 0]) * to_plate, 3),
            "y_mm": round(float(point[0, 1]) * to_plate, 3),
            "deviation": None,
            "error": None,
        }
        if lens.blur is not None and lens.moved_blurs is not None:
            known = lens.known_psfs(point, distance, draws=_DRAWS, **drawn)
            deviation = known.deviation[0] / peak
            found["deviation"] = png_address(_colour_png(np.stack([deviation] * 3)))
            found["error"] = plain(float(known.relative_shape_error()[0]))
        return found

    def through(self, wanted: LensQuery, least_mm: float = 0.0) -> dict[str, Any]:
        """The point through focus (across) and through the aperture (down).

        Parameters
        ----------
        least_mm : As of `field`.

        Raises
        ------
        LensfitError : It is not known at that state.
        """
        lens = self.lens(wanted)
        stops = self._stops(lens)
        lenses = [self.lens(wanted, stop) for stop in stops]
        pixel_mm, point = self._pixel_mm(lens), _point_mm(lens, wanted)
        defocus = self._defocus(lens, lenses[0], wanted)
        scaled = self._scaled_look(wanted)
        width_mm = max(self.width_mm("through", wanted), least_mm) / scaled.lengths
        found = through_tiles(lenses, point, defocus, width_mm)
        return {
            "picture": png_address(png(sheet_of(found.tiles[0]))),
            "f_numbers": stops,
            "distances_mm": [
                plain_distance(mm * scaled.distances) for mm in found.distances_mm
            ],
            "width_px": width_mm / pixel_mm,
            "width_mm": width_mm * scaled.lengths,
        }

    def _stops(self, lens: Lens) -> tuple[float, ...]:
        """Those whose blur was photographed, as full stops beyond."""
        known = {
            s.f_number for e in self.preset.entries if e.blur for s in e.blur.stops
        }
        if not known and lens.f_number is None:
            raise LensfitError(
                "nobody knows an f-number of this lens", remedy="state one"
            )
        return f_numbers_of(sorted(known or {lens.f_number or 0.0}))

    def figures(self, wanted: LensQuery) -> list[dict[str, str]]:
        """Distortion, lateral colour, fall-off, breathing, each with its deviation.

        Raises
        ------
        LensfitError : The preset does not reach that state.
        """
        lens = self.lens(wanted)
        of_stops = [self.lens(wanted, stop) for stop in self._fall_off_stops(lens)]
        camera = self._spanned_camera(self._scaled_look(wanted))
        facts = lens_facts(lens, of_stops, camera)
        found = entry_figures(facts, msgspec.to_builtins(camera))
        breath = breathing_facts(self.preset, lens)
        figure = None if breath is None else breathing(breath)
        return [_figure(one) for one in (*found, *([figure] if figure else ()))]

    def _object_distance_mm(self, lens: Lens, wanted: LensQuery) -> float:
        """Before the measured lens."""
        stated = distance_of(wanted.object_distance_mm)
        if stated is not None:
            return stated / self._scaled_look(wanted).distances
        found = lens.focus_distance_mm
        if found is None and lens.blur is not None:
            found = float(lens.blur.reference_distance_mm)
        return math.inf if found is None else found

    def _fall_off_stops(self, lens: Lens) -> list[float]:
        """Some that were photographed, and the one that is adjusted to."""
        known = {
            f.f_number for e in self.preset.entries for f in e.fall_off if f.f_number
        }
        ordered = sorted(known)
        chosen = np.linspace(0, len(ordered) - 1, min(len(ordered), _MOST_STOPS))
        kept = {ordered[round(k)] for k in chosen}
        now = lens.f_number
        if known and now is not None and ordered[0] <= now <= ordered[-1]:
            kept.add(now)
        return sorted(kept)


def _start_camera(preset: Preset, opened: LensAdjustments) -> dict[str, float | None]:
    """What is stated, else the first entry, as wide open as was measured."""
    camera: dict[str, float | None] = dict.fromkeys(CAMERA) | opened.camera
    focal = camera["focal_length_mm"]

    def away(entry: Entry) -> float:
        return 0.0 if focal is None else abs(entry.focal_length_mm - focal)

    first = min(preset.entries, key=away)
    if focal is None:
        camera["focal_length_mm"] = first.focal_length_mm
    if camera["focus_distance_mm"] is None:
        camera["focus_distance_mm"] = first.focus_distance_mm
    if camera["f_number"] is None:
        camera["f_number"] = lens_ranges(preset)["widest_f_number"]
    return camera


def _through_focus(defocus: float, usual: float, farthest: float) -> tuple[float, ...]:
    """From beyond the plane of focus to before it, the object's own defocus among them.

    Parameters
    ----------
    usual, farthest : As of `defocus_of`.
    """
    ends = max(usual, abs(defocus)) / BEYOND
    return defocus_of([max(-ends, farthest), defocus, ends], usual, farthest)


def _point_mm(lens: Lens, wanted: LensQuery) -> Float[np.ndarray, "1 2"]:
    return np.array([[wanted.x, wanted.y]]) * np.asarray(lens.sensor_size_mm) / 2


def _colour_png(light: Float[np.ndarray, "3 height width"]) -> bytes:
    """Light relative to the brightest, to the power that the report draws it to."""
    shown = np.clip(np.nan_to_num(light), 0, 1) ** GAMMA
    picture = np.moveaxis(np.round(255 * shown).astype(np.uint8), 0, -1)
    _, buffer = cv2.imencode(".png", np.ascontiguousarray(picture[..., ::-1]))
    return buffer.tobytes()


def _figure(figure: Figure) -> dict[str, str]:
    return {
        "key": figure.key,
        "title": figure.title,
        "svg": str(figure.svg),
        "caption": figure.caption,
    }
