"""A redistort map from a file, in place of the lens' own distortion.

The map was written for a plate of the same size. Its window is in the pixel space of
its own display window, and is moved to that of the plate.
"""

from dataclasses import dataclass
from pathlib import Path

from lensfit.coords import Window
from lensfit.errors import ImageError
from lensfit.io.stmap import Stmap, read_stmap
from lensfit.rendering.uv import SourceMap


@dataclass(frozen=True, eq=False)
class ExternalMap:
    """A map and the file that it came from."""

    path: Path
    stmap: Stmap

    @classmethod
    def read(cls, path: Path) -> "ExternalMap":
        """The map of a file, which must not be one that takes distortion off.

        Raises
        ------
        ImageError : It is an undistort map, or none at all.
        """
        found = read_stmap(path)
        if found.attributes.get("lensfit/map") == "undistort":
            raise ImageError(
                "is an undistort map, and a plate needs the redistort map",
                where=path,
                remedy="give the file of the same name that ends in redistort.exr",
            )
        return cls(path, found)

    def window(self, display: Window) -> Window:
        """The pixels of a plate that the map knows."""
        made, own = self.stmap.display_window, self.stmap.data_window
        dx, dy = display.x_min - made.x_min, display.y_min - made.y_min
        return Window(own.x_min + dx, own.y_min + dy, own.x_max + dx, own.y_max + dy)

    def source_map(self, display: Window, window: Window) -> SourceMap:
        """The map over `window`, in the plate's own pixel space.

        Raises
        ------
        ImageError : The map is for another size, or does not cover the window.
        """
        made = self.stmap.display_window
        size, wanted = (made.width, made.height), (display.width, display.height)
        if size != wanted:
            raise ImageError(
                f"is a map for {size[0]} x {size[1]}, the plate is "
                f"{wanted[0]} x {wanted[1]}",
                where=self.path,
                remedy="write the map at the size of the plate",
            )
        known = SourceMap.from_uv(self.stmap.uv, self.window(display), display)
        try:
            return known.cropped(window)
        except ValueError as error:
            raise ImageError(
                "does not cover the pixels to render",
                where=self.path,
                remedy="write the map with the overscan of the plate",
            ) from error
