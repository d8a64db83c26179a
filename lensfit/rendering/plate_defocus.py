"""A lens prepared to blur a plate: its rays, and the density that a tolerance needs.

Rays are made once for a window and a range of depth, and kept while the camera stays.
"""

import math
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from jaxtyping import Float32

from lensfit.coords import Window
from lensfit.errors import LensfitError
from lensfit.rendering import light_mesh, ray_field
from lensfit.rendering.circle import Circle
from lensfit.rendering.light_mesh import LightField, disc_lights, lens_lights
from lensfit.rendering.ray_field import (
    DepthNodes,
    RayField,
    disc_field,
    lens_field,
    with_grey,
)
from lensfit.rendering.surfaces import Slabs
from lensfit.rendering.uv import PlateGeometry

if TYPE_CHECKING:
    from lensfit.lens import Lens

FEW_RAYS = 18
_WIDEST_PX, _FARTHEST_PX = 1000.0, 1e5
_STEPS_PER_OCTAVE = 4
"""Ranges of depth are rounded outward to these, so that frames share rays."""
_LEAST_RANGE_PX = 0.25
_UNSEEN_PX = 0.15
_WAVELENGTH_MM = 5.5e-4
_AIRY_SIGMA = 0.42


class Grids(NamedTuple):
    """How densely rays are computed over a window; between nodes they are interpolated.

    Attributes
    ----------
    rays, lights : Columns and rows of nodes, for rays and for meshes of lights.
    rings : Of those meshes.
    """

    rays: tuple[int, int]
    lights: tuple[int, int]
    rings: int

    @classmethod
    def of(cls, tolerance: float, window: Window) -> "Grids":
        """For an accepted error over a window. Half as dense, rays are four times less
        known, in parts of the frame: a small frame of a coarse tolerance, such as the
        first look of a view, shows none of it."""
        is_small = max(window.width, window.height) <= _SMALL_PX
        return _SPARSE if is_small and tolerance >= _COARSE else _DENSE


_DENSE = Grids(
    (ray_field.COLUMNS, ray_field.ROWS),
    (light_mesh.COLUMNS, light_mesh.ROWS),
    light_mesh.RINGS,
)
_SPARSE = Grids((11, 7), (5, 4), light_mesh.RINGS // 2)
_SMALL_PX, _COARSE = 600, 0.01


class DefocusBudget(NamedTuple):
    """What a tolerance on the picture allows each approximation of the blur.

    Attributes
    ----------
    rays : Of each pixel where something is out of focus; a multiple of three.
    slabs : How thick slabs of depth may be.
    unseen_px : Displacement that is not seen.
    light_step_px : Resolution of the radius of highlights.
    cubic_px : Blur of a smaller radius is read by a cubic: to read linearly adds a
        variance of a sixth of a square pixel.
    few_px : Spots up to this radius need few rays.
    """

    rays: int
    slabs: Slabs
    unseen_px: float
    light_step_px: float
    cubic_px: float
    few_px: float

    @classmethod
    def of(cls, tolerance: float, depth_levels: int | None = None) -> "DefocusBudget":
        """Shares of an accepted rms error of the picture, display-referred."""
        # The error of n rays falls as n^(-3/2): measured, `lensfit bench render`.
        rays = 3 * round(16 * (0.003 / tolerance) ** (2 / 3))
        finer = float(np.clip((tolerance / 0.003) ** 0.5, 0.3, 2.5))
        return cls(
            rays=int(np.clip(rays, FEW_RAYS, 1536)),
            slabs=Slabs(1.0 * finer, 0.25 * finer),
            unseen_px=10 * tolerance,
            light_step_px=float(np.clip(50 * tolerance, 0.02, 0.1)),
            few_px=float(np.clip(2.0 * (tolerance / 0.003) ** 0.5, 0.3, 4.0)),
            cubic_px=float(np.clip(2.0 * (0.003 / tolerance) ** 0.5, 1.0, 8.0)),
        )


@dataclass(eq=False)
class Defocus:
    """A lens on a plate, ready to blur it; keeps the rays it has made.

    Attributes
    ----------
    lens : At the camera state of the plate.
    geometry : How the plate lies on the sensor.
    tolerance : Accepted error of the picture, display-referred.
    depth_levels : Slabs that a plate's depth is cut into, evenly in blur; None leaves
        it to the tolerance.
    """

    lens: "Lens"
    geometry: PlateGeometry
    tolerance: float
    depth_levels: int | None = None
    _kept: dict = field(default_factory=dict)

    @cached_property
    def budget(self) -> DefocusBudget:
        return DefocusBudget.of(self.tolerance)

    @cached_property
    def circle(self) -> Circle:
        return Circle.of(self.lens, self.geometry)

    @cached_property
    def is_disc(self) -> bool:
        """Whether every point blurs into a plain disc, the same all over the frame.

        So it does, to some 3 % of `Lens.psf`, for a lens without measured blur, which
        counts as perfect (`lensfit.psf.lens_blur.perfect_blur`), where diffraction is
        much smaller than a pixel: in closed form, it costs no rays of the lens."""
        blur, f_number = self.lens.blur, self.lens.f_number
        if f_number is None or blur is not None:
            return False
        pitch_mm, height_mm = self.geometry.pitch_mm
        if not math.isclose(pitch_mm, height_mm, rel_tol=1e-6):
            return False
        return not _diffracts(f_number, pitch_mm)

    def slabs(self, least_px: float, most_px: float) -> Slabs:
        """How thick slabs of this range of blur may be."""
        if self.depth_levels is None:
            return self.budget.slabs
        return Slabs(max((most_px - least_px) / self.depth_levels, 0.01), 1e-6)

    def rays(self, window: Window, least_px: float, most_px: float) -> "Rays":
        """Rays over a window for a range of signed radii of blur.

        Raises
        ------
        LensfitError : Something blurs too widely; or as `Lens.perfect_blur`.
        """
        widest = max(abs(least_px), abs(most_px))
        if not widest <= _WIDEST_PX:
            raise LensfitError(
                f"blur reaches {widest:.0f} px, and {_WIDEST_PX:.0f} px is the most "
                "that is rendered",
                remedy="look at the unit and the nearest values of the depth, or limit "
                "the blur with --max-blur-px",
            )
        # Nothing lies beyond infinity.
        farthest = -self.circle.px_mm * self.circle.focus_vergence
        ends = max(_rounded_away(least_px), farthest), _rounded_away(most_px)
        key = window, *ends
        if key not in self._kept:
            if len(self._kept) > 4:
                self._kept.clear()
            self._kept[key] = Rays(self, window, DepthNodes.over(*ends))
        return self._kept[key]


@dataclass(eq=False)
class Rays:
    """Rays of a lens over a window and a range of depth, made on first use.

    Attributes
    ----------
    defocus : Whose.
    window : Pixels that they reach.
    depth : What they cross.
    """

    defocus: Defocus
    window: Window
    depth: DepthNodes

    @property
    def grids(self) -> Grids:
        """How densely they are computed."""
        return Grids.of(self.defocus.tolerance, self.window)

    @cached_property
    def many(self) -> RayField:
        """Where something is out of focus."""
        return self._fields[0]

    @cached_property
    def few(self) -> RayField:
        """Where nothing is far out of focus."""
        return self._fields[1]

    @cached_property
    @np.errstate(over="ignore", invalid="ignore")  # reach_px says it
    def _fields(self) -> tuple[RayField, RayField]:
        budget = self.defocus.budget
        counts = budget.rays, FEW_RAYS
        if self.defocus.is_disc:
            many, few = (disc_field(self.window, n) for n in counts)
            return many, few
        many, few = lens_field(
            self.defocus.lens,
            self.defocus.geometry,
            self.defocus.circle,
            self.window,
            self.depth,
            counts,
            self.grids.rays,
        )
        many = with_grey(many, budget.unseen_px)
        return many, few if len(many.weight) > 1 else with_grey(few, math.inf)

    @cached_property
    def lights(self) -> LightField:
        """Meshes of small bright lights."""
        defocus = self.defocus
        if defocus.is_disc:
            return disc_lights(self.window)
        return lens_lights(
            defocus.lens,
            defocus.geometry,
            defocus.circle,
            self.window,
            self.depth,
            self.grids.rings,
            self.grids.lights,
        )

    def reach_px(self, least_px: float, most_px: float) -> int:
        """How far rays are led, in whole pixels, over a range of radii of blur.

        Raises
        ------
        LensfitError : The lens leads them nowhere, or farther than any frame.
        """
        ends = least_px, 0.0, most_px
        found_px = [self.many.reach_px(r) for r in ends]
        if not all(reach <= _FARTHEST_PX for reach in found_px):  # nor is NaN
            raise LensfitError(
                f"at f/{self.defocus.lens.f_number:g} the fitted aberrations, "
                "continued beyond what was photographed, lead light to no place on "
                "the sensor",
                remedy="give a larger f-number, knobs that act less or, where overscan "
                "is kept, less of it",
            )
        return math.ceil(max(found_px)) + 4

    def is_sharp(self, radius_px: Float32[np.ndarray, "*shape"]) -> bool:
        """Whether no blur of these radii would be seen."""
        ends = float(radius_px.min()), float(radius_px.max())
        unseen = self.defocus.budget.unseen_px
        if max(abs(r) for r in ends) > unseen:
            return False
        return all(self.few.reach_px(r) <= unseen for r in ends)


def _rounded_away(radius_px: float) -> float:
    """At least as far from the focus, at one of a few radii."""
    if radius_px == 0:
        return 0.0
    size = max(abs(radius_px), _LEAST_RANGE_PX)
    steps = math.ceil(_STEPS_PER_OCTAVE * math.log2(size))
    return math.copysign(2 ** (steps / _STEPS_PER_OCTAVE), radius_px)


def _diffracts(f_number: float, pixel_pitch_mm: float) -> bool:
    """Whether diffraction widens the blur by what a pixel may show."""
    sigma_mm = _AIRY_SIGMA * _WAVELENGTH_MM * f_number
    return sigma_mm > _UNSEEN_PX * pixel_pitch_mm
