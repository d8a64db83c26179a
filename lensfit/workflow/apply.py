"""Put a lens on CG plates, frame after frame.

Each frame stands alone: its camera state comes from its own header, results appear
whole or not at all, finished ones are skipped, and a frame that fails is
reported while the others go on. `frame_renderer` says what happens to a frame.
"""

import time
from dataclasses import dataclass, field
from pathlib import Path

from lensfit.errors import ImageError, LensfitError
from lensfit.io.exr import write_exr
from lensfit.io.sequence import expand_frames, frame_path, output_path, parse_frames
from lensfit.preset.schema import Preset
from lensfit.progress import Progress, silent
from lensfit.workflow.frame_renderer import ApplyOptions, FrameRenderer


@dataclass
class Applied:
    """What became of each frame.

    Attributes
    ----------
    written, skipped : Results made now, and found finished.
    failures : One line for each frame that failed, naming its file.
    notes : What the user should know, each once.
    seconds : Time for all frames together.
    """

    written: list[Path] = field(default_factory=list)
    skipped: list[Path] = field(default_factory=list)
    failures: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    seconds: float = 0.0


def apply_preset(
    preset: Preset,
    plates: str | Path,
    out_dir: str | Path,
    *,
    frames: str | None = None,
    options: ApplyOptions | None = None,
    progress: Progress = silent,
) -> Applied:
    """Render a plate or a sequence through a lens.

    Parameters
    ----------
    preset : The measured lens.
    plates : An EXR file, or a pattern such as ``plate.####.exr``.
    out_dir : Folder for the results, which keep their names.
    frames : A range such as ``1001-1100``; every frame that exists if None.
    options : How; the defaults if None.
    progress : Told about each finished frame.

    Raises
    ------
    LensfitError : Nothing can be rendered at all: no frame exists, the range is
        malformed or the external map cannot be used. Failures of single frames are
        returned, not raised.
    """
    start = time.perf_counter()
    options = options or ApplyOptions()
    pictures = _pictures(plates, frames)
    renderer = FrameRenderer(preset, options)
    applied = Applied(notes=renderer.notes)
    for done, path in enumerate(pictures):
        progress("frames", done, len(pictures))
        try:
            target = output_path(path, out_dir)
            if target.is_file() and not options.overwrite:
                renderer.note_if_made_otherwise(path, target)
                applied.skipped.append(target)
                continue
            write_exr(target, renderer.render(path))
            applied.written.append(target)
        except LensfitError as error:
            applied.failures.append(str(_at(error, path)))
        except (ValueError, MemoryError, ArithmeticError) as error:
            reason = " ".join(f"{type(error).__name__}: {error}".split())
            applied.failures.append(str(ImageError(reason, where=path)))
    progress("frames", len(pictures), len(pictures))
    applied.seconds = time.perf_counter() - start
    return applied


def _pictures(plates: str | Path, frames: str | None) -> list[Path]:
    """Files to render; those of a stated range that do not exist fail on their own."""
    if frames is None:
        return [path for _, path in expand_frames(plates)]
    numbers = parse_frames(frames)
    paths = list(dict.fromkeys(frame_path(plates, number) for number in numbers))
    if not any(path.is_file() for path in paths):
        return [path for _, path in expand_frames(plates, frames)]  # says what lacks
    return paths


def _at(error: LensfitError, path: Path) -> LensfitError:
    """The error with the frame it happened at."""
    if error.where is not None:
        if Path(error.where) == path:
            return error
        return LensfitError(
            f"{error.where}: {error.what}", where=path, remedy=error.remedy
        )
    return type(error)(error.what, where=path, remedy=error.remedy)
