"""A UV map of another program (or of lensfit) as a lens: its effect on the picture.

A map does not describe the lens behind it: its picture is taken to span the stated
sensor width, with the axis at its centre.
"""

from dataclasses import dataclass, field
from pathlib import Path
from typing import final

import numpy as np
from jaxtyping import Float
from scipy.interpolate import RectBivariateSpline

from lensfit.coords import Window, mm_from_px, px_from_mm, px_from_uv
from lensfit.errors import ExchangeError
from lensfit.exchange.foreign import (
    ForeignLens,
    ForeignState,
    Points,
    StatedValues,
    inverse_points,
)
from lensfit.io.stmap import Stmap, read_stmap

_MM_PER_M = 1000.0
_KNOTS = 400
"""At most so many samples across and down: a lens is smooth."""


@final
@dataclass(frozen=True, eq=False)
class UvMap:
    """One channel of a map as a smooth function.

    Attributes
    ----------
    direction : "undistort" (values are distorted positions) or "redistort".
    columns_px, rows_px : Pixel centres of the samples, in the display window.
    source_px : Their values, pixels of the display window.
    """

    direction: str
    columns_px: Float[np.ndarray, " columns"]
    rows_px: Float[np.ndarray, " rows"]
    source_px: Float[np.ndarray, "rows columns 2"]
    size_px: tuple[int, int]
    area_mm: tuple[float, float]
    _splines: list[RectBivariateSpline] = field(init=False)

    def __post_init__(self):
        splines = [
            RectBivariateSpline(self.rows_px, self.columns_px, self.source_px[..., k])
            for k in (0, 1)
        ]
        object.__setattr__(self, "_splines", splines)

    def distorted(self, undistorted_mm: Points) -> Points:
        """NaN beyond the map."""
        if self.direction == "undistort":
            return self._looked_up(undistorted_mm)
        return self._inverse_positions(undistorted_mm)

    def undistorted(self, distorted_mm: Points) -> Points:
        """NaN beyond the map."""
        if self.direction == "redistort":
            return self._looked_up(distorted_mm)
        return self._inverse_positions(distorted_mm)

    def _inverse_positions(self, points_mm: Points) -> Points:
        unit = float(np.hypot(*self.area_mm)) / 2
        found = inverse_points(
            lambda p: self._looked_up(p, clamp=True), points_mm, unit
        )
        return np.where(self._inside(self._px(found))[:, None], found, np.nan)

    def _looked_up(self, points_mm: Points, *, clamp: bool = False) -> Points:
        at = self._px(points_mm)
        source = np.stack([s.ev(at[:, 1], at[:, 0]) for s in self._splines], -1)
        if clamp:
            # beyond the map it goes on with the slope of its border
            low = np.array([self.columns_px[0], self.rows_px[0]])
            high = np.array([self.columns_px[-1], self.rows_px[-1]])
            source = source + (at - np.clip(at, low, high))
        landed = mm_from_px(source, self.size_px, self.area_mm)
        return landed if clamp else np.where(self._inside(at)[:, None], landed, np.nan)

    def _inside(self, at: np.ndarray) -> np.ndarray:
        """Half a pixel beyond the outermost centres is the border of the map."""
        columns, rows = self.columns_px, self.rows_px
        with np.errstate(invalid="ignore"):
            x = (at[:, 0] >= columns[0] - 0.51) & (at[:, 0] <= columns[-1] + 0.51)
            y = (at[:, 1] >= rows[0] - 0.51) & (at[:, 1] <= rows[-1] + 0.51)
        return x & y

    def _px(self, points_mm: Points) -> np.ndarray:
        return px_from_mm(np.asarray(points_mm, float), self.size_px, self.area_mm)


def lens_of_uv_map(path: Path, stated: StatedValues) -> ForeignLens:
    """The lens behind a UV map.

    Raises
    ------
    ImageError : The file holds no UV map in 32-bit float.
    ExchangeError : Its direction, sensor width or focal length is not known, or it has
        holes.
    """
    found = read_stmap(path)
    direction = stated.direction or found.attributes.get("lensfit/map")
    if direction not in ("undistort", "redistort"):
        raise ExchangeError(
            "does not say which way it goes",
            where=path,
            remedy="give --direction undistort (values are distorted positions) or "
            "redistort",
        )
    width = _positive_mm(
        found, stated.sensor_width_mm, "lens/aperture", path, "sensor-width"
    )
    focal = _positive_mm(
        found, stated.focal_length_mm, "lens/focal", path, "focal-length"
    )
    display = found.display_window
    size = (display.width, display.height)
    if stated.size_px not in (None, size):
        raise ExchangeError(
            f"is a map for {size[0]} x {size[1]}", where=path, remedy="leave --size out"
        )
    area = (width, width * size[1] / size[0])
    maps = _maps(found, direction, area, path)

    def channel_from_green(channel: str):
        return lambda green: maps[channel].distorted(maps["g"].undistorted(green))

    state = ForeignState(
        map=maps["g"],
        principal_distance_mm=focal,
        principal_point_mm=(0.0, 0.0),
        focal_length_mm=focal,
        focus_distance_mm=stated.focus_distance_mm or _focus(found),
        channels={c: channel_from_green(c) for c in maps if c != "g"},
        assumed=("principal_distance_mm", "principal_point_mm"),
    )
    name = found.attributes.get("lensfit/lens")
    return ForeignLens(
        f"UV map ({direction})",
        str(name) if name else path.stem,
        area,
        size,
        (state,),
        notes=("a UV map does not know the axis: the middle of the frame is taken",),
    )


def _maps(
    found: Stmap, direction: str, area: tuple[float, float], path: Path
) -> dict[str, UvMap]:
    """By channel: green's, and those of the colours that have one of their own."""
    uv = {**found.channel_uv, "g": found.uv}
    return {c: _map(found, uv[c], direction, area, path) for c in "grb" if c in uv}


def _positive_mm(
    found: Stmap, stated: float | None, key: str, path: Path, option: str
) -> float:
    """A length that was stated, else that of the file's header."""
    value = stated if stated is not None else found.attributes.get(key)
    if not isinstance(value, (int, float)) or not 0 < value < 1e6:
        raise ExchangeError(
            f"does not state the {option.replace('-', ' ')}",
            where=path,
            remedy=f"give --{option}-mm",
        )
    return float(value)


def _focus(found: Stmap) -> float | None:
    metres = found.attributes.get("lens/focus")
    if not isinstance(metres, (int, float)) or not metres > 0:
        return None
    return float(metres) * _MM_PER_M


def _map(
    found: Stmap,
    uv: np.ndarray,
    direction: str,
    area_mm: tuple[float, float],
    path: Path,
) -> UvMap:
    display, data = found.display_window, found.data_window
    if min(data.width, data.height) < 8:
        raise ExchangeError("is too small for a lens", where=path)
    rows, columns = (_evenly_spread_indices(n) for n in (data.height, data.width))
    source = px_from_uv(uv[np.ix_(rows, columns)].astype(float), display)
    source -= np.array(display[:2], float)
    if not np.isfinite(source).all() or np.abs(source).max() > 1e6:
        raise ExchangeError(
            "has pixels without a position, or positions far outside the frame",
            where=path,
            remedy="write the map with less overscan, so that it has no holes",
        )
    size = (display.width, display.height)
    window = Window(*data)
    return UvMap(
        direction,
        window.x_min - display.x_min + columns + 0.5,
        window.y_min - display.y_min + rows + 0.5,
        source,
        size,
        area_mm,
    )


def _evenly_spread_indices(count: int) -> np.ndarray:
    """Indices with both ends, evenly spread but whole."""
    return np.unique(np.linspace(0, count - 1, min(count, _KNOTS)).round().astype(int))
