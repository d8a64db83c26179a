"""A lens of third order drawn by throwing rays at pixels, in numpy alone.

Random rays through the opening, each boundary tried by itself, land where the closed
forms of Seidel's aberrations and a cone of exact tangents say, and are counted in
cells. No line is shared with the fit: what is true is stated here and nowhere else.

Holes are Gaussians here: `test_dot_aperture` has discs.

Also the layout and the arrays of a fit of such a lens, small enough for tests.
"""

from collections.abc import Callable
from dataclasses import dataclass
from types import SimpleNamespace

import jax
import jax.numpy as jnp
import numpy as np

from lensfit.detect.dot_images import CELLS
from lensfit.fitting.chart_view import ORDINARY_WIDTHS
from lensfit.fitting.wavefront.dot_arrays import Broad, Dots, FocusRange
from lensfit.fitting.wavefront.dot_data import DotData, FocusGroup
from lensfit.fitting.wavefront.parameters import Layout, Scale
from lensfit.fitting.wavefront.shapes import Colour
from lensfit.fitting.wavefront.waves import Transfer, transfers_of
from lensfit.optics.paraxial import FirstOrder
from lensfit.optics.spectrum import REFERENCE_NM
from lensfit.optics.terms import decentring_terms, rotational_terms

LAYOUT = Layout(rotational_terms(3) + decentring_terms(), (), groups=3, stops=1, rims=2)
"""Shared by all tests, so that one program serves them."""
FIELD_RADIUS_MM = 20.0
SINE = 0.24
PRINCIPAL_MM = 50.0
REFERENCE_MM = 2000.0
HOLE_VARIANCE_MM2 = 0.003**2
F_NUMBERS = (2.0, 4.0)
GREY = Colour(*(jnp.zeros(shape) for shape in ((1,), (1, 2)) * 2))
"""One wavelength, the same for all channels."""
SCALE = Scale(
    jnp.asarray(FIELD_RADIUS_MM), jnp.asarray(SINE), jnp.asarray(PRINCIPAL_MM)
)
PLACES_MM = np.array(
    [[0.5, -0.3], [6.0, 4.0], [-9.0, 6.0], [-5.0, -14.0], [13.0, -9.0], [11.0, 15.0]]
)
OPEN_RIMS = ((0.0, 3.0), (0.0, 3.0))


@dataclass(frozen=True)
class Seidel:
    """The truth.

    Attributes
    ----------
    curvature_um ... spherical_um : Coefficients of the terms of third order.
    constant_coma_um : Along x: what a decentred element adds.
    defocus_mm : Of every group.
    rims : Shift and radius of each.
    blades, rotation_rad : Straight ones, where the iris is stopped down.
    """

    curvature_um: float = 0.0
    astigmatism_um: float = 0.0
    coma_um: float = 0.0
    spherical_um: float = 0.0
    constant_coma_um: float = 0.0
    defocus_mm: tuple[float, ...] = (0.3,)
    rims: tuple[tuple[float, float], ...] = OPEN_RIMS
    blades: int = 0
    rotation_rad: float = 0.0

    def opening(self, h, stop_radius: float, rays: int, rng) -> np.ndarray:
        """Rays that pass stop and rims, u (rays, 2)."""
        found, count = [], 0
        while count < rays:
            s = rng.uniform(-1.3, 1.3, (2 * rays, 2)) * stop_radius
            clear = self._in_stop(s / stop_radius)
            for shift, radius in self.rims:
                clear &= np.hypot(*(s - shift * h).T) < radius
            found.append(s[clear])
            count += clear.sum()
        return np.concatenate(found)[:rays]

    def _in_stop(self, s: np.ndarray) -> np.ndarray:
        if not self.blades:
            return np.hypot(*s.T) < 1
        sector = 2 * np.pi / self.blades
        apothem = np.sqrt(np.pi / (self.blades * np.tan(sector / 2)))
        turn = self.rotation_rad + sector * (np.arange(self.blades) + 0.5)
        return (s @ np.stack([np.cos(turn), np.sin(turn)]) < apothem).all(-1)

    def landing_mm(self, u: np.ndarray, field_mm: np.ndarray, group: int) -> np.ndarray:
        """Of rays u from where the chief ray lands."""
        h = field_mm / FIELD_RADIUS_MM
        square = np.sum(u**2, -1, keepdims=True)
        turned = (h[0] + 1j * h[1]) ** 2 * (u[:, 0] - 1j * u[:, 1])
        astigmatism = np.stack([turned.real, turned.imag], -1)
        coma = square * h + 2 * u * (u @ h)[:, None]
        constant = square * [1.0, 0.0] + 2 * u * u[:, :1]
        landed = (
            self.curvature_um * (2 * h @ h - 1) * np.sqrt(2) * u
            + self.astigmatism_um * np.sqrt(2) * astigmatism
            + self.coma_um * np.sqrt(1.5) * coma
            + self.constant_coma_um * np.sqrt(1.5) * constant
            + self.spherical_um * (6 * square - 4) * u
        )
        chief = field_mm / np.sqrt(field_mm @ field_mm + PRINCIPAL_MM**2)
        cone = _tangent(u * SINE + chief) - _tangent(chief[None])
        return landed * 1e-3 + self.defocus_mm[group] * cone

    def parameters(self) -> np.ndarray:
        """The same numbers in the fit's order."""
        found = np.zeros(LAYOUT.size)
        blocks = LAYOUT.blocks
        for term, um in zip(LAYOUT.terms, self._coefficients(), strict=True):
            found[blocks["coefficients"]][LAYOUT.terms.index(term)] = um
        found[blocks["defocus"]][: len(self.defocus_mm)] = self.defocus_mm
        found[blocks["rim_shift"]] = [n for a, _ in self.rims for n in (a, 0.0)]
        found[blocks["rim_radius"]] = [n for _, r in self.rims for n in (r, 0.0)]
        found[blocks["iris"]] = [0.0, self.rotation_rad, 0.0]
        return found

    def _coefficients(self) -> list[float]:
        named = {
            "field curvature 3": self.curvature_um,
            "astigmatism 3": self.astigmatism_um,
            "coma 3": self.coma_um,
            "spherical 3": self.spherical_um,
        }
        constant = decentring_terms()[2]
        return [
            self.constant_coma_um if t == constant else named.get(t.family, 0.0)
            for t in LAYOUT.terms
        ]


def _tangent(p: np.ndarray) -> np.ndarray:
    return p / np.sqrt(1 - np.sum(p**2, -1, keepdims=True))


@dataclass(frozen=True)
class Shot:
    """One photograph: which defocus, which f-number, and what was said of it."""

    group: int
    stop: int
    focus_mm: float | None = None


def dots_at(places_mm: np.ndarray, group: int, stop: int, cell_mm: float) -> Dots:
    """Dots of a chart at the reference distance, one wavelength, in one photograph."""
    count = len(places_mm)
    return Dots(
        field_mm=np.asarray(places_mm, float),
        principal_distance_ratio=np.ones(count),
        focus=np.zeros(count),
        group=np.full(count, group),
        stop=np.full(count, stop),
        stop_radius=np.full(count, F_NUMBERS[0] / F_NUMBERS[stop]),
        blades=np.zeros(count),
        slope=np.asarray(places_mm, float) / PRINCIPAL_MM,
        pupil_per_sine_mm=np.tile(PRINCIPAL_MM * np.eye(2), (count, 1, 1)),
        vergence=np.full(count, 1 / (REFERENCE_MM - PRINCIPAL_MM)),
        reference=np.full(count, 1 / (REFERENCE_MM - PRINCIPAL_MM)),
        lateral_mm=np.zeros((count, 3, 1, 2)),
        sampled_ellipse_mm=np.zeros((count, 2, 2)),
        variance_mm2=np.full((count, 2), HOLE_VARIANCE_MM2),
        cell_mm=np.full((count, 2), cell_mm),
    )


def broad_target(
    broad: Broad, field_mm: np.ndarray, cell_mm: float
) -> tuple[Dots, Transfer, jax.Array, Layout, Scale]:
    """One target that is drawn in waves, in three channels of two wavelengths, as a
    function of one has it."""
    dots = dots_at(field_mm[None], 0, 0, cell_mm)._replace(
        broad=broad,
        lateral_mm=np.zeros((1, 3, 2, 2)),
        sampled_ellipse_mm=np.zeros((1, 2, 2)),
        variance_mm2=np.full((1, 2), 1e-6),
    )
    transfer = transfers_of(broad, dots.cell_mm, CELLS, [None] * len(dots.cell_mm))
    dot, transfer = jax.tree.map(lambda a: jnp.asarray(a[0]), (dots, transfer))
    return dot, transfer, jnp.zeros((3, 2)), LAYOUT, SCALE


def photographed(
    lens: Seidel,
    shots: list[Shot],
    *,
    noise: float = 0.02,
    rays: int = 60_000,
    places_mm: np.ndarray = PLACES_MM,
    seed: int = 0,
) -> DotData:
    """Every dot of every shot, in grey, with noise as a share of its peak.

    Each has its own brightness and background, and lies anywhere within its cells.
    """
    rng = np.random.default_rng(seed)
    rows, light, centroid, diameter, spread = [], [], [], [], []
    for shot in shots:
        radius = F_NUMBERS[0] / F_NUMBERS[shot.stop]
        cone = abs(lens.defocus_mm[shot.group]) * SINE * radius
        cell = max(3.4 * cone / CELLS, 0.006)
        rows.append(dots_at(places_mm, shot.group, shot.stop, cell))
        for place in places_mm:
            u = lens.opening(place / FIELD_RADIUS_MM, radius, rays, rng)
            x = lens.landing_mm(u, place, shot.group)
            x = x + rng.normal(0, HOLE_VARIANCE_MM2**0.5, x.shape)
            corner = x.mean(0) - cell * (CELLS / 2 + rng.uniform(-0.5, 0.5, 2))
            counts = cell_counts(x, corner, cell, CELLS)
            one = counts / rays * rng.uniform(5.0, 15.0)
            spread.append(noise * one.max())
            grain = rng.normal(0, 1, one.shape) * spread[-1]
            light.append(one + rng.uniform(0, 0.02) + grain)
            centroid.append(x.mean(0) - corner)
            diameter.append(4 * np.sqrt(x.var(0).sum() / 2))
    return _dot_data(shots, rows, *map(np.array, (light, centroid, diameter, spread)))


def cell_counts(
    landed_mm: np.ndarray, corner_mm: np.ndarray, cell_mm: float, cells: int
) -> np.ndarray:
    """Rays that land in each cell of a square patch, x along columns."""
    column, row = np.floor((landed_mm - corner_mm) / cell_mm).astype(int).T
    inside = (column >= 0) & (column < cells) & (row >= 0) & (row < cells)
    each = np.bincount(row[inside] * cells + column[inside], minlength=cells**2)
    return each.reshape(cells, cells).astype(float)


def _dot_data(shots, rows, light, centroid, diameter, spread) -> DotData:
    count = len(light)
    groups: dict[int, FocusGroup] = {}
    for shot in shots:
        name = "" if shot.focus_mm else f"group {shot.group}"
        groups[shot.group] = FocusGroup(shot.focus_mm, REFERENCE_MM, name)
    valid = np.zeros((count, 3, CELLS, CELLS), bool)
    valid[:, 1] = True
    focal = 1 / (1 / PRINCIPAL_MM + 1 / (REFERENCE_MM - PRINCIPAL_MM))
    each = len(rows[0].group)
    return DotData(
        photographs=tuple(
            SimpleNamespace(
                take=SimpleNamespace(
                    widths=ORDINARY_WIDTHS, f_number=F_NUMBERS[shot.stop]
                )
            )
            for shot in shots
        ),
        dots=jax.tree.map(lambda *parts: np.concatenate(parts), *rows),
        light=np.repeat(light[:, None], 3, 1),
        valid=valid,
        clipped=np.zeros_like(valid),
        observed_mm=np.repeat(centroid[:, None], 3, 1),
        diameter_mm=diameter,
        read_noise=np.repeat(spread[:, None], 3, 1),
        take=np.repeat(np.arange(len(shots)), each),
        colour=False,
        scale=SCALE,
        wavelengths_nm=np.full((3, 1), REFERENCE_NM),
        groups=tuple(groups[k] for k in sorted(groups)),
        f_numbers=F_NUMBERS[: 1 + max(shot.stop for shot in shots)],
        reference_distance_mm=REFERENCE_MM,
        focus=FocusRange(0.0, 0.0),
        first_order=FirstOrder(
            jnp.asarray(focal), jnp.asarray(1.0), jnp.asarray(PRINCIPAL_MM)
        ),
    )


def assert_slopes_are_differences(
    slopes_mm: jax.Array,
    offsets_mm: Callable[[jax.Array], jax.Array],
    parameters: jax.Array,
) -> None:
    """Slopes of offsets by the parameters are central differences of these.

    Parameters
    ----------
    slopes_mm : At the parameters; last axis: parameters.
    """
    for name, step in {"coefficients": 0.1, "defocus": 1e-4}.items():
        where = LAYOUT.blocks[name]
        moves = jnp.eye(LAYOUT.size)[where] * step
        ends = [[offsets_mm(parameters + way * m) for m in moves] for way in (1, -1)]
        wanted = np.moveaxis(np.subtract(*ends), 0, -1) / (2 * step)
        largest = np.abs(wanted).max()
        np.testing.assert_allclose(slopes_mm[:, where], wanted, atol=0.08 * largest)
