"""A sequence as a job of a render farm: the same command on chunks of its frames.

The command is `lensfit apply` with every option it was given. Paths that a farm may map
to other places on another machine (preset, plates, results, files among the options)
are kept apart from plain words and numbers. Nothing here is ever read by a shell.
"""

import itertools
import math
import os
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

from lensfit.errors import ImageError, OutputError, PresetError
from lensfit.io.sequence import (
    expand_frames,
    format_frames,
    frame_path,
    output_path,
    parse_frames,
    split_pattern,
)
from lensfit.plate.notes import gaps_note

_CONTROL = re.compile(r"[\x00-\x1f\x7f-\x9f]")


class HandedOption(NamedTuple):
    """An option of the command, as it was given.

    Attributes
    ----------
    word : Such as ``--depth-unit``.
    values : What follows it, nothing after a flag; paths are read, not written.
    """

    word: str
    values: tuple[str | int | float | Path, ...]


class HostNeeds(NamedTuple):
    """What a task needs of the host that runs it.

    Attributes
    ----------
    cores : That it takes at most.
    gib : Of memory that it takes at most.
    """

    cores: int
    gib: float

    @property
    def mib(self) -> int:
        """Memory in whole MiB, not less than it is."""
        return math.ceil(self.gib * 1024)


@dataclass(frozen=True)
class FarmJob:
    """What a farm is asked to do; all paths are absolute.

    Attributes
    ----------
    preset : The measured lens.
    plates : One plate, or the pattern of a sequence (without a range).
    out : Folder of the results.
    chunks : Ranges of frames, one for each task; empty for a single plate.
    options : Of ``lensfit apply``, in order.
    missing : Frames that are requested and do not exist (yet).
    needs : Of each task, if anything is known of it.
    gaps : A sentence where nothing was requested, and some lack between those found.
    """

    preset: Path
    plates: Path
    out: Path
    chunks: tuple[str, ...]
    options: tuple[HandedOption, ...] = ()
    missing: str = ""
    gaps: str | None = None
    needs: HostNeeds | None = None

    @property
    def name(self) -> str:
        """A name for people: what is rendered, without what templates would read."""
        plain = re.sub(r"[^\w .#%@$+-]+", "_", self.plates.name)
        return f"lensfit apply {plain}"[:100]

    def arguments(self, frames: str | None) -> list[str]:
        """The command for one chunk, or for a single plate, word by word."""
        words = ["lensfit", "apply", str(self.preset), str(self.plates)]
        words.append(f"--out={self.out}")
        words += [] if frames is None else [f"--frames={frames}"]
        for option in self.options:
            words += option_words(option, [str(v) for v in option.values])
        return words


def option_words(option: HandedOption, values: Sequence[str]) -> list[str]:
    """An option with its values, so that none of them can be taken for an option."""
    if len(values) == 1:
        return [f"{option.word}={values[0]}"]
    return [option.word, *values]


def farm_job(
    preset: Path,
    plates: str,
    out: Path,
    frames: str | None = None,
    *,
    chunk: int = 10,
    options: Iterable[HandedOption] = (),
    preset_beside: Path | None = None,
) -> FarmJob:
    """The job, once it is sure that its inputs exist.

    Parameters
    ----------
    chunk : Frames of a task; a task keeps the lens' maps and kernels between them.
    preset_beside : Where the caller is about to write the preset for this job alone; it
        reads `preset` itself if None.

    Raises
    ------
    PresetError : There is no preset.
    ImageError : No frame exists, or a file among the options does not.
    OutputError : Results would replace their plates, or a word holds a control
        character.
    """
    if not preset.is_file():
        raise PresetError("does not exist", where=preset, remedy="give a preset.json")
    pattern, own = split_pattern(plates)
    requested = own if frames is None else frames
    numbers, missing = _frames(pattern, requested)
    job = FarmJob(
        absolute(preset_beside or preset),
        absolute(pattern),
        absolute(out),
        tuple(_range(numbers[at : at + chunk]) for at in range(0, len(numbers), chunk)),
        tuple(_absolute(option) for option in options),
        missing,
        gaps_note(pattern, numbers) if requested is None else None,
    )
    output_path(job.plates, job.out)
    for word in job.arguments(None):
        if _CONTROL.search(word):
            raise OutputError(
                f"{word!r} holds a line break or another control character",
                remedy="rename it: farms and logs keep one line per word",
            )
    return job


def with_needs(job: FarmJob, needs: HostNeeds | None) -> FarmJob:
    """The job with what each task needs, and no task taking more cores than that."""
    if needs is None:
        return job
    cores = HandedOption("--cores", (needs.cores,))
    others = tuple(option for option in job.options if option.word != cores.word)
    return replace(job, options=(*others, cores), needs=needs)


def absolute(path: Path) -> Path:
    """The path from the root, links kept as they are."""
    return Path(os.path.abspath(path))


def _frames(pattern: Path, frames: str | None) -> tuple[list[int], str]:
    """Frame numbers, and those of them that lack a plate, as a range."""
    if frames is None:
        return [n for n, _ in expand_frames(pattern) if n is not None], ""
    numbers = parse_frames(frames)
    missing = [n for n in numbers if not frame_path(pattern, n).is_file()]
    single = frame_path(pattern, 0) == frame_path(pattern, 1)
    if single or len(missing) == len(numbers):
        expand_frames(pattern, frames)  # says what is wrong
    return numbers, format_frames(missing)


def _range(numbers: Sequence[int]) -> str:
    """Frame numbers in order, as ``1001-1010``, ``1-19x2`` or a list."""
    steps = {b - a for a, b in itertools.pairwise(numbers)}
    if len(steps) == 1 and (step := steps.pop()) != 1:
        way = "" if abs(step) == 1 else f"x{abs(step)}"
        return f"{numbers[0]}-{numbers[-1]}{way}"
    return format_frames(numbers)


def _absolute(option: HandedOption) -> HandedOption:
    """The option with paths from the root, which must exist."""
    for value in option.values:
        if isinstance(value, Path) and not value.exists():
            what = f"does not exist ({option.word})"
            raise ImageError(what, where=value, remedy="check its path")
    values = (absolute(v) if isinstance(v, Path) else v for v in option.values)
    return option._replace(values=tuple(values))
