"""A scene: plane layers with outlines, colours and small lamps.

Scene coordinates as in `data_synth.scene`. A layer is one plane, square to the axis or
not: depth may vary inside it. Nearer layers cover farther ones along each ray.
"""

from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Bool, Float

from data_synth.scene.paints import Paint
from data_synth.scene.shapes import Discs, Shape

NEVER_MM = np.inf
"""Depth of a plane that a ray does not meet in front of the lens."""


@dataclass(frozen=True, eq=False)
class SceneRays:
    """Rays on the scene's side of a lens.

    Attributes
    ----------
    pupil_mm : Where they cross the entrance-pupil plane.
    slope : dx/ddepth and dy/ddepth.
    """

    pupil_mm: Float[np.ndarray, "rays 2"]
    slope: Float[np.ndarray, "rays 2"]

    def __len__(self) -> int:
        return len(self.slope)

    def some(self, which) -> "SceneRays":
        """Those of the given numbers."""
        return SceneRays(self.pupil_mm[which], self.slope[which])


@dataclass(frozen=True, eq=False)
class Plane:
    """A plane by a point and two perpendicular axes of unit length.

    Attributes
    ----------
    origin_mm : Scene coordinates of plane coordinates (0, 0).
    right, down : Directions of the plane's axes.
    """

    origin_mm: Float[np.ndarray, "3"]
    right: Float[np.ndarray, "3"]
    down: Float[np.ndarray, "3"]

    @property
    def normal(self) -> Float[np.ndarray, "3"]:
        """Unit vector perpendicular to it."""
        return np.cross(self.right, self.down)

    @property
    def is_square(self) -> bool:
        """Whether it is perpendicular to the axis."""
        return bool(self.right[2] == 0.0 and self.down[2] == 0.0)

    def depth_mm(self, rays: SceneRays) -> Float[np.ndarray, " rays"]:
        """Depth at which each ray meets it; infinite where it does not."""
        x, y, z = self.normal
        offset = self.normal @ self.origin_mm
        if self.is_square:
            return np.full(len(rays), self.origin_mm[2])
        with np.errstate(divide="ignore", invalid="ignore"):
            depth = (offset - rays.pupil_mm @ np.array([x, y])) / (
                rays.slope @ np.array([x, y]) + z
            )
        return np.where(depth > 0, depth, NEVER_MM)

    def place_mm(
        self, rays: SceneRays, depth_mm: Float[np.ndarray, " rays"]
    ) -> Float[np.ndarray, "rays 2"]:
        """Plane coordinates of where rays meet it."""
        across = rays.pupil_mm + rays.slope * depth_mm[:, None] - self.origin_mm[:2]
        behind = depth_mm - self.origin_mm[2]
        axes = np.stack([self.right, self.down], 1)
        return across @ axes[:2] + behind[:, None] * axes[2]

    def scene_mm(
        self, place_mm: Float[np.ndarray, "points 2"]
    ) -> Float[np.ndarray, "points 3"]:
        """Scene coordinates of points of the plane."""
        return self.origin_mm + place_mm @ np.stack([self.right, self.down])


def square_plane(depth_mm: float) -> Plane:
    """The plane perpendicular to the axis at a depth; its coordinates are x and y."""
    return Plane(
        np.array([0.0, 0.0, depth_mm]),
        np.array([1.0, 0.0, 0.0]),
        np.array([0.0, 1.0, 0.0]),
    )


def floor_plane(height_mm: float, depth_mm: float) -> Plane:
    """The level plane this far below the axis.

    Its coordinates are x, and from the given depth towards the camera.
    """
    return Plane(
        np.array([0.0, height_mm, depth_mm]),
        np.array([1.0, 0.0, 0.0]),
        np.array([0.0, 0.0, -1.0]),
    )


def wall_plane(origin_mm: tuple[float, float, float], turn_rad: float) -> Plane:
    """An upright plane through a point, turned about the vertical.

    A positive turn makes its right side recede. Its coordinates: to the right along it,
    and y.
    """
    return Plane(
        np.array(origin_mm),
        np.array([np.cos(turn_rad), 0.0, np.sin(turn_rad)]),
        np.array([0.0, 1.0, 0.0]),
    )


@dataclass(frozen=True, eq=False)
class Lamps:
    """Small bright opaque discs in the plane of a layer; evenly bright (Lambertian).

    Attributes
    ----------
    centre_mm, radius_mm : Plane coordinates.
    radiance : r, g, b of each.
    """

    centre_mm: Float[np.ndarray, "lamps 2"]
    radius_mm: Float[np.ndarray, " lamps"]
    radiance: Float[np.ndarray, "lamps 3"]

    def __len__(self) -> int:
        return len(self.radius_mm)


@dataclass(frozen=True, eq=False)
class Layer:
    """One plane of a scene.

    Attributes
    ----------
    name : For people.
    plane, shape, paint : Where it is, which of it is there, what it looks like.
    opacity : Coverage of the shape's points: 1 hides what is behind, less is a veil.
    lamps : Discs that shine; None when it has none.
    """

    name: str
    plane: Plane
    shape: Shape
    paint: Paint
    opacity: float = 1.0
    lamps: Lamps | None = None
    _discs: Discs | None = field(init=False, default=None)

    def __post_init__(self):
        if self.lamps is not None:
            discs = Discs(self.lamps.centre_mm, self.lamps.radius_mm)
            object.__setattr__(self, "_discs", discs)

    def coverage(
        self, place_mm: Float[np.ndarray, "points 2"]
    ) -> Float[np.ndarray, " points"]:
        """Share of what lies behind that each point hides."""
        covered = self.opacity * self.shape.contains(place_mm)
        return np.where(self._on_lamp(place_mm), 1.0, covered)

    def radiance(
        self, place_mm: Float[np.ndarray, "points 2"], *, lamps_lit: bool
    ) -> Float[np.ndarray, "points 3"]:
        """Radiance of covered points; that of a lamp is 0 unless lit."""
        radiance = self.paint.radiance(place_mm)
        if self._discs is None or self.lamps is None:
            return radiance
        number = self._discs.piece_at(place_mm)
        lamp = number >= 0
        radiance[lamp] = self.lamps.radiance[number[lamp]] if lamps_lit else 0.0
        return radiance

    def _on_lamp(self, place_mm) -> Bool[np.ndarray, " points"]:
        if self._discs is None:
            return np.zeros(len(place_mm), bool)
        return self._discs.contains(place_mm)


@dataclass(frozen=True, eq=False)
class Scene:
    """Layers of any order; what no layer covers is black and infinitely far."""

    layers: tuple[Layer, ...]
