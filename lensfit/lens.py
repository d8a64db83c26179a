"""A lens at one focal length, f-number and focus distance: what every caller asks.

Points are sensor millimetres, origin at the sensor centre, x right, y down. Object
points are millimetres, x right, y down, z the distance from the sensor plane.
Distances to the scene count from the sensor plane, as on the barrel.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from lensfit.errors import LensfitError
from lensfit.optics.chief_rays import AbstractChiefRays, channel_index, points_of
from lensfit.optics.chief_rays import Channel as Channel
from lensfit.optics.distortion import Distortion
from lensfit.optics.falloff import Illumination
from lensfit.optics.lateral import LateralColour, no_lateral_colour
from lensfit.optics.map_deviations import MapCovariances
from lensfit.optics.projection import PupilShift
from lensfit.psf.lens_blur import LensBlur, perfect_blur
from lensfit.psf.lens_psf import (
    KnownPsfs,
    MovedBlurs,
    Optics,
    Points,
    Raster,
    known_psfs,
    lens_psfs,
)

TOLERANCE = 0.01
"""Relative error of a point-spread function, when nobody says."""


class Lens(AbstractChiefRays):
    """A calibrated lens at one state: chief rays and fall-off, and the blur.

    Attributes
    ----------
    distortion, lateral_colour, illumination, entrance_pupil_offset_mm, sensor_size_mm,
    pupil_shift, covariances : As in `AbstractChiefRays`.
    focal_length_mm, f_number, focus_distance_mm : The state; None where unknown.
    notes : Extrapolations of the preset to reach this state, and inactive overrides;
        one sentence each.
    blur : Aberrations and pupil, or None when they were not measured (then the lens
        counts as perfect).
    moved_blurs : Makes the blur as changed by each independent error of its numbers, or
        by so many random ones that represent all (`lensfit.psf.lens_psf`); None
        if these errors are unknown.
    largest_blur_mm : No object counts as farther out of focus than a thin lens blurs to
        this radius; None for no limit.
    """

    distortion: Distortion
    lateral_colour: LateralColour
    illumination: Illumination | None
    entrance_pupil_offset_mm: Float[Array, ""]
    sensor_size_mm: tuple[float, float] = eqx.field(static=True)
    focal_length_mm: float = eqx.field(static=True)
    f_number: float | None = eqx.field(static=True, default=None)
    focus_distance_mm: float | None = eqx.field(static=True, default=None)
    notes: tuple[str, ...] = eqx.field(static=True, default=())
    blur: LensBlur | None = None
    moved_blurs: Callable[[int | None], MovedBlurs] | None = eqx.field(
        static=True, default=None
    )
    largest_blur_mm: float | None = eqx.field(static=True, default=None)
    pupil_shift: PupilShift | None = None
    covariances: MapCovariances = eqx.field(default_factory=MapCovariances)

    def psf(
        self,
        image_point_mm: Float[ArrayLike, "2"] | Sequence[float],
        object_distance_mm: float,
        channel: Channel = "g",
        *,
        pixel_pitch_mm: float | tuple[float, float],
        size_px: int,
        tolerance: float = TOLERANCE,
    ) -> Float[Array, "size size"]:
        """Point-spread function on pixels, row 0 on top; sums to 1.

        Light that falls beside the array is left out.

        Parameters
        ----------
        image_point_mm : Where the green chief ray of the object lands (distorted): the
            middle of the array, whatever the channel.
        object_distance_mm : From the sensor plane; may be infinite.
        channel : "r", "g" or "b".
        pixel_pitch_mm : Of square pixels, or along x and y.
        size_px : Rows and columns of the array.
        tolerance : Relative error to aim at (L2); time is inverse to it.

        Raises
        ------
        LensfitError : The blur was not measured, and f-number or focus distance is
            unknown; or the object is nearer than the lens has an image of it; or no
            light comes to the point; or there are no such pixels.
        ValueError : Unknown channel, or a pitch or point of the wrong shape.
        """
        point = jnp.asarray(image_point_mm, jnp.float64)
        kernel = self.psfs(
            point[None],
            object_distance_mm,
            (channel,),
            pixel_pitch_mm=pixel_pitch_mm,
            size_px=size_px,
            tolerance=tolerance,
        )[0, 0]
        self._check_lit(point, kernel)
        return kernel

    def psfs(
        self,
        image_points_mm: Float[ArrayLike, "points 2"],
        object_distance_mm: Float[ArrayLike, "*points"],
        channels: Sequence[Channel] = ("r", "g", "b"),
        *,
        pixel_pitch_mm: float | tuple[float, float],
        size_px: int,
        tolerance: float = TOLERANCE,
        with_lateral_colour: bool = True,
    ) -> Float[Array, "points channels size size"]:
        """`psf` of many points and channels; one distance, or one for each point.

        A point that no light comes to is all zeros, and no error.

        Parameters
        ----------
        with_lateral_colour : Whether red and blue lie from the middle as they land from
            green; else each channel's own light is in the middle.

        Raises
        ------
        LensfitError : An object is too near for a sharp image; or there are no such
            pixels.
        """
        whole = self.blur or self.perfect_blur(), self.distortion, self.lateral_colour
        found = lens_psfs(
            self._rows(image_points_mm, object_distance_mm, channels),
            whole if with_lateral_colour else self.optics_without_lateral_colour(),
            _raster(pixel_pitch_mm, tolerance, size_px),
        )
        return jnp.asarray(found.reshape(-1, len(channels), size_px, size_px))

    def optics_without_lateral_colour(self) -> Optics:
        """What lands rays, each channel's own chief ray where green's is.

        The wavelengths of a channel still part by as much as was measured.

        Raises
        ------
        LensfitError : As `perfect_blur`.
        """
        lateral, blur = self.lateral_colour, self.blur or self.perfect_blur()
        if lateral is None:
            return blur, self.distortion, None
        measured = blur.measured_lateral or lateral
        blur = replace(blur, measured_lateral=measured)
        return blur, self.distortion, no_lateral_colour()

    def psf_standard_deviation(
        self,
        image_point_mm: Float[ArrayLike, "2"] | Sequence[float],
        object_distance_mm: float,
        channel: Channel = "g",
        *,
        pixel_pitch_mm: float | tuple[float, float],
        size_px: int,
        tolerance: float = TOLERANCE,
    ) -> Float[np.ndarray, "size size"]:
        """How well each pixel of `psf` is known: one standard deviation, in its unit.

        What the photographs left open about the blur, carried on to first order. Where
        the light lands is not in it; see `position_standard_deviation_mm`.

        Parameters
        ----------
        image_point_mm, object_distance_mm, channel, pixel_pitch_mm, size_px, tolerance
            : As for `psf`.

        Raises
        ------
        LensfitError : The preset lacks the deviation of its blur; or as `psf`.
        ValueError : As `psf`.
        """
        point = jnp.asarray(image_point_mm, jnp.float64)
        known = self.known_psfs(
            point[None],
            object_distance_mm,
            channel,
            pixel_pitch_mm=pixel_pitch_mm,
            size_px=size_px,
            tolerance=tolerance,
        )
        self._check_lit(point, known.psf[0])
        return known.deviation[0]

    def known_psfs(
        self,
        image_points_mm: Float[ArrayLike, "points 2"],
        object_distance_mm: Float[ArrayLike, "*points"],
        channel: Channel = "g",
        *,
        pixel_pitch_mm: float | tuple[float, float],
        size_px: int,
        tolerance: float = TOLERANCE,
        draws: int | None = None,
    ) -> KnownPsfs:
        """`psf` and `psf_standard_deviation` of many points; zeros as in `psfs`.

        Parameters
        ----------
        draws : How many random errors of the blur stand for all that it may have, which
            is quicker, right on average, and off by a quarter at one pixel with eight;
            None for each of those.

        Raises
        ------
        LensfitError, ValueError : As `psf_standard_deviation`.
        """
        if self.blur is None or self.moved_blurs is None:
            raise LensfitError(
                "the preset does not say how well its blur is known",
                remedy="calibrate its photographs again with this version",
            )
        return known_psfs(
            self._rows(image_points_mm, object_distance_mm, (channel,)),
            (self.blur, self.distortion, self.lateral_colour),
            _raster(pixel_pitch_mm, tolerance, size_px),
            self.moved_blurs(draws),
        )

    def _rows(
        self,
        image_points_mm: ArrayLike,
        object_distance_mm: ArrayLike,
        channels: Sequence[Channel],
    ) -> Points:
        """Every point in every channel.

        Raises
        ------
        LensfitError : An object is too near for a sharp image.
        """
        points = points_of(image_points_mm, 2)
        distances = np.broadcast_to(
            np.asarray(object_distance_mm, float), points.shape[:1]
        )
        distances = self.distances_within_largest_blur(distances)
        blur = self.blur or self.perfect_blur()
        nearest = float(np.min(distances, initial=np.inf))
        if not nearest > blur.nearest_mm:
            raise LensfitError(
                f"an object {nearest:g} mm from the sensor has no sharp image",
                remedy=f"keep object distances above {blur.nearest_mm:.4g} mm",
            )
        indices = [channel_index(channel) for channel in channels]
        return (
            jnp.repeat(points, len(indices), 0),
            jnp.asarray(np.repeat(distances, len(indices))),
            jnp.asarray(np.tile(indices, len(points)).astype(int)),
        )

    def _check_lit(self, point_mm: Array, kernel: Array | np.ndarray) -> None:
        """Refuse a kernel without light, which would not sum to 1."""
        if 0 < float(kernel.sum()) < np.inf:
            return
        x_mm, y_mm = np.asarray(point_mm).tolist()
        width_mm, height_mm = self.sensor_size_mm
        raise LensfitError(
            f"the lens sends no light to ({x_mm:g}, {y_mm:g}) mm, or all of it beside "
            "the array",
            remedy="give a point inside the image, in mm from the middle of the sensor "
            f"({width_mm:g} x {height_mm:g} mm), or a larger array",
        )

    def perfect_blur(self) -> LensBlur:
        """The blur of a lens of this state without aberrations.

        Raises
        ------
        LensfitError : Its f-number or focus distance is unknown.
        """
        if self.f_number is None or self.focus_distance_mm is None:
            missing = "f_number" if self.f_number is None else "focus_distance_mm"
            raise LensfitError(
                f"the blur of this lens was not measured, and its {missing} is unknown",
                remedy=f"give {missing} to preset.at, for the blur of a perfect lens",
            )
        return perfect_blur(
            self.distortion,
            self.entrance_pupil_offset_mm,
            self.f_number,
            self.focus_distance_mm,
        )

    def blur_per_vergence(self) -> tuple[float, float]:
        """How wide depth blurs, as a thin lens: the radius of a disc in mm is the first
        number, mm^2, times what the vergence of its object (1/mm, from the entrance
        pupil) has beyond the second, that of the focus distance.

        Zeros if the f-number is unknown.
        """
        if self.f_number is None:
            return 0.0, 0.0
        focus_mm = self.focus_distance_mm
        if focus_mm is None and self.blur is not None:
            focus_mm = float(self.blur.reference_distance_mm)
        to_focus = np.inf if focus_mm is None else focus_mm
        to_focus -= float(self.entrance_pupil_offset_mm)
        c = float(self.distortion.principal_distance_mm)
        opening_mm = c / (1 + c / to_focus) / self.f_number
        return opening_mm * c / 2, 1 / to_focus

    def distances_within_largest_blur(self, distances_mm: np.ndarray) -> np.ndarray:
        """Distances from the sensor, those that blur too widely moved to the limit."""
        if self.largest_blur_mm is None:
            return distances_mm
        per_vergence, focus = self.blur_per_vergence()
        if per_vergence == 0:
            return distances_mm
        most = self.largest_blur_mm / per_vergence
        offset_mm = float(self.entrance_pupil_offset_mm)
        vergence = 1 / (distances_mm - offset_mm)
        held = np.clip(vergence, max(focus - most, 0.0), focus + most)
        with np.errstate(divide="ignore"):
            return np.where(held == vergence, distances_mm, 1 / held + offset_mm)


def _raster(
    pixel_pitch_mm: float | tuple[float, float], tolerance: float, size_px: int
) -> Raster:
    """The pixels that are requested.

    Raises
    ------
    LensfitError : There are none of that size, pitch or accuracy.
    """
    pitch = np.broadcast_to(np.asarray(pixel_pitch_mm, float), (2,))
    if not size_px >= 1:
        raise LensfitError(
            f"size_px = {size_px} is no size of an array",
            remedy="give how many rows and columns it has, one at least",
        )
    if not (np.isfinite(pitch) & (pitch > 0)).all():
        said = ", ".join(f"{mm:g}" for mm in np.ravel(pixel_pitch_mm))
        raise LensfitError(
            f"pixel_pitch_mm = {said} is no distance between pixels",
            remedy="give a positive length in mm, such as 0.006",
        )
    if not tolerance > 0:
        raise LensfitError(
            f"tolerance = {tolerance:g} is no relative error to aim at",
            remedy="give a positive number, such as 0.01",
        )
    return Raster(jnp.asarray(pitch), jnp.asarray(tolerance, jnp.float64), size_px)
