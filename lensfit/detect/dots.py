"""Dots on a photograph of a dot or circle grid, measured and indexed.

Bright dots on black or dark dots on white. Candidates come from a local threshold
(`blobs`), their lattice from `lattice`, their positions from `centroids`; then what
does not fit its neighbours in place, size and contrast is left out. Positions refer to
the green channel, and every channel is measured by the same rule around the same start,
so that differences between channels are lateral colour and nothing else.
"""

from concurrent.futures import ThreadPoolExecutor

import cv2
import numpy as np
from scipy.spatial import KDTree

from lensfit.detect.blobs import POLARITIES, Blobs, find_blobs
from lensfit.detect.centroids import Measured, measure, windows_of
from lensfit.detect.dot_checks import (
    lit_enough,
    overlapping,
    primitive_cells,
    resembling,
)
from lensfit.detect.lattice import index_lattice
from lensfit.detect.lattice_growth import nearest
from lensfit.detect.observations import POINT, Observations
from lensfit.errors import DetectionError
from lensfit.photograph import Photograph

_FEWEST = 16
_THREADS = 2
"""Of channels: the noise of one is judged while dots of another are measured."""


def find_dots(
    photograph: Photograph,
    *,
    polarity: str | None = None,
    asymmetric: bool = False,
) -> Observations:
    """Find, measure and index the dots of a grid.

    Parameters
    ----------
    photograph : Scene-linear picture.
    polarity : "bright" dots on black, "dark" dots on white, or None to find out.
    asymmetric : The target is an asymmetric circle grid.

    Raises
    ------
    DetectionError : No dots, too few, or no lattice among them; the sentence says what
        was seen and what to do.
    """
    polarities = POLARITIES if polarity is None else (polarity,)
    if not set(polarities) <= set(POLARITIES):
        raise ValueError(f"polarity must be one of {POLARITIES} or None")
    image = photograph.luminance_channel
    search = find_blobs(np.ascontiguousarray(image), polarities)
    candidates = len(search.blobs.centre_px)
    indices, valid = index_lattice(search.blobs.centre_px, asymmetric=asymmetric)
    if np.count_nonzero(valid) < _FEWEST:
        raise _complaint(photograph, image, candidates, int(valid.sum()))
    whole = valid & ~search.blobs.cut
    blobs, strays = search.blobs.subset(whole), search.blobs.subset(~valid)
    observations = _observe(
        photograph, blobs, indices[whole], search.polarity, asymmetric, strays
    )
    if len(observations) < _FEWEST:
        raise _complaint(photograph, image, candidates, len(observations))
    return observations


def _observe(
    photograph: Photograph, blobs: Blobs, indices, polarity, asymmetric, strays: Blobs
) -> Observations:
    """Measure every channel, leave out what is no dot, and fill in the record."""
    pixels, ceiling = photograph.pixels, photograph.saturation
    green = 1 if pixels.shape[2] == 3 else 0
    spacing = nearest(KDTree(blobs.centre_px), blobs.centre_px, 2)[0][:, 1]
    windows = windows_of(blobs.moment_px2, spacing, bright=polarity == "bright")
    ignore = _drawn(strays, pixels.shape[:2])

    def measured(channel: int) -> Measured:
        light = pixels[..., channel]
        return measure(light, blobs.centre_px, windows, polarity, ceiling, ignore)

    with ThreadPoolExecutor(_THREADS) as pool:
        channels = list(pool.map(measured, range(pixels.shape[2])))
    candidates = len(blobs.centre_px) + len(strays.centre_px)
    main = channels[green]
    sign = 1 if polarity == "bright" else -1
    tone = sign * main.level / (1 if polarity == "bright" else main.background)
    cells = primitive_cells(indices, asymmetric)
    with np.errstate(divide="ignore", invalid="ignore"):  # some have no light
        unrest = main.noise / np.abs(main.level)
    lit = lit_enough(main.background, main.steepness)
    keep = resembling(cells, main.centre_px, tone, blobs.area_px, unrest, lit)
    channels = [Measured(*(column[keep] for column in m)) for m in channels]
    main = channels[green]
    touching = overlapping(
        photograph.luminance_channel,
        cells[keep],
        main.centre_px,
        main.level,
        float(np.median(main.noise)) if keep.any() else 0.0,
        main.steepness,
    )
    lattice = _from_zero(indices[keep], asymmetric)
    return _record(photograph, lattice, channels, touching, polarity, candidates)


def _from_zero(indices: np.ndarray, asymmetric: bool) -> np.ndarray:
    """Indices counted from the smallest of the dots that are left."""
    least = indices.min(0, initial=1 << 30)
    if asymmetric:
        least -= [0, least.sum() % 2]  # keep i + j even
    return indices - least if len(indices) else indices


def _drawn(strays: Blobs, shape: tuple[int, int]) -> np.ndarray:
    """Mask of the marks that belong to no lattice, with their blur."""
    mask = np.zeros(shape, np.uint8)
    radius = 1.3 * np.sqrt(strays.area_px / np.pi) + 2
    centres = np.floor(strays.centre_px).astype(int)
    for (x, y), r in zip(centres.tolist(), np.ceil(radius).astype(int), strict=True):
        cv2.circle(mask, (x, y), int(r), 1, -1)
    return mask.view(bool)


def _record(
    photograph, indices, channels: list[Measured], touching, polarity, candidates
) -> Observations:
    """The observations of measured, checked dots."""
    count = len(indices)
    main = channels[1 if len(channels) == 3 else 0]
    points = np.full((3, count, 2), np.nan)
    covariances = np.full((3, count, 2, 2), np.nan)
    if len(channels) == 3:
        points = np.stack([m.centre_px for m in channels])
        covariances = np.stack([m.covariance_px2 for m in channels])
    saturated = np.any([m.saturated for m in channels], axis=0)
    flux = [m.flux if polarity == "bright" else m.background for m in channels]
    half_trace = np.trace(main.moment_px2, axis1=1, axis2=2) / 2
    return Observations(
        lattice=indices.astype(float),
        points_px=main.centre_px,
        covariance_px2=main.covariance_px2,
        family=np.full(count, POINT),
        normal=np.full((count, 2), np.nan),
        saturated=saturated,
        overlapping=touching,
        channel_points_px=points,
        channel_covariance_px2=covariances,
        flux=np.stack(flux, 1),
        diameter_px=4 * np.sqrt(np.maximum(half_trace, 0)),
        image_size_px=photograph.size_px,
        candidates=candidates,
        bright=polarity == "bright",
        notes=_notes(photograph, saturated, touching),
    )


def _notes(photograph: Photograph, saturated, touching) -> tuple[str, ...]:
    """What the photographer should know about the dots that were kept."""
    notes = []
    if saturated.any():
        notes.append(
            f"{saturated.sum()} of {len(saturated)} dots touch clipped samples; "
            "expose less"
        )
    if touching.any():
        notes.append(
            f"the blur of {touching.sum()} of {len(touching)} dots touches a "
            "neighbour's; focus nearer or use a coarser grid"
        )
    if photograph.chroma_subsampled and photograph.pixels.shape[2] == 3:
        notes.append(
            "red and blue were stored at lower resolution, so lateral colour is "
            "less certain than its covariance says"
        )
    return tuple(notes)


def _complaint(photograph, image, candidates: int, indexed: int) -> DetectionError:
    """What was seen on a photograph without a grid, and what to do."""
    clipped = float(np.mean(image >= photograph.saturation))
    if clipped > 0.5:
        what = f"no dot grid found: {clipped:.0%} of the picture is over-exposed"
        remedy = "expose less, or light the target evenly"
    elif not candidates:
        what, remedy = "no dots found", "check the picture, its polarity and its roi"
    elif indexed < 9:
        what = f"{candidates} dot-like marks found, but no lattice among them"
        remedy = "check that this is a dot grid, or set a roi around it"
    else:
        what = f"only {indexed} dots of a lattice found, {_FEWEST} are needed"
        remedy = "show more of the target, or set a roi around it"
    return DetectionError(what, where=photograph.path, remedy=remedy)
