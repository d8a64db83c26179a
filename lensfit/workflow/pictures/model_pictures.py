"""Pictures of every fitted take: the photograph, the model's, and the residual.

Green light. Photograph and model are shown with one exposure and the sRGB curve; the
residual, photograph minus model, in colour: orange where the photograph is brighter,
blue where it is darker, pale where they agree or where there are no marks.
"""

from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np
from jaxtyping import Bool, Float, UInt8

from lensfit.atomic import write_bytes_atomic
from lensfit.batches import in_batches
from lensfit.coords import mm_from_px
from lensfit.errors import LensfitError, OutputError
from lensfit.fitting.lens_states import FittedLens
from lensfit.lens import Lens
from lensfit.preset.schema import Preset
from lensfit.report.plain_numbers import round_up
from lensfit.workflow.calibration.observe import Observed
from lensfit.workflow.pictures.chart_drawing import drawing_of, modelled_light
from lensfit.workflow.pictures.predicted_points import PredictedPoints, predicted_points

FOLDER = "model"
TOTAL_BYTES = 1_900_000
"""Of all takes together, so that a page that holds them opens at once."""
_MOST_BYTES = 300_000
_STEPS = ((1400, 75), (1400, 50), (1100, 50), (800, 50))
"""Width and JPEG quality, until the three pictures of a take are small enough."""
_FULL_CHROMA = (
    cv2.IMWRITE_JPEG_SAMPLING_FACTOR,
    cv2.IMWRITE_JPEG_SAMPLING_FACTOR_444,
)
_GRID = (33, 25)
_WHITE_PERCENTILES, _OF_BRIGHTEST = (99.8, 99.99), 0.5
_LEFT_PERCENTILES = {False: 99.95, True: 99.0}
_BRIGHTER, _PALE, _DARKER = (213, 94, 0), (245, 244, 240), (0, 100, 178)
_LEAST_SHARE = 0.01
_STRIDE = 2
"""Of the pixels that exposure and colours are chosen by."""
_CODES = 4096


class Pictures(NamedTuple):
    """Three pictures of one size, and what the colours mean.

    Attributes
    ----------
    photograph, model : Display code values.
    left : Blue, green, red.
    left_share : Full colour, as a share of what is shown as white.
    """

    photograph: UInt8[np.ndarray, "height width"]
    model: UInt8[np.ndarray, "height width"]
    left: UInt8[np.ndarray, "height width 3"]
    left_share: float


def write_model_pictures(
    observed: list[Observed], fitted: FittedLens, preset: Preset, folder: Path
) -> dict[str, dict[str, Any]]:
    """Write ``folder/model/NAME_{photograph,model,left}.jpg`` of every fitted take.

    Returns
    -------
    By the take's name what the report says of it: the three paths, relative to
    `folder`; "left_share", the residual in full colour as a share of white;
    "explained", the share of the picture's variance; "blur_measured";
    "lighting_fitted", whether the chart's uneven light was fitted. Or "failed": why
    there are none.
    """
    shown = [o for o in observed if o.take is not None and o.small is not None]
    points = predicted_points(fitted, [o.take for o in shown if o.take is not None])
    shown = [o for o in shown if o.image in points]
    budget = min(_MOST_BYTES, TOTAL_BYTES // max(len(shown), 1))
    return {
        o.image: _pictures_or_reason(o, points[o.image], preset, folder, budget)
        for o in shown
    }


def _pictures_or_reason(
    observed: Observed,
    points: PredictedPoints,
    preset: Preset,
    folder: Path,
    budget_bytes: int,
) -> dict[str, Any]:
    """A picture that cannot be drawn must not cost a calibration."""
    try:
        return _written(observed, points, preset, folder, budget_bytes)
    except OutputError:
        raise
    except (LensfitError, ValueError, np.linalg.LinAlgError, cv2.error) as error:
        return {"failed": str(error)}


def _written(
    observed: Observed,
    points: PredictedPoints,
    preset: Preset,
    folder: Path,
    budget_bytes: int,
) -> dict[str, Any]:
    take, small, resolved = observed.take, observed.small, observed.resolved
    assert take is not None
    assert small is not None
    assert resolved is not None
    drawing = drawing_of(
        take.observations,
        points,
        small,
        resolved.target.kind,
        resolved.target.hole_diameter_mm,
    )
    lens = preset.at(
        focal_length_mm=take.focal_length_mm,
        f_number=take.f_number,
        focus_distance_mm=take.focus_distance_mm,
    )
    shape = small.light.shape
    seen = small.light.astype(np.float32)
    dark = drawing.field_is_bright
    found = modelled_light(
        seen,
        drawing,
        _fall_off(lens, shape, take.sensor_size_mm),
        dark=dark,
    )
    made = pictures_of(seen, found.light, drawing.inside, dark=dark)
    stem = observed.overlay.stem if observed.overlay else Path(observed.image).stem
    names = {}
    for name, data in zip(
        ("photograph", "model", "left"),
        _jpegs_within_budget(made, budget_bytes),
        strict=True,
    ):
        names[name] = f"{FOLDER}/{stem}_{name}.jpg"
        write_bytes_atomic(folder / names[name], data)
    return names | {
        "left_share": made.left_share,
        "explained": round(found.explained, 6),
        "blur_measured": drawing.blurred,
        "lighting_fitted": dark,
    }


def pictures_of(
    photograph: Float[np.ndarray, "height width"],
    model: Float[np.ndarray, "height width"],
    inside: Bool[np.ndarray, "height width"],
    *,
    dark: bool = False,
) -> Pictures:
    """Exposed for display, and their difference in colour.

    Parameters
    ----------
    photograph, model : Light in the same units.
    inside : Where the model says something.
    dark : Whether marks lie on a bright field, and not far apart on black.
    """
    some = slice(None, None, _STRIDE), slice(None, None, _STRIDE)
    among = inside[some] if inside[some].any() else np.ones_like(inside[some])
    # Marks may be few and small; a dark chart must not be shown as grey for that.
    usual, brightest = np.percentile(model[some][among], _WHITE_PERCENTILES)
    white = float(max(usual, _OF_BRIGHTEST * brightest))
    white = white if white > 0 else 1.0
    left = np.where(inside, (photograph - model) / np.float32(white), np.float32(0))
    large = float(np.percentile(np.abs(left[some][among]), _LEFT_PERCENTILES[dark]))
    share = min(round_up(max(large, _LEAST_SHARE)), 1.0)
    codes = np.rint(np.clip(left / share, -1, 1) * 127 + 128).astype(np.uint8)
    return Pictures(
        _display_codes(photograph / white),
        _display_codes(model / white),
        _TWO_WAYS[codes],
        share,
    )


def _two_ways() -> UInt8[np.ndarray, "256 3"]:
    """Blue, green and red of codes from darker over pale to brighter."""
    at = (np.arange(256) - 128) / 127
    ends = np.where(at[:, None] > 0, _BRIGHTER, _DARKER)
    mixed = np.abs(at)[:, None] * ends + (1 - np.abs(at))[:, None] * np.array(_PALE)
    return np.rint(np.clip(mixed, 0, 255)).astype(np.uint8)[:, ::-1].copy()


def _srgb() -> UInt8[np.ndarray, " codes"]:
    linear = np.linspace(0, 1, _CODES)
    curved = 1.055 * np.maximum(linear, 1e-9) ** (1 / 2.4) - 0.055
    return np.rint(255 * np.where(linear <= 0.0031308, 12.92 * linear, curved)).astype(
        np.uint8
    )


_TWO_WAYS, _SRGB = _two_ways(), _srgb()


def _display_codes(light: np.ndarray) -> UInt8[np.ndarray, "height width"]:
    return _SRGB[np.rint(np.clip(light, 0, 1) * (_CODES - 1)).astype(np.int32)]


def _fall_off(
    lens: Lens, shape: tuple[int, int], size_mm: tuple[float, float]
) -> Float[np.ndarray, "height width"]:
    """Relative illumination at the small pixels, interpolated from a coarse grid."""
    if lens.illumination is None:
        return np.ones(shape, np.float32)
    columns, rows = _GRID
    x, y = np.meshgrid(np.arange(columns) + 0.5, np.arange(rows) + 0.5)
    points = mm_from_px(np.stack([x.ravel(), y.ravel()], -1), _GRID, size_mm)
    light = in_batches(lens.relative_illumination, points)
    coarse = light.reshape(rows, columns).astype(np.float32)
    return np.asarray(
        cv2.resize(coarse, (shape[1], shape[0]), interpolation=cv2.INTER_LINEAR)
    )


def _jpegs_within_budget(made: Pictures, budget_bytes: int) -> list[bytes]:
    """All three as JPEG, as large and as good as the budget allows."""
    encoded = [b""]
    for width, quality in _STEPS:
        settings = [cv2.IMWRITE_JPEG_QUALITY, quality, *_FULL_CHROMA]
        encoded = [_jpeg(one, width, settings) for one in made[:3]]
        if sum(map(len, encoded)) <= budget_bytes:
            break
    return encoded


def _jpeg(picture: np.ndarray, longest_px: int, settings: list[int]) -> bytes:
    factor = longest_px / max(picture.shape[:2])
    if factor < 1:
        size = [max(1, round(side * factor)) for side in picture.shape[1::-1]]
        picture = np.asarray(cv2.resize(picture, size, interpolation=cv2.INTER_AREA))
    return cv2.imencode(".jpg", picture, settings)[1].tobytes()
