"""Mattes of a plate: the objects that share a pixel, and the coverage of one object."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float32

from lensfit.coords import Window
from lensfit.errors import ImageError
from lensfit.io.cryptomatte import (
    Cryptomatte,
    Ranks,
    find_cryptomattes,
    id_of,
    read_ranks,
)
from lensfit.io.depth_channel import depth_over_window
from lensfit.io.exr import ExrImage, ExrPart
from lensfit.plate.cut_out import RANKS, CutOut, cut_out
from lensfit.rendering.layer_stack import Mattes

_OBJECTS, _REST = 1, 2
"""Ids of what a matte channel covers, and of all else."""


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
    return Mattes(*_clean(read_ranks(chosen, RANKS)))


def named_cut_out(
    depth_mm: Float32[np.ndarray, "height width"],
    image: ExrImage,
    path: Path,
    window: Window,
    names: Sequence[str],
) -> CutOut:
    """Objects cut out of a plate by their names in one of its Cryptomattes.

    Parameters
    ----------
    depth_mm : Over the data window.
    window : The data window.
    names : As in the manifest, or as their hashes tell.

    Raises
    ------
    ImageError : The plate has no Cryptomatte, or none that knows all the names.
    """
    crypto, ranks = cryptomatte_with(image, path, window, names)
    return cut_out(depth_mm, ranks, [id_of(crypto, name) for name in names])


def cryptomatte_with(
    image: ExrImage, path: Path, window: Window, names: Sequence[str]
) -> tuple[Cryptomatte, Ranks]:
    """The Cryptomatte over a data window that knows all of these objects.

    Raises
    ------
    ImageError : As `named_cut_out`.
    """
    found = [c for c in find_cryptomattes(image, path) if c.data_window == window]
    if not found:
        raise ImageError(
            "has no Cryptomatte, so no object can be an edge mask",
            where=path,
            remedy="render one, or leave --edge-mask out",
        )
    missing = []
    for crypto in found:
        ranks = _clean(read_ranks(crypto))
        missing.append([n for n in names if not _knows(crypto, ranks, n)])
        if not missing[-1]:
            return crypto, ranks
    known = ", ".join(list(dict.fromkeys(n for c in found for n in c.manifest))[:20])
    raise ImageError(
        f"has no object {min(missing, key=len)[0]!r}",
        where=path,
        remedy=f"its objects are {known or 'not named'}",
    )


def matte_cut_out(
    depth_mm: Float32[np.ndarray, "height width"],
    image: ExrImage,
    path: Path,
    part: ExrPart,
    name: str,
) -> CutOut:
    """Objects cut out of a plate by a channel that holds their coverage, 0 to 1.

    Parameters
    ----------
    depth_mm : Over the data window of `part`.
    part : With the colours; its channels are looked at first.
    name : Of the channel, with or without the name of its part before a dot.

    Raises
    ------
    ImageError : No channel is called that.
    """
    found = matte_channel(image, path, part, name)
    samples = np.nan_to_num(depth_over_window(*found, part.data_window))
    coverage = np.clip(samples, 0, 1).astype(np.float32)
    ids = np.broadcast_to(
        np.array([_OBJECTS, _REST], np.uint32)[:, None, None], (2, *coverage.shape)
    )
    ranks = Ranks(ids, np.stack([coverage, 1 - coverage]))
    return cut_out(depth_mm, ranks, [_OBJECTS])


def matte_channel(
    image: ExrImage, path: Path, part: ExrPart, name: str
) -> tuple[ExrPart, str]:
    """The channel that `matte_cut_out` means, and its part.

    Raises
    ------
    ImageError : No channel is called that.
    """
    parts = [part, *(other for other in image.parts if other is not part)]
    found = next(
        (
            (of, own)
            for of in parts
            for own in of.channels
            if name in (own, f"{of.name}.{own}")
        ),
        None,
    )
    if found is None:
        known = ", ".join(n for of in parts for n in of.channels)
        raise ImageError(
            f"has no channel {name!r} that could be an edge matte",
            where=path,
            remedy=f"its channels are {known}",
        )
    return found


def _knows(crypto: Cryptomatte, ranks: Ranks, name: str) -> bool:
    return name in crypto.manifest or bool((ranks.ids == id_of(crypto, name)).any())


def _clean(ranks: Ranks) -> Ranks:
    with np.errstate(invalid="ignore"):
        return Ranks(ranks.ids, np.clip(np.nan_to_num(ranks.coverage), 0, 1))
