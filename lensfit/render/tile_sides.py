"""How large the tiles are in which blur is convolved, and what surrounds them."""

from lensfit.errors import LensfitError
from lensfit.render.field_grid import FieldGrid

_TILES = ((14, 64), (56, 128), (1000, 256))
"""Largest reach of a kernel, px, and the tile that goes with it."""
_LEAST_TILE = 16


def refuse_too_wide(reach_px: float) -> None:
    """Say that blur of this reach is not convolved, if it is not.

    Raises
    ------
    LensfitError : It is too wide.
    """
    if not reach_px <= _TILES[-1][0]:
        raise LensfitError(
            f"blur reaches {reach_px:.4g} px, and {_TILES[-1][0]} px is the most",
            remedy="check f-number, focus distance, and the unit and the nearest "
            "pixels of the depth; or limit the blur (--maximum-blur-percent)",
        )


def tiling(grid: FieldGrid, reaches: dict[int, int]) -> tuple[int, dict[int, int]]:
    """Side of the tiles, and their room for each level that is blurred.

    Parameters
    ----------
    reaches : Of the kernels of each such level, px.

    Raises
    ------
    LensfitError : A kernel is too wide to convolve.
    """
    tile = _tile_px(max(reaches.values(), default=0))
    if grid.varies:  # the weights of a cell's nodes hold in that cell
        widest = _LEAST_TILE * int(min(grid.cell_px) // _LEAST_TILE)
        tile = max(min(tile, widest), _LEAST_TILE)
    return tile, {n: _room_px(tile, reach) for n, reach in reaches.items()}


def _tile_px(longest: int) -> int:
    """Side of the tiles in which kernels of this reach are convolved."""
    refuse_too_wide(longest)
    return next(side for reach, side in _TILES if longest <= reach)


def _room_px(tile: int, reach: int) -> int:
    """Side of a tile with its surroundings, from a few that transform fast."""
    margin = 4
    while margin < reach:
        margin *= 2
    if margin >= 16 and 3 * margin // 4 >= reach:
        margin = 3 * margin // 4
    return tile + 2 * margin
