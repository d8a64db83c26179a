"""Pictures of fitted dots: photograph, model and residual, for every take.

Green channel. Every dot is shown against its own brightness, from the middle of the
field (left) outward; the residual is drawn `ENLARGED` times stronger about mid-grey.
Cells that the fit does not use, such as a neighbour's, are mid-grey too.
"""

from pathlib import Path

import numpy as np
from jaxtyping import Float

from lensfit.atomic import write_bytes_atomic
from lensfit.fitting.wavefront.fit import WavefrontFit
from lensfit.report.grey_tiles import png, sheet_of

ENLARGED = 4
_MOST_DOTS = 8
_GREEN = 1


def write_dot_pictures(
    wavefront: WavefrontFit, stems: dict[str, str], folder: Path
) -> dict[str, str]:
    """Write one PNG per take into ``folder/blur``.

    Parameters
    ----------
    stems : How the picture of each take is called, by the take's name.
    folder : The folder of results.

    Returns
    -------
    The paths, relative to `folder`, by the take's name.
    """
    stage = wavefront.stage
    dot_data, residual = stage.dot_data, stage.residual[:, _GREEN]
    background = stage.nuisance[:, _GREEN, 1]
    names = {}
    for k, photograph in enumerate(dot_data.photographs):
        mine = _from_the_middle(dot_data.dots.field_mm, dot_data.take == k)
        tiles = dot_tiles(
            dot_data.light[mine, _GREEN],
            residual[mine],
            background[mine],
            dark=photograph.take.observations.are_dark_dots,
        )
        tiles = np.where(dot_data.valid[mine, _GREEN], tiles, 0.5)
        name = f"blur/{stems[photograph.take.name]}.png"
        write_bytes_atomic(folder / name, png(sheet_of(tiles, enlarged=2)))
        names[photograph.take.name] = name
    return names


def dot_tiles(
    light: Float[np.ndarray, "dots rows columns"],
    residual: Float[np.ndarray, "dots rows columns"],
    background: Float[np.ndarray, " dots"],
    *,
    dark: bool,
) -> Float[np.ndarray, "3 dots rows columns"]:
    """Photograph, model, and half plus `ENLARGED` / 2 of their difference.

    Parameters
    ----------
    light : The photograph's; of dark dots what they take of it.
    residual : Photograph minus model.
    background : Light beside the dot.
    dark : Whether dots are dark ones.
    """
    signal = light - background[:, None, None]
    model = signal - residual
    peak = np.abs(signal).max((1, 2), keepdims=True)
    peak = np.where(peak > 0, peak, 1.0)
    sign = -1 if dark else 1
    photograph, modelled = (dark + sign * part / peak for part in (signal, model))
    left = 0.5 + sign * ENLARGED / 2 * residual / peak
    return np.stack([photograph, modelled, left])


def _from_the_middle(field_mm: np.ndarray, mine: np.ndarray) -> np.ndarray:
    """Rows of a take's dots, by distance from the axis, thinned out evenly."""
    rows = np.flatnonzero(mine)
    rows = rows[np.argsort(np.hypot(*field_mm[rows].T), kind="stable")]
    spread = np.linspace(0, len(rows) - 1, min(len(rows), _MOST_DOTS))
    return rows[np.round(spread).astype(int)]
