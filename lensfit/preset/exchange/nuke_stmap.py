"""A Nuke script that loads the two UV maps of a lens and applies them.

Each map is read raw and given to an STMap node on its second input; the first is left
for the plate. Nodes of a script stand on a stack: the input 0 of a node is what was
pushed last.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Literal

from lensfit.preset.exchange.nuke_text import node_text, quoted


def nuke_stmap_text(
    maps: Mapping[Literal["undistort", "redistort"], Path],
    display_px: tuple[int, int],
    label: str,
) -> str:
    """Script text: for each direction a map, a place for the plate and an STMap.

    Parameters
    ----------
    maps : Files by direction, "undistort" and "redistort".
    display_px : Format of the maps.
    label : What they are, in lines.
    """
    width, height = display_px
    found = "".join(f"# {line}\n" for line in label.splitlines())
    for column, (direction, path) in enumerate(maps.items()):
        x = 220 * column
        read = {
            "inputs": "0",
            "file_type": "exr",
            "file": quoted(path.absolute().as_posix()),
            "format": f'"{width} {height} 0 0 {width} {height} 1 "',
            "raw": "true",
            "name": f"map_{direction}",
            "label": quoted(label),
            "xpos": f"{x + 110}",
            "ypos": "0",
        }
        plate = {
            "inputs": "0",
            "name": f"plate_to_{direction}",
            "label": quoted("connect the plate here"),
            "xpos": f"{x}",
            "ypos": "60",
        }
        apply = {
            "inputs": "2",
            "channels": "all",
            "uv": "rgb",
            "name": f"STMap_{direction}",
            "xpos": f"{x}",
            "ypos": "120",
        }
        found += node_text("Read", read) + node_text("NoOp", plate)
        found += node_text("STMap", apply)
    return found
