"""Remove a lens from photographed plates, and write the remaining pinhole camera.

The run is that of `lensfit.workflow.apply`: frames are independent, appear whole or not
at all, and are skipped where they are finished. Beside them lies one JSON file with the
pinhole camera of every frame (`lensfit.plate.frame.straight_plate.Pinhole`), read
from the headers of the results, so that a run that was resumed has all of them.
"""

import json
from pathlib import Path

from lensfit.atomic import write_text_atomic
from lensfit.io.exr import read_exr
from lensfit.io.exr_views import views_of
from lensfit.io.sequence import frame_of
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
    cameras = [
        {"file": path.name, "frame": frame_of(path), **camera}
        for path in done
        for camera in _cameras(path)
    ]
    path = Path(out_dir) / f"{_stem(done[0])}{CAMERA_SUFFIX}"
    tables = {"pixels": _CONVENTION, "lens": preset.lens.name, "cameras": cameras}
    write_text_atomic(path, json.dumps(tables, indent=1) + "\n")
    return applied, path


_CONVENTION = (
    "Pixel (column 0, row 0) of the display window covers [0, 1) x [0, 1), row 0 on top"
)


def _cameras(path: Path) -> list[dict]:
    """Of each view of a straight picture."""
    found = []
    for view in views_of(read_exr(path, header_only=True)):
        texts = (p.attributes.get(PINHOLE) for p in view.image.parts)
        text = next((str(t) for t in texts if t is not None), None)
        if text is not None:
            named = {"view": view.name} if view.name else {}
            found.append(named | json.loads(text))
    return found


def _stem(path: Path) -> str:
    """The name of a sequence: that of its first frame without the number."""
    number = frame_of(path)
    if number is None:
        return path.stem
    return path.stem.rstrip("0123456789").rstrip("._-") or "plate"
