"""Where points and the light of dots land in every photograph, as the lens predicts.

A dot's point is its centroid and, where its blur was measured, the image of light that
the model expects around the chief ray; a line's is a sample of its middle; a corner's
is the corner. Pixels of the photograph, x right, y down.

The light of dots is drawn from the rays of the measured wavefront. Few rays
are traced; between them landing points are interpolated (a polynomial along each spoke
of the pupil, straight lines from spoke to spoke) and added to the pixels they fall on.
Rings are offset from spoke to spoke and wavelength to wavelength, so that none shows.
Dot aperture and diffraction blur all dots of a photograph alike: a small aperture by a
Gaussian of the picture, or, where that is too narrow, by a random step of every ray; a
broad dot by a disc, with a rim.
"""

from dataclasses import dataclass, replace
from functools import cache

import cv2
import numpy as np
from jaxtyping import Float, Float32, Int

from lensfit.fitting.chart_view import View
from lensfit.fitting.fall_off.illumination import area_stretch
from lensfit.fitting.lens_state import LensState
from lensfit.fitting.lens_states import FittedLens
from lensfit.fitting.wavefront.dot_arrays import dot_aperture_variance_mm2
from lensfit.fitting.wavefront.fit import WavefrontFit
from lensfit.fitting.wavefront.green_landings import RINGS, Landings, green_landings
from lensfit.workflow.pictures.chart_shapes import discs

_FINE_RINGS, _BETWEEN = 12, 3
"""Interpolated rings of equal area; spokes for each that was traced."""
_GOLDEN, _PLASTIC = (5**0.5 - 1) / 2, 1.32471795724474602596
_LEAST_SIGMA_PX = 0.4
"""A narrower Gaussian is none between pixels."""
_UNEVEN = 0.8
"""Of the rays' spacing: a Gaussian that hides it."""
_AT_ONCE = 256


@dataclass(frozen=True, eq=False)
class DotLight:
    """Measured light of the dots of one photograph, green.

    Attributes
    ----------
    landings : Of their rays.
    chief_rays_px : Where each dot's chief ray lands.
    brightness : Light of each dot, in any unit.
    pixel_mm : Width and height of a pixel.
    sigma_px : Of the Gaussian that stands for diffraction, and for a small hole.
    disc_px : From the unit disc to the image of a broad dot; None for small holes.
    """

    landings: Landings
    chief_rays_px: Float[np.ndarray, "dots 2"]
    brightness: Float[np.ndarray, " dots"]
    pixel_mm: Float[np.ndarray, "2"]
    sigma_px: float
    disc_px: Float[np.ndarray, "2 2"] | None = None


def drawn_light(
    dots: DotLight, size_px: tuple[int, int], coarser: int = 1
) -> Float32[np.ndarray, "height width"]:
    """Light of the dots in every pixel of a picture of this width and height.

    Parameters
    ----------
    coarser : Pixels of the photograph along each pixel of the picture, about: the
        picture has so many times fewer.
    """
    width, height = (round(side / coarser) for side in size_px)
    dots = _on_larger_pixels(dots, (width / size_px[0], height / size_px[1]))
    light = np.zeros(width * height)
    uneven = _UNEVEN * _spacing_px(dots)
    soft = uneven >= _LEAST_SIGMA_PX
    for first in range(0, len(dots.chief_rays_px), _AT_ONCE):
        some = slice(first, first + _AT_ONCE)
        x, y = _interpolated_rays(dots.landings.from_chief_mm[some])
        step_x, step_y = _steps(x.shape[1:]) * np.float32(0 if soft else dots.sigma_px)
        column = _pixel(x / dots.pixel_mm[0] + step_x, dots.chief_rays_px[some, 0])
        row = _pixel(y / dots.pixel_mm[1] + step_y, dots.chief_rays_px[some, 1])
        weight = dots.landings.weight[some] * dots.brightness[some, None]
        each = _between(weight, axis=1) / (_BETWEEN * _FINE_RINGS * x.shape[1])
        inside = (column >= 0) & (column < width) & (row >= 0) & (row < height)
        at = (row * width + column)[inside]
        share = np.broadcast_to(each[:, None, :, None], x.shape)[inside]
        light += np.bincount(at, share, minlength=light.size)
    picture = light.reshape(height, width).astype(np.float32)
    if soft:
        sigma = float(np.hypot(dots.sigma_px, uneven))
        picture = np.asarray(cv2.GaussianBlur(picture, (0, 0), sigma))
    if dots.disc_px is None:
        return picture
    disc = _disc(dots.disc_px)
    return np.asarray(cv2.filter2D(picture, -1, disc, borderType=cv2.BORDER_CONSTANT))


def _disc(disc_px: Float[np.ndarray, "2 2"]) -> Float32[np.ndarray, "side side"]:
    """In the middle of an odd number of pixels; sums to 1."""
    side = 2 * int(np.ceil(np.abs(disc_px).sum(-1).max())) + 3
    drawn = discs(np.full((1, 2), side / 2), disc_px[None], (side, side))
    return drawn / drawn.sum()


def _on_larger_pixels(dots: DotLight, scale: tuple[float, float]) -> DotLight:
    """The same dots on pixels so many times as many."""
    disc_px = dots.disc_px
    return replace(
        dots,
        chief_rays_px=dots.chief_rays_px * np.array(scale),
        pixel_mm=dots.pixel_mm / np.array(scale),
        sigma_px=dots.sigma_px * float(np.sqrt(scale[0] * scale[1])),
        disc_px=None if disc_px is None else disc_px * np.array(scale)[:, None],
    )


def _spacing_px(dots: DotLight) -> float:
    """Of the interpolated rays, if the blur of most dots were an even disc."""
    landed = dots.landings.from_chief_mm / dots.pixel_mm.astype(np.float32)
    variance = float(np.median(np.var(landed, axis=(1, 2, 3)).mean(-1)))
    rays = landed.shape[2] * _BETWEEN * _FINE_RINGS
    return float(np.sqrt(4 * np.pi * variance / rays))


def _interpolated_rays(
    from_chief_mm: Float[np.ndarray, "dots wavelengths spokes rings 2"],
) -> tuple[np.ndarray, np.ndarray]:
    """x and y of interpolated rays: (dots, wavelengths, spokes, rings)."""
    spokes = _between(from_chief_mm, axis=2)
    by_spoke = np.transpose(spokes, (1, 2, 4, 0, 3))
    wavelengths, count, *_, rings = by_spoke.shape
    columns = by_spoke.reshape(wavelengths, count, -1, rings)
    fine = columns @ _to_fine_rings(wavelengths, count)
    both = fine.reshape(wavelengths, count, 2, -1, _FINE_RINGS)
    x, y = np.transpose(both, (2, 3, 0, 1, 4))
    return x, y


def _between(of_spokes: np.ndarray, axis: int) -> np.ndarray:
    """Values of the traced spokes, and of those between each and the next."""
    following = np.roll(of_spokes, -1, axis=axis)
    parts = [
        of_spokes + k / _BETWEEN * (following - of_spokes) for k in range(_BETWEEN)
    ]
    shape = list(of_spokes.shape)
    shape[axis] *= _BETWEEN
    return np.stack(parts, axis=axis + 1).reshape(shape)


def _pixel(from_chief_px: np.ndarray, chief_px: np.ndarray) -> Int[np.ndarray, "..."]:
    at = from_chief_px + chief_px[:, None, None, None].astype(np.float32)
    return np.floor(at).astype(np.int32)


@cache
def _to_fine_rings(
    wavelengths: int, spokes: int
) -> Float32[np.ndarray, "wavelengths spokes rings fine"]:
    """From values on the traced rings of each spoke to those on rings of equal area,
    by Lagrange's polynomial in the reach."""
    square, _ = np.polynomial.legendre.leggauss(RINGS)
    powers = np.arange(RINGS)
    shift = np.arange(wavelengths)[:, None] / wavelengths
    offset = np.mod(np.arange(spokes) * _GOLDEN + shift, 1.0)
    area = (np.arange(_FINE_RINGS) + offset[..., None]) / _FINE_RINGS
    fine = np.sqrt(area)[..., None] ** powers
    traced = np.sqrt((square + 1) / 2)[:, None] ** powers
    return np.linalg.solve(traced.T, np.swapaxes(fine, 2, 3)).astype(np.float32)


@cache
def _steps(shape: tuple[int, ...]) -> Float32[np.ndarray, "2 *shape"]:
    """Steps of a Gaussian of deviation 1, one for each ray, evenly drawn.

    Box and Muller's pairs of M. Roberts' sequence R2 ("The unreasonable effectiveness
    of quasirandom sequences", 2018).
    """
    index = np.arange(1, np.prod(shape) + 1)[:, None]
    even = np.mod(0.5 + index * np.array([1 / _PLASTIC, 1 / _PLASTIC**2]), 1.0)
    reach, turn = np.sqrt(-2 * np.log(1 - even[:, 0])), 2 * np.pi * even[:, 1]
    steps = np.stack([reach * np.cos(turn), reach * np.sin(turn)])
    return steps.reshape(2, *shape).astype(np.float32)


@dataclass(frozen=True, eq=False)
class PredictedPoints:
    """Detected points of one photograph where the model puts them.

    Attributes
    ----------
    state : Of the lens.
    points_px : Where each point of the photograph would be seen.
    chief_rays_px : Where its chief ray lands; the same where blur was not measured.
    stretch_px : d pixels / d mm on the target, at every point.
    pitch_mm : Of the target.
    light : Of the dots, where their blur was measured.
    """

    state: LensState
    points_px: Float[np.ndarray, "points 2"]
    chief_rays_px: Float[np.ndarray, "points 2"]
    stretch_px: Float[np.ndarray, "points 2 2"]
    pitch_mm: tuple[float, float]
    light: DotLight | None = None


def predicted_points(
    fitted: FittedLens, takes: list[View]
) -> dict[str, PredictedPoints]:
    """Every photograph that was fitted, by name.

    Parameters
    ----------
    takes : As observed: their points are where they were seen.
    """
    seen = {take.name: take.observations.points_px for take in takes}
    found = {}
    for state in fitted.states:
        adjustment = state.geometry.adjustment
        stretch_mm, left_mm = area_stretch(adjustment), adjustment.residual_mm()
        for k, take in enumerate(state.geometry.takes):
            count, size_mm = len(take.observations), take.pixel_mm
            left_px = left_mm[k, :count] / size_mm
            # What blur does to a centroid is in what was seen, not in what is left.
            found[take.name] = PredictedPoints(
                state=state,
                points_px=seen[take.name] + left_px,
                chief_rays_px=take.observations.points_px + left_px,
                stretch_px=stretch_mm[k, :count] / size_mm[:, None],
                pitch_mm=take.pitch_mm,
            )
    for wavefront in fitted.wavefronts.values():
        found |= _with_light(wavefront, found)
    return found


def _with_light(
    wavefront: WavefrontFit, found: dict[str, PredictedPoints]
) -> dict[str, PredictedPoints]:
    """The photographs whose dots show the blur, with the light of these."""
    dot_data = wavefront.dot_data
    landings = green_landings(wavefront.stage, dot_data)
    dots, broad = dot_data.dots, dot_data.dots.broad
    gaussian_mm2 = (
        dot_aperture_variance_mm2(dots) if broad is None else dots.variance_mm2.mean(-1)
    )
    with_light = {}
    for k, photograph in enumerate(dot_data.photographs):
        predicted = found.get(photograph.take.name)
        if predicted is None or photograph.take.observations.are_edges:
            continue
        mine, dots_of = dot_data.take == k, photograph.dot_images.marks
        size_mm = photograph.take.pixel_mm
        variance_mm2 = float(np.median(gaussian_mm2[mine]))
        light = DotLight(
            landings=Landings(*(part[mine] for part in landings)),
            chief_rays_px=predicted.chief_rays_px[dots_of],
            # The larger a hole is imaged, the more light it sends.
            brightness=np.abs(np.linalg.det(predicted.stretch_px[dots_of])),
            pixel_mm=size_mm,
            sigma_px=float(np.sqrt(variance_mm2 / np.prod(size_mm))),
            disc_px=None
            if broad is None
            else np.median(broad.disc_mm[mine], 0) / size_mm[:, None],
        )
        with_light[photograph.take.name] = replace(predicted, light=light)
    return with_light
