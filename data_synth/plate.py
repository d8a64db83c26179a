"""A small CG plate: pinhole beauty with depth, overscan and lens attributes.

A numpy ray caster: checkered ground, a wall with a grid of straight lines (so that
distortion shows), spheres, and a few small lamps far brighter than white. Sun with hard
shadows, sky light from the normal. Z is the perpendicular distance in metres; it is not
averaged over a pixel but taken at its centre, since depths do not mix.
"""

from pathlib import Path

import numpy as np
from jaxtyping import Float

from lensfit.coords import Window
from lensfit.io.exr import ExrImage, ExrPart, write_exr

SIZE_PX = (960, 540)
OVERSCAN_PERCENT = 10.0
FOCAL_MM = 28.0
SENSOR_WIDTH_MM = 28.0
CAMERA_HEIGHT_M = 0.75
WALL_Z_M = 7.0
WALL_HEIGHT_M = 2.35
SAMPLES = 4
"""Samples per pixel along each axis."""
SUN = np.array([-0.45, -0.75, -0.48])
SUN = SUN / np.linalg.norm(SUN)
"""Direction towards the sun: x right, y down, z into the scene."""

# Place x, z on the ground (m), radius (m), albedo r, g, b.
SPHERES = np.array(
    [
        [-1.35, 4.1, 0.58, 0.72, 0.13, 0.08],
        [0.15, 3.1, 0.36, 0.75, 0.72, 0.68],
        [1.60, 4.6, 0.70, 0.10, 0.22, 0.60],
        [-2.70, 5.6, 0.45, 0.16, 0.46, 0.14],
        [1.18, 2.8, 0.18, 0.80, 0.58, 0.10],
    ]
)
# Centre x, y, z (m), radius (m), radiance r, g, b.
LAMPS = np.array(
    [
        [-2.75, -1.35, 6.9, 0.030, 160.0, 120.0, 70.0],
        [-0.75, -1.35, 6.9, 0.030, 160.0, 120.0, 70.0],
        [1.25, -1.35, 6.9, 0.030, 160.0, 120.0, 70.0],
        [3.25, -1.35, 6.9, 0.030, 160.0, 120.0, 70.0],
        [0.68, 0.73, 3.0, 0.015, 40.0, 60.0, 120.0],
        [-0.62, 0.73, 2.9, 0.015, 120.0, 30.0, 20.0],
    ]
)


FAR_M = 1000.0
"""Depth written where there is only sky."""


BLACK = np.zeros(3)


def render_plate() -> tuple[
    Float[np.ndarray, "height width 3"], Float[np.ndarray, "height width"], Window
]:
    """Radiance, depth in metres and the data window (with overscan)."""
    margin_x, margin_y = (round(n * OVERSCAN_PERCENT / 200) for n in SIZE_PX)
    window = Window.of_size(*SIZE_PX).grown(margin_x, margin_y)
    radiance = np.zeros((window.height, window.width, 3))
    offsets = (np.arange(SAMPLES) + 0.5) / SAMPLES - 0.5
    for dy in offsets:
        for dx in offsets:
            colour, _ = _shade(_view_rays(window, dx, dy))
            radiance += colour / SAMPLES**2
    _, depth = _shade(_view_rays(window, 0.0, 0.0))
    return radiance, depth, window


def write_plate(path: Path) -> None:
    """Render the plate and write it as half-float EXR with a float Z channel."""
    radiance, depth_m, window = render_plate()
    channels: dict[str, np.ndarray] = {
        name: np.ascontiguousarray(radiance[..., k].astype(np.float16))
        for k, name in enumerate("RGB")
    }
    channels["A"] = np.ones(depth_m.shape, np.float16)
    # Sixteen bits of mantissa are ample for a depth and make the file half as large.
    depth_bits = depth_m.astype(np.float32).view(np.uint32)
    channels["Z"] = (
        ((depth_bits + 0x80) & 0xFFFFFF00).astype(np.uint32).view(np.float32)
    )
    attributes = {
        "lens/focal": FOCAL_MM,
        "lens/fstop": 4.0,
        "lens/focus": 1.5,
        "lens/aperture": SENSOR_WIDTH_MM,
        "lens/overscan": OVERSCAN_PERCENT,
    }
    part = ExrPart(
        channels=channels,
        data_window=window,
        display_window=Window.of_size(*SIZE_PX),
        attributes=attributes,
    )
    write_exr(path, ExrImage((part,)), compression="zip")


def _view_rays(window: Window, dx: float, dy: float):
    """Directions through the pixels with z = 1, so that depth is the ray parameter."""
    at_px = window.pixel_centres() + np.array([dx, dy]) - np.array(SIZE_PX) / 2
    slope = at_px * (SENSOR_WIDTH_MM / SIZE_PX[0] / FOCAL_MM)
    return np.concatenate([slope, np.ones((*slope.shape[:-1], 1))], axis=-1)


def _shade(direction):
    """Radiance and depth of what each ray from the pinhole meets first."""
    hits = _Hits(direction.shape[:-1])
    _meet_ground(direction, hits)
    _meet_wall(direction, hits)
    for ball in SPHERES:
        _meet_ball(direction, _resting(ball), hits)
    for lamp in LAMPS:
        _meet_ball(direction, lamp, hits, shines=True)
    seen = np.isfinite(hits.depth)
    place = direction * np.where(seen, hits.depth, 0.0)[..., None]
    sky = _sky(direction / np.linalg.norm(direction, axis=-1, keepdims=True))
    sunlit = np.clip(hits.normal @ SUN, 0.0, None)
    sunlit = sunlit * ~_shadowed(place + 1e-4 * hits.normal)
    ambient = 0.28 + 0.22 * np.clip(-hits.normal[..., 1], -1.0, 1.0)
    warm, cool = np.array([1.9, 1.75, 1.5]), np.array([0.8, 0.95, 1.2])
    light = sunlit[..., None] * warm + ambient[..., None] * cool
    lit = hits.albedo * light + hits.glow
    return np.where(seen[..., None], lit, sky), np.where(seen, hits.depth, FAR_M)


class _Hits:
    """The nearest surface met so far by each ray."""

    def __init__(self, shape: tuple[int, ...]):
        self.depth = np.full(shape, np.inf)
        self.normal = np.zeros((*shape, 3))
        self.albedo = np.zeros((*shape, 3))
        self.glow = np.zeros((*shape, 3))

    def offer(self, hit, t, normal, albedo, glow=BLACK) -> None:
        """Keep a surface where it is nearer than what is known."""
        nearer = hit & (t < self.depth)
        shape = self.normal.shape
        self.depth[nearer] = t[nearer]
        self.normal[nearer] = np.broadcast_to(normal, shape)[nearer]
        self.albedo[nearer] = np.broadcast_to(albedo, shape)[nearer]
        self.glow[nearer] = np.broadcast_to(glow, shape)[nearer]


def _resting(ball):
    """Centre, radius and colour of a sphere that rests on the ground."""
    x, z, radius, *colour = ball
    return np.array([x, CAMERA_HEIGHT_M - radius, z, radius, *colour])


def _sky(unit):
    up = np.clip(-unit[..., 1:2], 0.0, 1.0)
    return (1 - up) * np.array([0.75, 0.82, 0.9]) + up * np.array([0.22, 0.4, 0.8])


def _meet_ground(direction, hits: _Hits) -> None:
    """Checkered floor, half-metre squares."""
    with np.errstate(divide="ignore"):
        t = CAMERA_HEIGHT_M / direction[..., 1]
    hit = (t > 0) & (t < 200.0)
    place = direction * np.where(hit, t, 0.0)[..., None]
    dark = (np.floor(place[..., 0] / 0.5) + np.floor(place[..., 2] / 0.5)) % 2 == 0
    tone = np.where(dark[..., None], [0.10, 0.10, 0.11], [0.52, 0.50, 0.46])
    hits.offer(hit, t, np.array([0.0, -1.0, 0.0]), tone)


def _meet_wall(direction, hits: _Hits) -> None:
    """A wall square to the camera with straight dark lines, a quarter metre apart."""
    place = direction * WALL_Z_M
    top = CAMERA_HEIGHT_M - WALL_HEIGHT_M
    hit = (place[..., 1] > top) & (place[..., 1] < CAMERA_HEIGHT_M)
    from_line = np.abs(place[..., :2] / 0.25 - np.round(place[..., :2] / 0.25)) * 0.25
    line = (from_line < 0.011).any(axis=-1)
    tone = np.where(line[..., None], [0.05, 0.05, 0.06], [0.66, 0.64, 0.60])
    distance = np.full(hits.depth.shape, WALL_Z_M)
    hits.offer(hit, distance, np.array([0.0, 0.0, -1.0]), tone)


def _meet_ball(direction, ball, hits: _Hits, *, shines: bool = False) -> None:
    """A sphere of centre, radius and colour; a lamp when it shines."""
    t = _ball_distance(np.zeros(3), direction, ball)
    hit = np.isfinite(t)
    outward = (direction * np.where(hit, t, 0.0)[..., None] - ball[:3]) / ball[3]
    colour = ball[4:]
    albedo, glow = (BLACK, colour) if shines else (colour, BLACK)
    hits.offer(hit, t, outward, albedo, glow)


def _ball_distance(origin, direction, ball):
    """Ray parameter of the near side; infinite where missed."""
    to_centre = ball[:3] - origin
    a = (direction * direction).sum(axis=-1)
    b = (direction * to_centre).sum(axis=-1)
    c = (to_centre * to_centre).sum(axis=-1) - ball[3] ** 2
    square = b * b - a * c
    t = (b - np.sqrt(np.maximum(square, 0.0))) / a
    return np.where((square > 0) & (t > 1e-6), t, np.inf)


def _shadowed(place):
    """Whether a sphere stands between a point and the sun."""
    direction = np.broadcast_to(SUN, place.shape)
    dark = np.zeros(place.shape[:-1], bool)
    for ball in SPHERES:
        dark |= np.isfinite(_ball_distance(place, direction, _resting(ball)))
    return dark
