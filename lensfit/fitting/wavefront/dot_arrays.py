"""Every dot of the wavefront fit as arrays: where it is, its focus, and its pixels.

One row per dot, three channels each. A patch is a square of cells; a cell is a square
of pixels, more than one where the blur is large, so that patches of all photographs
have one shape and one compiled program serves them all.

Where elements move against each other as the lens is focused, aberrations change with
the focus distance d, to first order in proportion to its vergence 1/d. The focus
coordinate is 0 at the reference state, positive nearer, and at most 1 away from it at
the photographed distances; distances are millimetres from the sensor, as on the barrel.
"""

from collections.abc import Iterable
from typing import Any, Literal, NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from lensfit.optics.depth import Sections


class FocusRange(NamedTuple):
    """The photographed focus distances.

    Attributes
    ----------
    reference_per_mm : Vergence of the reference.
    span_per_mm : Largest difference from it; 0 where one distance is all there is, or
        none is stated.
    """

    reference_per_mm: float
    span_per_mm: float

    @classmethod
    def of(
        cls, reference_mm: float | None, distances_mm: Iterable[float | None]
    ) -> "FocusRange":
        """The range of stated distances about one of them."""
        if not reference_mm:
            return cls(0.0, 0.0)
        away = [abs(1 / d - 1 / reference_mm) for d in distances_mm if d]
        return cls(1 / reference_mm, max(away, default=0.0))

    def coordinate(self, distance_mm: float | None) -> float:
        """Of a focus distance, of one beyond the photographed ones theirs; 0 of one
        that nobody stated."""
        if not distance_mm or not self.span_per_mm:
            return 0.0
        away_per_mm = 1 / distance_mm - self.reference_per_mm
        return min(max(away_per_mm / self.span_per_mm, -1.0), 1.0)


BroadKind = Literal["disc", "corner", "line"]
"""What a broad target is drawn as."""
NEIGHBOURS = 8
"""Of a dot in a grid."""
Numbers = Any
"""NumPy's arrays while dots are gathered and chosen, JAX's in the fit."""


class DetectionAperture(NamedTuple):
    """The aperture through which detection measures where a broad dot is
    (`detected_point`).

    Attributes
    ----------
    to_edge : From the unit disc to the edge of the aperture, cells.
    ring, core : Outer edge of the ring from which the background is estimated, and
        of the core from which the dot's own level is, in apertures.
    smoothing : Standard deviation, cells, by which the picture of a dark dot is
        smoothed; 0 of a bright one.
    """

    to_edge: Float[Numbers, "dots 2 2"]
    ring: Float[Numbers, " dots"]
    core: Float[Numbers, " dots"]
    smoothing: Float[Numbers, " dots"]


class Broad(NamedTuple):
    """Targets too wide to be sampled by rays, which are drawn in waves (`waves`): dots
    as discs, of large ones a part of the rim, checker corners as the squares that meet
    there, line samples as the lines around.

    Attributes
    ----------
    disc_mm : From the unit disc to the image of each; zero of corners. Of a line one of
        the same second moment as its width.
    rim_mm : From the rim that is shown to the middle of its dot; zero of others.
    neighbour_offsets_mm : From each to those around it; NaN where there are fewer, and
        of corners and lines.
    square_mm : Sides of the square that is bright ahead of a corner, or from line to
        line, in columns; zero of dots.
    bend_mm : Second derivatives of the image by these sides, of rims by the radii that
        `disc_mm` is of, the image's place on the first axis; zero of whole dots.
    window_cells, window_squares : Half width of detection's window about a corner, at
        most, in cells and in squares; 0 of others.
    lattice : Place of a corner or a line sample in pitches; 0 of others.
    line_width : Width of lines in pitches along both axes, negative of dark ones; 0 of
        others.
    line_window_mm : Of what detection reads across a line in each channel: half the
        width that counts in full, how far it fades, and the flank beyond; 0 of others.
    size_width : Standard deviation of the share by which dots, bright squares or lines
        may be larger.
    aperture : Of detection; of corners and lines it means nothing.
    """

    disc_mm: Float[Numbers, "dots 2 2"]
    rim_mm: Float[Numbers, "dots 2"]
    neighbour_offsets_mm: Float[Numbers, "dots neighbours 2"]
    square_mm: Float[Numbers, "dots 2 2"]
    bend_mm: Float[Numbers, "dots 2 2 2"]
    window_cells: Float[Numbers, " dots"]
    window_squares: Float[Numbers, " dots"]
    lattice: Float[Numbers, "dots 2"]
    line_width: Float[Numbers, "dots 2"]
    line_window_mm: Float[Numbers, "dots 3 3"]
    size_width: Float[Numbers, " dots"]
    aperture: DetectionAperture


class Dots(NamedTuple):
    """What is known of the dots before the fit.

    Attributes
    ----------
    field_mm : Where the chief ray lands, from the principal point.
    principal_distance_ratio : Principal distance of the dot's state over the reference
        state's.
    focus : Focus coordinate of the dot's state (`FocusRange`).
    group : Which defocus.
    stop : Which f-number; 0 is the widest.
    stop_radius : Nominal, in radii of the widest stop.
    blades : Of the iris; 0 where it is wide open.
    slope, pupil_per_sine_mm, vergence, reference : The chart's distance at this dot
        (`optics.depth.ObjectShift`).
    lateral_mm : Displacement of the wavelengths of each channel about their mean.
    sampled_ellipse_mm : From the unit disc to the ellipse that rays start from
        (`dot_aperture`).
    variance_mm2 : Along x and y, of the Gaussian that stands for the rest of the dot
        aperture, and for the Airy pattern.
    cell_mm : Width and height of a cell.
    sections : Of an anamorphic lens, for a chart at this dot; None for others.
    broad : Of dots that are drawn as discs; None where rays sample the dot aperture.
    """

    field_mm: Float[Numbers, "dots 2"]
    principal_distance_ratio: Float[Numbers, " dots"]
    focus: Float[Numbers, " dots"]
    group: Int[Numbers, " dots"]
    stop: Int[Numbers, " dots"]
    stop_radius: Float[Numbers, " dots"]
    blades: Float[Numbers, " dots"]
    slope: Float[Numbers, "dots 2"]
    pupil_per_sine_mm: Float[Numbers, "dots 2 2"]
    vergence: Float[Numbers, " dots"]
    reference: Float[Numbers, " dots"]
    lateral_mm: Float[Numbers, "dots 3 wavelengths 2"]
    sampled_ellipse_mm: Float[Numbers, "dots 2 2"]
    variance_mm2: Float[Numbers, "dots 2"]
    cell_mm: Float[Numbers, "dots 2"]
    sections: Sections | None = None
    broad: Broad | None = None


def undrawn(count: int) -> Broad:
    """Targets without discs, squares or lines, to be given what they have."""
    return Broad(
        disc_mm=np.zeros((count, 2, 2)),
        rim_mm=np.zeros((count, 2)),
        neighbour_offsets_mm=np.full((count, NEIGHBOURS, 2), np.nan),
        square_mm=np.zeros((count, 2, 2)),
        bend_mm=np.zeros((count, 2, 2, 2)),
        window_cells=np.zeros(count),
        window_squares=np.zeros(count),
        lattice=np.zeros((count, 2)),
        line_width=np.zeros((count, 2)),
        line_window_mm=np.zeros((count, 3, 3)),
        size_width=np.zeros(count),
        aperture=DetectionAperture(
            np.tile(np.eye(2), (count, 1, 1)), *np.ones((3, count))
        ),
    )


def are_corners(broad: Broad) -> Bool[np.ndarray, " dots"]:
    """Which targets are checker corners."""
    return np.asarray(broad.window_cells) > 0


def are_lines(broad: Broad) -> Bool[np.ndarray, " dots"]:
    """Which targets are line samples."""
    return np.any(np.asarray(broad.line_width) != 0, -1)


def rows_of_kinds(broad: Broad) -> dict[BroadKind, Int[np.ndarray, " some"]]:
    """Which targets are of each kind; without kinds that there are none of."""
    corners, lines = are_corners(broad), are_lines(broad)
    found: dict[BroadKind, np.ndarray] = {
        "disc": ~(corners | lines),
        "corner": corners,
        "line": lines,
    }
    return {kind: np.flatnonzero(mine) for kind, mine in found.items() if mine.any()}


def are_rims(broad: Broad) -> Bool[np.ndarray, " dots"]:
    """Which show a part of the rim of a large dot."""
    return np.any(np.asarray(broad.rim_mm) != 0, -1)


def show_edges(dots: Dots) -> Bool[np.ndarray, " dots"]:
    """Which are corners, rims or lines."""
    if dots.broad is None:
        return np.zeros(len(dots.field_mm), bool)
    return are_corners(dots.broad) | are_rims(dots.broad) | are_lines(dots.broad)


def dot_aperture_variance_mm2(dots: Dots) -> Float[Numbers, " dots"]:
    """Second moment of every dot's aperture and Airy pattern, mean of x and y."""
    disc_mm = dots.sampled_ellipse_mm if dots.broad is None else dots.broad.disc_mm
    return (dots.variance_mm2 + np.sum(disc_mm**2, -1) / 4).mean(-1)


class Pixels(NamedTuple):
    """What was photographed, and its weights.

    Attributes
    ----------
    light : Mean of the pixels of each cell, scene-linear.
    weight : Inverse variance; 0 where a cell is masked, saturated or outside.
    corner_mm : Corner of cell (0, 0) minus where the chief ray is thought to land.
    fold : Two for each take, for model selection (`normal.Equations`).
    """

    light: Float[Numbers, "dots 3 rows columns"]
    weight: Float[Numbers, "dots 3 rows columns"]
    corner_mm: Float[Numbers, "dots 3 2"]
    fold: Int[Numbers, " dots"]
