"""What a Cryptomatte adds to depth: who shares a pixel, and whose edge counts.

Renderers write one distance for a pixel that two objects share, and for a thin or soft
object it is often the background's. The objects named as edge mask get their own
distance over every pixel they touch.
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float32
from scipy.ndimage import distance_transform_edt, maximum_filter, minimum_filter

from lensfit.coords import Window
from lensfit.errors import ImageError
from lensfit.io.cryptomatte import (
    Cryptomatte,
    coverage_of,
    find_cryptomattes,
    id_of,
    read_ranks,
)
from lensfit.io.exr import ExrImage
from lensfit.render.layer_stack import Mattes

_RANKS = 2
"""Objects of a pixel that the renderer tells apart."""
_WHOLE, _LEAST = 0.999, 1e-3
_REACH_PX = 3.0
"""A pixel that an object covers wholly, this near, knows the object's distance."""

Plane = Float32[np.ndarray, "height width"]


def plate_mattes(image: ExrImage, path: Path, window: Window) -> Mattes | None:
    """The objects of a plate over a data window; None when it has no Cryptomatte there.

    Of several Cryptomattes the one of objects is taken, or else the first.

    Raises
    ------
    ImageError : A manifest cannot be read.
    """
    found = [c for c in find_cryptomattes(image, path) if c.data_window == window]
    if not found:
        return None
    chosen = next((c for c in found if "object" in c.name.lower()), found[0])
    ranks = read_ranks(chosen, _RANKS)
    with np.errstate(invalid="ignore"):
        coverage = np.clip(np.nan_to_num(ranks.coverage), 0, 1)
    return Mattes(ranks.ids, coverage)


def with_edge_mask(
    depth_mm: Plane, image: ExrImage, path: Path, window: Window, names: Sequence[str]
) -> Plane:
    """Depth in which the named objects reach over every pixel they touch.

    Parameters
    ----------
    depth_mm : Over the data window.
    names : Objects, by their names in any Cryptomatte of the plate.

    Raises
    ------
    ImageError : The plate has no Cryptomatte, or no object of a name.
    """
    mattes = [c for c in find_cryptomattes(image, path) if c.data_window == window]
    if not mattes:
        raise ImageError(
            "has no Cryptomatte, so no object can be an edge mask",
            where=path,
            remedy="render one, or leave --edge-mask out",
        )
    for name in names:
        cover = _coverage(mattes, name)
        if cover is None:
            known = ", ".join(
                list(dict.fromkeys(n for c in mattes for n in c.manifest))[:20]
            )
            raise ImageError(
                f"has no object {name!r}",
                where=path,
                remedy=f"its objects are {known or 'not named'}",
            )
        depth_mm = extended_depth(depth_mm, cover)
    return depth_mm


def _coverage(mattes: Sequence[Cryptomatte], name: str) -> Plane | None:
    for crypto in mattes:
        cover = coverage_of(read_ranks(crypto), [id_of(crypto, name)])
        if name in crypto.manifest or cover.any():
            return cover
    return None


def extended_depth(depth_mm: Plane, coverage: Plane) -> Plane:
    """The distance of an object over every pixel it covers at all.

    Pixels that it covers wholly keep theirs, and lend it to their neighbours. Where
    none is near, as on a wire thinner than a pixel, the most covered pixels lend the
    least distance around them.
    """
    touched = coverage > _LEAST
    if not touched.any():
        return depth_mm
    whole = coverage >= _WHOLE
    own = np.where(whole, depth_mm, np.float32(np.inf))
    result = depth_mm.copy()
    near = np.zeros_like(touched)
    if whole.any():
        distance, at = distance_transform_edt(~whole, return_indices=True)  # pyright: ignore[reportGeneralTypeIssues]
        near = distance <= _REACH_PX
        result = np.where(touched & near, own[tuple(at)], result)
    thin = touched & ~near
    if thin.any():
        crest = thin & (coverage >= maximum_filter(np.where(thin, coverage, 0), 3))
        around = minimum_filter(np.where(touched, depth_mm, np.inf), 3)
        at = distance_transform_edt(~crest, return_distances=False, return_indices=True)
        result = np.where(thin, around[tuple(np.asarray(at))], result)
    return result.astype(np.float32)
