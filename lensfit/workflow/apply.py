"""Apply a lens to CG plates, frame after frame.

Each frame is independent: its camera state comes from its own header, and its result
appears whole or not at all. Frames that are finished as they would be rendered now are
skipped, and a frame that fails is reported while the others go on. `frame.renderer`
describes the rendering of a frame.
"""

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Protocol

from lensfit.atomic import remove_abandoned
from lensfit.errors import ImageError, LensfitError
from lensfit.io.sequence import (
    expand_frames,
    frame_of,
    frame_path,
    output_path,
    parse_frames,
    split_pattern,
)
from lensfit.plate.apply_options import ApplyOptions
from lensfit.plate.frame.frame_outcome import (
    FrameOutcome,
    apply_frame,
    error_line,
    worker_outcomes,
)
from lensfit.plate.frame.renderer import FrameRenderer
from lensfit.plate.notes import gaps_note, notes_of_new_topics, sizes_note
from lensfit.preset.schema import Preset
from lensfit.progress import Progress, silent


class FrameDone(Protocol):
    """Called after each frame, in the order in which they end."""

    def __call__(
        self, plate: Path, outcome: FrameOutcome, done: int, total: int
    ) -> None:
        """`outcome` became of `plate`; `done` of `total` frames have ended."""
        ...


@dataclass
class Applied:
    """What became of each frame.

    Attributes
    ----------
    written, skipped : Results made now, and found finished as they would be made now.
    failures : One line for each frame that failed, naming its file.
    notes : What the user should know, each once.
    seconds : Time for all frames together.
    """

    written: list[Path] = field(default_factory=list)
    skipped: list[Path] = field(default_factory=list)
    failures: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    seconds: float = 0.0


def apply(
    preset: Preset,
    plates: str | Path,
    out_dir: str | Path,
    *,
    frames: str | None = None,
    options: ApplyOptions | None = None,
    workers: int = 1,
    progress: Progress = silent,
    frame_done: FrameDone | None = None,
) -> Applied:
    """Render a plate or a sequence through a lens.

    Parameters
    ----------
    preset : The measured lens.
    plates : An EXR file, or a pattern such as ``plate.####.exr``.
    out_dir : Folder for the results, which keep their names.
    frames : A range such as ``1001-1100``; every frame that exists if None.
    options : How; the defaults if None.
    workers : Processes that render frames, each in memory of its own; 1 renders in
        this one.
    progress : Called after each finished frame.
    frame_done : Called with the outcome of each frame.

    Raises
    ------
    LensfitError : Nothing can be rendered at all: no frame exists, the range is
        malformed or the external map cannot be used. Failures of single frames are
        returned, not raised.
    ValueError : Fewer than one worker.
    """
    if workers < 1:
        raise ValueError(f"{workers} workers render nothing")
    start = time.perf_counter()
    options = options or ApplyOptions()
    pattern, own = split_pattern(plates)
    stated = own if frames is None else frames
    pictures, gaps = _pictures(pattern, stated)
    outcomes: list[FrameOutcome | None] = [None] * len(pictures)
    progress("frames", 0, len(pictures))
    with _outcomes(preset, options, pictures, Path(out_dir), workers) as finished:
        for done, (index, found) in enumerate(finished, 1):
            outcome = _named_if_absent(found, pictures[index], stated)
            outcomes[index] = outcome
            if frame_done is not None:
                frame_done(pictures[index], outcome, done, len(pictures))
            progress("frames", done, len(pictures))
    applied = Applied(notes=gaps, seconds=time.perf_counter() - start)
    finished = [(p, o) for p, o in zip(pictures, outcomes, strict=True) if o]
    for _, outcome in finished:
        _gather(applied, outcome)
    sizes = sizes_note((path, outcome.size_px) for path, outcome in finished)
    applied.notes += [] if sizes is None else [sizes]
    return applied


@contextmanager
def _outcomes(
    preset: Preset, options: ApplyOptions, pictures: list[Path], out: Path, workers: int
) -> Iterator[Iterator[tuple[int, FrameOutcome]]]:
    """Frames as they are finished, with their place in the list."""
    renderer = FrameRenderer(preset, options)  # a bad map fails here, and only once
    targets = [_target(path, out) for path in pictures]
    if workers == 1 or len(pictures) < 2:
        yield (
            (index, target)
            if isinstance(target, FrameOutcome)
            else (index, apply_frame(renderer, path, target))
            for index, (path, target) in enumerate(zip(pictures, targets, strict=True))
        )
        return
    with worker_outcomes(
        preset, options, pictures, targets, min(workers, len(pictures))
    ) as found:
        yield found


def _target(path: Path, out: Path) -> Path | FrameOutcome:
    """Where a result goes, cleared of what a killed run left there."""
    try:
        target = output_path(path, out)
    except LensfitError as error:
        return FrameOutcome(failure=error_line(error, path))
    remove_abandoned(target)
    return target


def _gather(applied: Applied, outcome: FrameOutcome) -> None:
    if outcome.failure is not None:
        applied.failures.append(outcome.failure)
    elif outcome.target is not None:
        (applied.skipped if outcome.skipped else applied.written).append(outcome.target)
    applied.notes += notes_of_new_topics(outcome.notes, applied.notes)


def _pictures(pattern: Path, frames: str | None) -> tuple[list[Path], list[str]]:
    """Files to render, and a note where some are missing between those that exist;
    those of a stated range that do not exist fail on their own."""
    if frames is None:
        found = expand_frames(pattern)
        gaps = gaps_note(pattern, [n for n, _ in found if n is not None])
        return [path for _, path in found], [] if gaps is None else [gaps]
    numbers = parse_frames(frames)
    paths = list(dict.fromkeys(frame_path(pattern, number) for number in numbers))
    single = frame_path(pattern, 0) == frame_path(pattern, 1)
    if single or not any(path.is_file() for path in paths):
        paths = [path for _, path in expand_frames(pattern, frames)]  # says what lacks
    return paths, []


def _named_if_absent(
    outcome: FrameOutcome, path: Path, frames: str | None
) -> FrameOutcome:
    """The failure of a frame that is not there, in words of the range that has it. One
    that appears before its turn is rendered, so this is known afterwards only."""
    if outcome.failure is None or frames is None or path.exists():
        return outcome
    absent = ImageError(
        f"frame {frame_of(path)} of the stated frames {frames} does not exist",
        where=path,
        remedy="render it first, or leave it out of the range (--frames)",
    )
    return replace(outcome, failure=str(absent))
