"""Remove a lens from photographed plates, and write the remaining pinhole camera.

The run is that of `lensfit.workflow.apply`: frames are independent, appear whole or not
at all, and are skipped where they are finished. Beside them lies one JSON file with the
pinhole camera of every frame (`lensfit.plate.frame.straight_plate.Pinhole`), read from
the headers of all results of that name in the folder: the chunks of a farm write the
same file, and the last one finds the frames of all others.
"""

import json
from pathlib import Path

from lensfit.atomic import write_folder_summary
from lensfit.errors import ImageError
from lensfit.io.exr import read_exr
from lensfit.io.exr_views import views_of
from lensfit.io.sequence import frame_of, sequence_name
from lensfit.plate.apply_options import ApplyOptions
from lensfit.plate.frame.straight_plate import PINHOLE
from lensfit.preset.schema import Preset
from lensfit.progress import Progress, silent
from lensfit.workflow.apply import Applied, FrameDone, apply

CAMERA_SUFFIX = ".camera.json"


def undistort_plates(
    preset: Preset,
    plates: str | Path,
    out_dir: str | Path,
    *,
    options: ApplyOptions,
    frames: str | None = None,
    workers: int = 1,
    progress: Progress = silent,
    frame_done: FrameDone | None = None,
) -> tuple[Applied, Path | None]:
    """Straighten a plate or a sequence.

    Parameters
    ----------
    options : With the output "undistorted".
    plates, out_dir, frames, workers, progress, frame_done : As `apply`.

    Returns
    -------
    What became of each frame, and the file of their cameras; None if all failed.

    Raises
    ------
    LensfitError : As `apply`.
    ValueError : The options are for another output.
    """
    if options.output != "undistorted":
        raise ValueError(f"options for {options.output!r} straighten nothing")
    applied = apply(
        preset,
        plates,
        out_dir,
        frames=frames,
        options=options,
        workers=workers,
        progress=progress,
        frame_done=frame_done,
    )
    done = sorted(applied.written + applied.skipped)
    if not done:
        return applied, None
    folder, stem = Path(out_dir), sequence_name(done[0])
    path = folder / f"{stem}{CAMERA_SUFFIX}"
    headers = _Headers()
    write_folder_summary(path, lambda: _summary(folder, stem, headers))
    return applied, path


_CONVENTION = (
    "Pixel (column 0, row 0) of the display window covers [0, 1) x [0, 1), row 0 on top"
)


def _summary(folder: Path, stem: str, headers: "_Headers") -> str:
    """The cameras of all straight pictures of a name."""
    files = (p for p in folder.iterdir() if p.suffix.lower() == ".exr")
    named = (p for p in files if p.name[0] != "." and sequence_name(p) == stem)
    cameras = [
        {"file": path.name, "frame": frame_of(path), **camera}
        for path in sorted(named, key=lambda p: (frame_of(p) or 0, p.name))
        for camera in headers.cameras(path)
    ]
    return json.dumps({"pixels": _CONVENTION, "cameras": cameras}, indent=1) + "\n"


class _Headers:
    """Reads the cameras of straight pictures, each file once."""

    def __init__(self):
        self._read: dict[tuple, list[dict]] = {}

    def cameras(self, path: Path) -> list[dict]:
        """Of each view of a picture; none of one that is not straight, or damaged."""
        try:
            stat = path.stat()
            key = path, stat.st_mtime_ns, stat.st_size, stat.st_ino
            if key not in self._read:
                self._read[key] = _cameras(path)
            return self._read[key]
        except (ImageError, OSError, ValueError):
            return []


def _cameras(path: Path) -> list[dict]:
    """Of each view of a straight picture."""
    found = []
    for view in views_of(read_exr(path, header_only=True)):
        headers = (p.attributes for p in view.image.parts if PINHOLE in p.attributes)
        if (header := next(headers, None)) is not None:
            named = {"view": view.name} if view.name else {}
            lens = {"lens": header.get("lensModel")}
            found.append(named | lens | json.loads(str(header[PINHOLE])))
    return found
