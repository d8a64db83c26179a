"""Positions of the detected points in every photograph, as the fitted lens predicts.

A dot's point is its centroid and, where its blur was measured, the image of light that
the model expects around the chief ray; a line's is a sample of its middle; a corner's
is the corner. Pixels of the photograph, x right, y down.
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from lensfit.fitting.chart_view import View
from lensfit.fitting.fall_off.brightness import area_stretch
from lensfit.fitting.lens_state import LensState
from lensfit.fitting.lens_states import FittedLens
from lensfit.fitting.wavefront.dots import dot_aperture_variance_mm2
from lensfit.fitting.wavefront.fit import WavefrontFit
from lensfit.fitting.wavefront.portray import Landings, green_landings
from lensfit.workflow.pictures.dot_light import DotLight


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
