"""Rays of a lens as sums of Chebyshev polynomials, for a camera of a path tracer.

The lens computes where the ray of an object point through a place of the stop lands.
Here that is inverted: for a position on the sensor and a place in the stop, the objects
that the ray meets at three distances are found. They lie on a straight line but for
what first order neglects of a change of distance; the line nearest to all three is
taken, its tangent and its crossing of the entrance pupil's plane being functions of
position and place. `lensfit.exchange.cycles_osl` describes the sums.
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from jaxtyping import Float
from numpy.polynomial import chebyshev

from lensfit.errors import ExchangeError
from lensfit.exchange.cycles_lens import (
    WAVELENGTHS,
    ChannelSeries,
    CyclesLens,
    LensOpening,
    Series,
)
from lensfit.exchange.samples import ExchangeFrame, Residual, residual_from
from lensfit.optics.stop_places import stop_arcs
from lensfit.psf.polar_rays import stop_rays

if TYPE_CHECKING:
    from lensfit.lens import Lens
    from lensfit.psf.lens_blur import LensBlur

_LANDING_NODES = (11, 9)
_FRAME_NODES = (15, 13)
_LIGHT_NODES = (37, 31)
"""Across and down: of landing points, of lines, and of brightness."""
_FIELD_DEGREE, _PLACE_DEGREE, _LIGHT_DEGREE = 11, 9, 16
_RINGS, _SPOKES = 5, 20
"""Of places in the stop that sums go through."""
_JUDGED, _JUDGED_PLACES = (13, 9), 50
_STEPS = 4
"""Of fixed-point iterations."""
_INVISIBLE_PX = 3e-3
"""Of each coefficient; there are hundreds."""
_INVISIBLE_LIGHT = 1e-3
_ROOM = 1.05
"""Of the nodes beyond the farthest landing point."""
_DARK = 1e-3
"""Of the light of the brightest position: no brightness is told there."""
_NEAREST_OF_FOCAL = 0.8
"""Vergence of the nearest object over that of the front focal plane's."""
_MEAN_PLACES = 1500
"""Of which the mean light is taken."""
_GOLDEN_ANGLE = np.pi * (3 - 5**0.5)


class RaySeriesError(NamedTuple):
    """How near the sums are to the lens.

    Attributes
    ----------
    chief : Rays through the middle of the pupil, at the focus distance.
    rays : All, from infinity to half the focus distance.
    worst_light : Largest error of relative illumination.
    """

    chief: Residual
    rays: Residual
    worst_light: float


@dataclass(frozen=True, eq=False)
class _Scene:
    """The lens, the frame and the distances at which its rays are followed.

    Attributes
    ----------
    vergences_per_mm : From the entrance pupil: infinity, focus, nearer.
    channels : That have rays of their own; green alone where all share them.
    """

    lens: "Lens"
    blur: "LensBlur"
    frame: ExchangeFrame
    vergences_per_mm: np.ndarray
    channels: tuple[int, ...]

    @property
    def half_mm(self) -> np.ndarray:
        """Half width and height of the frame with its overscan."""
        return (
            np.array(self.frame.area_mm) / 2 * (1 + self.frame.overscan_percent / 100)
        )

    def landings(self, green_mm: np.ndarray, vergence: float, channel: int, places):
        """`psf.polar_rays.stop_rays` of points at one distance; places in the reach."""
        distance = 1 / vergence if vergence > 0 else np.inf
        distance += float(self.lens.entrance_pupil_offset_mm)
        n = len(green_mm)
        points = green_mm, np.full(n, distance), np.full(n, channel)
        optics = self.blur, self.lens.distortion, self.lens.lateral_colour
        reach = stop_arcs(self.blur.pupil).reach
        found = stop_rays(points, optics, np.asarray(places) * reach)
        if len(self.channels) == 1:
            mean = (part.mean(2, keepdims=True) for part in found)
            return type(found)(*mean)
        return found

    def tangents(self, green_mm: np.ndarray, vergence: float) -> np.ndarray:
        """Of objects whose green chief rays land there."""
        lens = self.lens
        point = np.asarray(lens.distortion.principal_point_mm)
        c = float(lens.distortion.principal_distance_mm)
        flat = green_mm.reshape(-1, 2)
        straight = np.asarray(lens.undistorted_from_distorted(flat))
        slope = (straight - point) / c
        return (slope * self._tangent_ratio(slope, vergence)).reshape(green_mm.shape)

    def landed_px(self, tangents: np.ndarray, vergence: float) -> np.ndarray:
        """Where the chief ray of an object lands, px."""
        lens = self.lens
        if vergence > 0:
            ahead = np.full((len(tangents), 1), 1 / vergence)
            objects = np.concatenate([tangents / vergence, ahead], 1)
            objects[:, 2] += float(lens.entrance_pupil_offset_mm)
            return self.frame.px(np.asarray(lens.project(objects)))
        point = np.asarray(lens.distortion.principal_point_mm)
        c = float(lens.distortion.principal_distance_mm)
        slope = tangents
        for _ in range(_STEPS):
            slope = tangents / self._tangent_ratio(slope, 0.0)
        straight = point + c * slope
        return self.frame.px(np.asarray(lens.distorted_from_undistorted(straight)))

    def _tangent_ratio(self, slope: np.ndarray, vergence: float) -> np.ndarray | float:
        """Tangent in the scene over that of the map, which holds at the chart."""
        pupil_shift = self.lens.pupil_shift
        if pupil_shift is None:
            return 1.0
        apart = vergence - 1 / float(pupil_shift.chart_distance_mm)
        scale = np.ones((len(slope), 1))
        for _ in range(_STEPS):
            across = np.sum((slope * scale) ** 2, -1, keepdims=True)
            scale = 1 - float(pupil_shift.shift_mm) * across / (1 + across) * apart
        return scale


def fit_ray_series(
    lens: "Lens", frame: ExchangeFrame
) -> tuple[CyclesLens, RaySeriesError]:
    """The sums for a lens at its state, and how near they are.

    Raises
    ------
    ExchangeError : The lens sees 90 degrees off axis within the frame.
    LensfitError : Its blur was not measured, and f-number or focus are unknown.
    """
    scene = _scene(lens, frame)
    places = _disc(_RINGS, _SPOKES)
    nodes = _nodes(*_FRAME_NODES)
    channels, weight = [], None
    for channel in scene.channels:
        bent, light = _lines(scene, nodes, places, channel)
        channels.append(_channel_series(bent, nodes, places, scene))
        if channel == scene.channels[len(scene.channels) // 2]:
            weight = _pruned(nodes, places, light[:, :, None], (_INVISIBLE_LIGHT,))
    assert weight is not None
    made = CyclesLens(
        frame.sensor_width_mm,
        (float(scene.half_mm[0]), float(scene.half_mm[1])),
        tuple(ChannelSeries(x, y, weight) for x, y in channels),
        weight,
        _opening(scene),
    )
    made = _with_brightness(made, scene)
    return made, _series_error(made, scene)


def _scene(lens: "Lens", frame: ExchangeFrame) -> _Scene:
    blur = lens.blur or lens.perfect_blur()
    offset = float(lens.entrance_pupil_offset_mm)
    focus = lens.focus_distance_mm
    if focus is None:
        focus = float(blur.reference_distance_mm)
    most = _NEAREST_OF_FOCAL / (blur.nearest_mm - offset)
    sharp = 1 / (focus - offset)
    near = min(2 * sharp, most) if sharp > most / 1000 else most / 20
    middle = sharp if 0 < sharp < near else near / 2
    colour = blur.aberration.colour_um
    is_grey = lens.lateral_colour is None and not np.asarray(colour).any()
    channels = (1,) if is_grey else (0, 1, 2)
    return _Scene(lens, blur, frame, np.array([0.0, middle, near]), channels)


def _nodes(columns: int, rows: int) -> Float[np.ndarray, "nodes 2"]:
    """Chebyshev's, on the square of the frame."""
    x, y = (np.cos(np.pi * (np.arange(n) + 0.5) / n) for n in (columns, rows))
    return np.stack(np.meshgrid(x, y), -1).reshape(-1, 2)


def _disc(rings: int, spokes: int) -> Float[np.ndarray, "places 2"]:
    """Places on rings and spokes, the outermost on the edge of the unit disc."""
    square, _ = np.polynomial.legendre.leggauss(rings)
    reach = np.sqrt((square + 1) / 2)
    reach[-1] = 1.0
    turn = np.arange(spokes) * (2 * np.pi / spokes)
    x, y = (np.outer(reach, f(turn)).ravel() for f in (np.cos, np.sin))
    return np.stack([x, y], -1)


def _spiral(count: int) -> Float[np.ndarray, "places 2"]:
    """Places that fill the unit disc evenly."""
    number = np.arange(count)
    turn, reach = number * _GOLDEN_ANGLE, np.sqrt((number + 0.5) / count)
    return np.stack([reach * np.cos(turn), reach * np.sin(turn)], -1)


def _lines(
    scene: _Scene, nodes: np.ndarray, places: np.ndarray, channel: int
) -> tuple[np.ndarray, np.ndarray]:
    """Tangent and crossing of the ray of each node, place and wavelength, (nodes,
    places, wavelengths, 2, 2); and the light of green's."""
    at_mm = nodes * scene.half_mm
    tangents, light = [], None
    for number, vergence in enumerate(scene.vergences_per_mm):
        green_mm, share = _met(scene, at_mm, vergence, channel, places)
        tangents.append(scene.tangents(green_mm, vergence))
        if number == 1:
            followed = _area_followed(nodes, green_mm.mean(2), scene.half_mm)
            light = share.mean(2) * followed
    both = np.linalg.pinv(np.vander(scene.vergences_per_mm, 2, increasing=True))
    found = np.einsum("lv,vnpwc->npwcl", both, np.stack(tangents))
    assert light is not None
    if not np.isfinite(found).all():
        raise ExchangeError(
            "the lens sees 90 degrees off axis within the frame, or folds",
            where=str(scene.frame),
            remedy="use less overscan",
        )
    return found, light / light.mean()


def _met(
    scene: _Scene, at_mm: np.ndarray, vergence: float, channel: int, places: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Where the green chief ray of the object lands that each ray meets, (nodes,
    places, wavelengths, 2), and the light of each ray."""
    coarse = _nodes(*_LANDING_NODES)
    corners = scene.half_mm * np.array([[1, 1], [1, -1], [-1, 1], [-1, -1], [0, 0]])
    reach = scene.landings(corners, vergence, channel, places).landing_mm
    half = scene.half_mm + _ROOM * np.abs(reach).max()
    found = scene.landings(coarse * half, vergence, channel, places)
    invert = np.linalg.inv(_field(coarse, *(n - 1 for n in _LANDING_NODES)))
    moved = np.tensordot(invert, found.landing_mm, 1)
    bright = np.tensordot(invert, found.light, 1)
    green = np.broadcast_to(
        at_mm[:, None, None], (len(at_mm), *found.landing_mm.shape[1:])
    )
    shapes = np.zeros(0)
    for _ in range(_STEPS):
        shapes = _field(green / half, *(n - 1 for n in _LANDING_NODES))
        green = at_mm[:, None, None] - np.einsum("npwk,kpwc->npwc", shapes, moved)
    return green, np.einsum("npwk,kpw->npw", shapes, bright)


def _field(at: np.ndarray, columns: int, rows: int) -> np.ndarray:
    """Products of the polynomials of x and y up to these degrees, on a last axis."""
    return chebyshev.chebvander2d(at[..., 0], at[..., 1], [columns, rows])


def _area_followed(
    nodes: np.ndarray, green_mm: np.ndarray, half_mm: np.ndarray
) -> np.ndarray:
    """|d object / d position|: the area of the object that a pixel takes."""
    degrees = [n - 1 for n in _FRAME_NODES]
    values = np.linalg.inv(_field(nodes, *degrees)) @ green_mm.reshape(len(nodes), -1)
    shape = (degrees[0] + 1, degrees[1] + 1, -1)
    slopes = []
    for axis in (0, 1):
        turned = chebyshev.chebder(values.reshape(shape), axis=axis)
        at = _field(nodes, *(n - 1 for n in turned.shape[:2]))
        slope = at @ turned.reshape(-1, turned.shape[-1]) / half_mm[axis]
        slopes.append(slope.reshape(*green_mm.shape))
    along, across = slopes
    return np.abs(along[..., 0] * across[..., 1] - along[..., 1] * across[..., 0])


def _channel_series(
    lines: np.ndarray, nodes: np.ndarray, places: np.ndarray, scene: _Scene
) -> tuple[Series, Series]:
    mean, change = lines.mean(2), np.zeros_like(lines[:, :, 0])
    if lines.shape[2] == len(WAVELENGTHS):
        change = (lines[:, :, 2] - lines[:, :, 0]) / 2
    pixel = scene.frame.pitch_mm / float(scene.lens.distortion.principal_distance_mm)
    unseen = _INVISIBLE_PX * pixel
    crossing = unseen / scene.vergences_per_mm[-1]
    limits = (unseen, unseen, crossing, crossing)
    x, y = (
        _pruned(
            nodes,
            places,
            np.stack(
                [mean[..., axis, 0], change[..., axis, 0],
                 mean[..., axis, 1], change[..., axis, 1]], -1),
            limits,
        )
        for axis in (0, 1)
    )  # fmt: skip
    return x, y


def _pruned(
    nodes: np.ndarray,
    places: np.ndarray,
    values: Float[np.ndarray, "nodes places columns"],
    limits: tuple[float, ...],
) -> Series:
    """The sum through values at nodes and places, without what nobody sees."""
    field_degrees, field = _basis(nodes, _FIELD_DEGREE)
    place_degrees, place = _basis(places, _PLACE_DEGREE)
    found = np.tensordot(np.linalg.pinv(field), values, 1)
    found = np.einsum("fpc,gp->fgc", found, np.linalg.pinv(place), optimize=True)
    keep = (np.abs(found) / np.array(limits)).max(-1) > 1
    keep[0, 0] = True
    at_field, at_place = np.nonzero(keep)
    degrees = np.concatenate([field_degrees[at_field], place_degrees[at_place]], 1)
    return Series(degrees, found[keep])


def _basis(at: np.ndarray, degree: int) -> tuple[np.ndarray, np.ndarray]:
    """Degrees of all products up to a total, and the products."""
    n = np.arange(degree + 1)
    pairs = np.stack(np.meshgrid(n, n, indexing="ij"), -1).reshape(-1, 2)
    pairs = pairs[pairs.sum(1) <= degree]
    table = chebyshev.chebvander(at, degree)
    return pairs, table[:, 0, pairs[:, 0]] * table[:, 1, pairs[:, 1]]


def _opening(scene: _Scene) -> LensOpening:
    pupil, blur = scene.blur.pupil, scene.blur
    x, y = np.asarray(scene.lens.distortion.principal_point_mm).tolist()

    def pairs(values) -> tuple[tuple[float, float], ...]:
        return tuple((float(a), float(b)) for a, b in np.asarray(values))

    return LensOpening(
        axis_mm=(x, y),
        field_radius_mm=float(blur.aberration.field_radius_mm),
        stop_radius=float(blur.stop_radius),
        stop_shift=pairs(np.asarray(pupil.stop_shift)[None])[0],
        rim_shift=pairs(pupil.rim_shift),
        rim_radius=pairs(pupil.rim_radius),
        arcs=stop_arcs(pupil),
    )


def _with_brightness(made: CyclesLens, scene: _Scene) -> CyclesLens:
    """So that the mean over all places is the relative illumination."""
    nodes = _nodes(*_LIGHT_NODES)
    wanted = _wanted_light(made, scene, nodes * scene.half_mm)
    degrees, shapes = _basis(nodes, _LIGHT_DEGREE)
    found = np.linalg.lstsq(shapes, wanted.T, rcond=None)[0]
    keep = np.abs(found).max(1) > _INVISIBLE_LIGHT
    keep[0] = True
    degrees = np.concatenate([degrees, np.zeros_like(degrees)], 1)[keep]
    channels = tuple(
        one._replace(brightness=Series(degrees, found[keep, number, None]))
        for number, one in enumerate(made.channels)
    )
    return CyclesLens(made.width_mm, made.half_mm, channels, made.weight, made.opening)


def _wanted_light(made: CyclesLens, scene: _Scene, at_mm: np.ndarray) -> np.ndarray:
    """Relative illumination over the mean light that comes through, of each channel."""
    passed = _mean_light(made, at_mm)
    dark = passed < _DARK * passed.max()
    rows = []
    for channel in scene.channels:
        name = "rgb"[channel]
        light = np.asarray(scene.lens.relative_illumination(at_mm, name))  # pyright: ignore
        rows.append(np.where(dark, 0.0, light / np.where(dark, 1.0, passed)))
    return np.stack(rows)


def _mean_light(made: CyclesLens, at_mm: np.ndarray) -> np.ndarray:
    """Mean weight over evenly drawn places, those that are stopped counting nothing."""
    places = _spiral(_MEAN_PLACES)
    weight = made.weight.on_grid(at_mm / np.array(made.half_mm), places)[..., 0]
    every = np.repeat(at_mm, _MEAN_PLACES, 0), np.tile(places, (len(at_mm), 1))
    open_ = made.opening.passes(*every).reshape(weight.shape)
    return (weight * open_).mean(1)


def _series_error(made: CyclesLens, scene: _Scene) -> RaySeriesError:
    """At other points than those that the sums went through."""
    x, y = (np.linspace(-0.97, 0.97, n) for n in _JUDGED)
    green_mm = np.stack(np.meshgrid(x, y), -1).reshape(-1, 2) * scene.half_mm
    places = _spiral(_JUDGED_PLACES)
    off = [
        _ray_miss_px(made, scene, green_mm, places, channel, vergence)
        for channel in scene.channels
        for vergence in scene.vergences_per_mm
    ]
    middle = scene.channels[len(scene.channels) // 2]
    chief = _ray_miss_px(
        made, scene, green_mm, np.zeros((1, 2)), middle, scene.vergences_per_mm[1]
    )
    wanted = _wanted_light(made, scene, green_mm) * _mean_light(made, green_mm)
    half = np.array(made.half_mm)
    given = np.stack(
        [
            one.brightness.at(green_mm / half, np.zeros_like(green_mm))[:, 0]
            for one in made.channels
        ]
    ) * _mean_light(made, green_mm)
    return RaySeriesError(
        residual_from(chief),
        residual_from(np.concatenate(off)),
        float(np.abs(given - wanted).max()),
    )


def _ray_miss_px(
    made: CyclesLens,
    scene: _Scene,
    green_mm: np.ndarray,
    places: np.ndarray,
    channel: int,
    vergence: float,
) -> np.ndarray:
    """How far beside its object each ray goes, as the chief ray shows it, px."""
    landed = scene.landings(green_mm, vergence, channel, places).landing_mm
    count, rays, wavelengths, _ = landed.shape
    at_px, off = scene.frame.px(green_mm), []
    every = np.repeat(np.arange(count), rays)
    place = np.tile(places, (count, 1))
    for number in range(wavelengths):
        at_mm = (green_mm[:, None] + landed[:, :, number]).reshape(-1, 2)
        inside = (np.abs(at_mm) <= scene.half_mm).all(-1)
        inside &= made.opening.passes(at_mm, place)
        shift = WAVELENGTHS[number] if wavelengths > 1 else 0
        own = scene.channels.index(channel)
        tangent, crossing = made.rays(at_mm[inside], place[inside], own, shift)
        met = scene.landed_px(tangent + vergence * crossing, vergence)
        off.append(np.linalg.norm(met - at_px[every[inside]], axis=-1))
    return np.concatenate(off)
