"""Where a lens puts the picture and how bright: its maps, and how well they are known.

Points are sensor millimetres, origin at the sensor centre, x right, y down. Object
points are millimetres, x right, y down, z the distance from the sensor plane.
"""

from collections.abc import Callable
from typing import Literal

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from lensfit.batches import in_batches
from lensfit.errors import LensfitError
from lensfit.optics.distortion import Distortion
from lensfit.optics.falloff import Illumination
from lensfit.optics.lateral import ChannelShift, LateralColour
from lensfit.optics.many_points import (
    displaced_back,
    displaced_positions_mm,
    distort,
    illuminate,
    lateral_deviations_mm,
    light_deviations,
    project,
    undistort,
)
from lensfit.optics.map_deviations import (
    MapCovariances,
    Perspective,
    frame_points_mm,
    object_deviations_mm,
    position_deviations_mm,
)
from lensfit.optics.projection import PupilShift

Channel = Literal["r", "g", "b"]
_CHANNELS = ("r", "g", "b")


class AbstractChiefRays(eqx.Module):
    """Chief rays and fall-off of a lens at one state; the lens itself (`lensfit.lens`)
    holds what they are computed from.

    Attributes
    ----------
    distortion : Chief-ray map of the green channel.
    lateral_colour : Displacement of red and of blue, or None when there is none.
    illumination : Fall-off, or None when it was not measured (then it is 1).
    entrance_pupil_offset_mm : Centre of projection in front of the sensor plane.
    sensor_size_mm : Width and height of the calibrated sensor area.
    pupil_shift : How the entrance pupil moves with field angle; None if unknown.
    covariances : How well these maps are known, where the state was photographed.
    """

    distortion: eqx.AbstractVar[Distortion]
    lateral_colour: eqx.AbstractVar[LateralColour]
    illumination: eqx.AbstractVar[Illumination | None]
    entrance_pupil_offset_mm: eqx.AbstractVar[Float[Array, ""]]
    sensor_size_mm: eqx.AbstractVar[tuple[float, float]]
    pupil_shift: eqx.AbstractVar[PupilShift | None]
    covariances: eqx.AbstractVar[MapCovariances]

    @property
    def has_lateral_colour(self) -> bool:
        """Whether red or blue land elsewhere than green."""
        return self.lateral_colour is not None

    def project(
        self, object_points_mm: Float[ArrayLike, "points 3"], channel: Channel = "g"
    ) -> Float[Array, "points 2"]:
        """Sensor mm where the chief rays of object points land.

        Parameters
        ----------
        object_points_mm : x right, y down, z distance from the sensor plane.
        channel : "r", "g" or "b".

        Raises
        ------
        ValueError : Unknown channel, or points of the wrong shape.
        """
        points = points_of(object_points_mm, 3)
        pupil = self.entrance_pupil_offset_mm
        landed = project(points, pupil, self.distortion, self.pupil_shift)
        return displaced_positions_mm(landed, self.distortion, self._shift(channel))

    def distorted_from_undistorted(
        self, points_mm: Float[ArrayLike, "points 2"], channel: Channel = "g"
    ) -> Float[Array, "points 2"]:
        """Where points of the undistorted picture land on the photograph."""
        points = points_of(points_mm, 2)
        landed = distort(points, self.distortion)
        return displaced_positions_mm(landed, self.distortion, self._shift(channel))

    def undistorted_from_distorted(
        self, points_mm: Float[ArrayLike, "points 2"], channel: Channel = "g"
    ) -> Float[Array, "points 2"]:
        """Inverse of `distorted_from_undistorted`, to rounding.

        NaN where no undistorted point exists (90 degrees off axis and beyond).
        """
        points = points_of(points_mm, 2)
        green = displaced_back(points, self.distortion, self._shift(channel))
        return undistort(green, self.distortion)

    def relative_illumination(
        self, points_mm: Float[ArrayLike, "points 2"], channel: Channel = "g"
    ) -> Float[Array, " points"]:
        """Brightness at points of the photograph, in (0, 1], 1 on the axis."""
        points = points_of(points_mm, 2)
        index = channel_index(channel)
        if self.illumination is None:
            return jnp.ones(points.shape[0])
        return illuminate(
            points,
            self.distortion.principal_point_mm,
            self.illumination.valid_radius_mm,
            self.illumination.control[index],
        )

    def position_standard_deviation_mm(
        self, points_mm: Float[ArrayLike, "points 2"], channel: Channel = "g"
    ) -> Float[np.ndarray, "points 2"]:
        """How well `distorted_from_undistorted` is known: one standard deviation along
        x and along y on the sensor.

        What another pose of the camera would do as well is no error of the lens and is
        left out: from each parameter's effect the homography of the undistorted picture
        that best undoes it over the frame is subtracted. The `uncertainty_grid` of the
        report is the root of both squares, at the undistorted points of a grid on the
        photograph. Noise of the photographs, doubt about the blur and what the terms of
        the model usually miss are in it; beyond the outermost detections they are
        carried on, and no error of the model's form is added. For red and blue that of
        lateral colour is added as if independent.

        Parameters
        ----------
        points_mm : Of the undistorted picture; for a place on the photograph its
            `undistorted_from_distorted`.
        channel : "r", "g" or "b".

        Raises
        ------
        LensfitError : The preset does not say how well its distortion is known at this
            state, or its lateral colour.
        ValueError : Unknown channel, or points of the wrong shape.
        """
        points = np.asarray(points_of(points_mm, 2))
        channel_index(channel)
        known, lens = self.covariances.distortion, self.distortion
        if known is None:
            raise _unknown("distortion")
        frame = frame_points_mm(lens, self.sensor_size_mm)

        def deviations(points: np.ndarray) -> np.ndarray:
            return position_deviations_mm(points, lens, known, frame)

        green = _deviations_of_some(deviations, points)
        if channel == "g":
            return green
        landed = self.distorted_from_undistorted(points)
        return np.hypot(
            green, self.lateral_colour_standard_deviation_mm(landed, channel)
        )

    def object_standard_deviation_mm(
        self, object_points_mm: Float[ArrayLike, "points 3"]
    ) -> Float[np.ndarray, "points 2"]:
        """How well `project` is known in green: one standard deviation along x and
        along y on the sensor.

        An affine map of each plane of objects is left out. At the distance of the chart
        it is about `position_standard_deviation_mm`; elsewhere the doubt about where
        the entrance pupil is, and how it moves with field angle, comes on top.

        Parameters
        ----------
        object_points_mm : x right, y down, z distance from the sensor plane.

        Raises
        ------
        LensfitError : The preset does not say how well its distortion and entrance
            pupil are known at this state.
        ValueError : Points of the wrong shape.
        """
        points = np.asarray(points_of(object_points_mm, 3))
        known, lens = self.covariances.perspective, self.distortion
        if known is None:
            raise _unknown("entrance pupil")
        return object_deviations_mm(
            points,
            Perspective(self.entrance_pupil_offset_mm, lens, self.pupil_shift),
            known,
            frame_points_mm(lens, self.sensor_size_mm),
        )

    def lateral_colour_standard_deviation_mm(
        self, points_mm: Float[ArrayLike, "points 2"], channel: Channel
    ) -> Float[np.ndarray, "points 2"]:
        """How well it is known how far a channel lands from green: one standard
        deviation along x and along y on the sensor; zero for green.

        Parameters
        ----------
        points_mm : Where green lands. Beyond the photographed radius the deviation
            stays, as lateral colour does.
        channel : "r", "g" or "b".

        Raises
        ------
        LensfitError : The preset does not say how well its lateral colour is known at
            this state; or it has none, where none was measured or none was found.
        ValueError : Unknown channel, or points of the wrong shape.
        """
        points = np.asarray(points_of(points_mm, 2))
        shift, known = self._shift(channel), self.covariances
        if channel == "g":
            return np.zeros_like(points)
        covariance = known.red if channel == "r" else known.blue
        if shift is None or covariance is None:
            raise _unknown("lateral colour")

        def deviations(points: np.ndarray) -> np.ndarray:
            given = self.distortion, shift, jnp.asarray(covariance)
            return in_batches(lambda p: lateral_deviations_mm(p, *given), points)

        return _deviations_of_some(deviations, points)

    def illumination_standard_deviation(
        self, points_mm: Float[ArrayLike, "points 2"], channel: Channel = "g"
    ) -> Float[np.ndarray, " points"]:
        """How well `relative_illumination` is known: one standard deviation; zero on
        the axis, where it is 1 by definition.

        Parameters
        ----------
        points_mm : Of the photograph.
        channel : "r", "g" or "b".

        Raises
        ------
        LensfitError : The preset does not say how well its fall-off is known at this
            state: none was photographed there, or a knob turned it.
        ValueError : Unknown channel, or points of the wrong shape.
        """
        points = np.asarray(points_of(points_mm, 2))
        index, light = channel_index(channel), self.illumination
        known = self.covariances.fall_off
        if light is None or known is None:
            raise _unknown("fall-off")

        def deviations(points: np.ndarray) -> np.ndarray:
            given = (
                self.distortion.principal_point_mm,
                light.valid_radius_mm,
                light.control[index],
                jnp.asarray(known[index]),
            )
            return in_batches(lambda p: light_deviations(p, *given), points)

        return _deviations_of_some(deviations, points)

    def _shift(self, channel: str) -> ChannelShift | None:
        index = channel_index(channel)
        if self.lateral_colour is None or index == 1:
            return None
        return self.lateral_colour[index // 2]


def points_of(points: ArrayLike, columns: int) -> Float[Array, "points columns"]:
    """Points as an array of as many columns.

    Raises
    ------
    ValueError : They have another shape.
    """
    array = jnp.asarray(points, jnp.float64)
    if array.ndim != 2 or array.shape[1] != columns:
        raise ValueError(f"points have shape {array.shape}, expected (n, {columns})")
    return array


def channel_index(channel: str) -> int:
    """0, 1 or 2 for "r", "g" or "b".

    Raises
    ------
    ValueError : It is none of these.
    """
    if channel not in _CHANNELS:
        raise ValueError(f"channel {channel!r} is none of 'r', 'g', 'b'")
    return _CHANNELS.index(channel)


def _deviations_of_some(
    deviations: Callable[[np.ndarray], np.ndarray], points: np.ndarray
) -> np.ndarray:
    """Of no points there are none; batches need one."""
    some = points if len(points) else np.zeros((1, 2))
    return deviations(some)[: len(points)]


def _unknown(what: str) -> LensfitError:
    return LensfitError(
        f"the preset does not say how well its {what} is known at this state",
        remedy="calibrate its photographs again with this version, and ask for a state "
        "that was photographed",
    )
