"""Detections in a photograph of a target: lattice indices and image positions.

An observation is one detection: a dot, a corner, a crossing, or one sample along the
centre of a line. Positions are pixels of the whole photograph with pixel
(column 0, row 0) covering [0, 1) x [0, 1), so that its centre is (0.5, 0.5); x runs
right along columns, y down along rows. Lattice coordinates count target pitches: i to
the right and j down on the target as photographed upright, origin arbitrary.

A line sample knows its place across the line only. It is kept in the same record: its
lattice coordinate across the line is the integer number of the line, the one along it
is approximate (interpolated), and `normal` is the unit vector across the line in the
image. A residual is then ``normal . (observed - predicted)``, to first order blind to
the coordinate along the line.
"""

from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Bool, Float, Int

from lensfit.detect.line_profile import MeasuredLines
from lensfit.detect.marker_board import MarkerBoard

CHANNELS = ("r", "g", "b")

POINT = -1
"""`family` of an observation known in both directions."""
LINE_OF_CONSTANT_I = 0
"""`family` of a sample on a line i = const (upright on an upright target)."""
LINE_OF_CONSTANT_J = 1
"""`family` of a sample on a line j = const."""


@dataclass(frozen=True, eq=False)
class Observations:
    """Every detection found on one photograph, in the channel that positions refer to.

    Positions in `points_px` are those of the green channel (or of the only channel).

    Attributes
    ----------
    lattice : Target coordinates in pitches; integers except along a line.
    points_px : Sub-pixel positions, pixels.
    covariance_px2 : Covariance of each position from the image noise, square pixels.
    family : `POINT`, `LINE_OF_CONSTANT_I` or `LINE_OF_CONSTANT_J`.
    normal : Unit vector across the line; NaN for a `POINT`.
    saturated : Touches clipped samples, so its shape and flux cannot be trusted.
    overlapping : Its blur touches a neighbour's, so the position may be biased.
    channel_points_px : The same detections measured in r, g, b; NaN where not measured
        (all NaN for a single-channel photograph).
    channel_covariance_px2 : Their covariances.
    flux : Background-subtracted, scene-linear sum over the detection per channel in
        channel units x square pixels; for a line sample the flux per pixel of length;
        for a detection on a bright field (dark dots, corners) the brightness of that
        field around it. NaN where not measured. One column for one channel.
    diameter_px : Diameter of the disc of the same second moment; NaN when meaningless.
    edge_blur_px : Of checker corners, standard deviation of the blur across the edges
        that cross there; of line samples that of the light across the line, which the
        line's own width is part of; None of other detections.
    lines : How lines were measured; None of other detections.
    markers : Of the board whose corners these are; None of other detections.
    bright : Detections are brighter than their surround; False for dark ones and
        corners.
    image_size_px : Width and height of the photograph.
    candidates : Number of detections that looked like the target's, indexed or not.
    notes : One sentence for each thing the person who photographed it should know.
    """

    lattice: Float[np.ndarray, "detections 2"]
    points_px: Float[np.ndarray, "detections 2"]
    covariance_px2: Float[np.ndarray, "detections 2 2"]
    family: Int[np.ndarray, " detections"]
    normal: Float[np.ndarray, "detections 2"]
    saturated: Bool[np.ndarray, " detections"]
    overlapping: Bool[np.ndarray, " detections"]
    channel_points_px: Float[np.ndarray, "3 detections 2"]
    channel_covariance_px2: Float[np.ndarray, "3 detections 2 2"]
    flux: Float[np.ndarray, "detections channels"]
    diameter_px: Float[np.ndarray, " detections"]
    image_size_px: tuple[int, int]
    candidates: int
    bright: bool = True
    edge_blur_px: Float[np.ndarray, " detections"] | None = None
    lines: MeasuredLines | None = None
    markers: MarkerBoard | None = None
    notes: tuple[str, ...] = field(default=())

    def __len__(self) -> int:
        return len(self.points_px)

    @property
    def are_corners(self) -> bool:
        """Whether detections are corners where squares meet."""
        return self.are_edges and not self.are_lines

    @property
    def are_lines(self) -> bool:
        """Whether detections are samples along lines."""
        return self.lines is not None

    @property
    def are_edges(self) -> bool:
        """Whether detections are corners or lines, which are seen by their edges."""
        return self.edge_blur_px is not None

    @property
    def are_dark_dots(self) -> bool:
        """Whether detections are dots, darker than their surround."""
        return not (self.bright or self.are_edges)


def only(found: Observations, kept: Bool[np.ndarray, " detections"]) -> Observations:
    """The record of some of the detections."""
    blur = found.edge_blur_px
    return replace(
        found,
        lattice=found.lattice[kept],
        points_px=found.points_px[kept],
        covariance_px2=found.covariance_px2[kept],
        family=found.family[kept],
        normal=found.normal[kept],
        saturated=found.saturated[kept],
        overlapping=found.overlapping[kept],
        channel_points_px=found.channel_points_px[:, kept],
        channel_covariance_px2=found.channel_covariance_px2[:, kept],
        flux=found.flux[kept],
        diameter_px=found.diameter_px[kept],
        edge_blur_px=None if blur is None else blur[kept],
    )
