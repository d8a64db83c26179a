"""Image sequences: frame patterns, frame ranges and the names of results.

A pattern is a path whose file name holds one frame number: ``plate.####.exr`` (one
sign per digit at least), ``plate.@@@@.exr``, ``plate.%04d.exr`` or ``plate.$F4.exr``.
It may bring its range: ``plate.1001-1100####.exr``. A path without a frame number is
a single picture.

A range is a list of ``5``, ``1001-1100``, ``1-10x2`` (every second), ``1-10y2`` (all
but every second) and ``1-10:4`` (every fourth, then every second, then the others),
with negative frames, forwards or backwards: the conventions of fileseq.
"""

import re
from collections.abc import Iterable, Sequence
from pathlib import Path

from lensfit.errors import ImageError, OutputError

_TOKEN = re.compile(r"#+|@+|%0?(\d*)d|\$F(\d*)")
_RANGE = re.compile(r"(-?\d+)(?:-(-?\d+)(?:([xy:])(-?\d+))?)?")
_OWN_RANGE = re.compile(
    r"(?:(?<=[^\d-])|^)(-?\d+(?:-{1,2}\d+(?:[xy:]\d+)?)?(?:,-?\d+(?:-{1,2}\d+(?:[xy:]\d+)?)?)*)$"
)
_NUMBER = re.compile(r"(?<![vV\d])((?:(?<=[._])-)?\d{1,12})$")
_MOST_FRAMES = 10_000_000


def expand_frames(
    pattern: str | Path, frames: str | Iterable[int] | None = None
) -> list[tuple[int | None, Path]]:
    """The pictures of a sequence, in the order of their frames.

    Parameters
    ----------
    pattern : A path with or without a frame number.
    frames : A range, or frame numbers; by default every frame that exists.

    Returns
    -------
    Frame number and path of each picture; the number is None for a single picture.

    Raises
    ------
    ImageError : No frame exists, some of `frames` are missing (they are listed), or
        the pattern or range is malformed.
    """
    if frames is None and Path(pattern).is_file():  # "#" in its name is no number then
        return [(None, Path(pattern))]
    path, own = split_pattern(pattern)
    frames = own if frames is None else frames
    token = _token_of(path)
    if token is None:
        return [(None, _single(path, frames))]
    if frames is None:
        return _existing(path, token)
    numbers = parse_frames(frames) if isinstance(frames, str) else list(frames)
    pictures = [(number, frame_path(path, number)) for number in numbers]
    missing = [number for number, picture in pictures if not picture.is_file()]
    if missing:
        raise ImageError(
            f"{len(missing)} of {len(numbers)} frames are missing: "
            f"{format_frames(missing)}",
            where=path,
            remedy="give the frames that exist with --frames",
        )
    return [*pictures]


def parse_frames(text: str) -> list[int]:
    """Frame numbers of a range such as ``1-10,20-30x2``; each once, in its order.

    Raises
    ------
    ImageError : The text is no range.
    """
    numbers: dict[int, None] = {}
    for item in text.split(","):
        match = _RANGE.fullmatch(item.strip())
        if match is None:
            raise _bad_range(text)
        first = int(match[1])
        last = int(match[2]) if match[2] is not None else first
        step = int(match[4] or 1)
        if step == 0 or abs(last - first) > _MOST_FRAMES:
            raise _bad_range(text)
        numbers.update(
            dict.fromkeys(_stepped_frames(first, last, match[3] or "x", step))
        )
    return list(numbers)


def split_pattern(pattern: str | Path) -> tuple[Path, str | None]:
    """A pattern without the range that it may bring, and that range."""
    path = Path(pattern)
    token = _TOKEN.search(path.name)
    match = _OWN_RANGE.search(path.name[: token.start()]) if token else None
    if token is None or match is None or not re.search(r"\d[-,]", match[1]):
        return path, None
    name = path.name[: match.start(1)] + path.name[token.start() :]
    return path.with_name(name), match[1]


def _stepped_frames(first: int, last: int, how: str, step: int) -> list[int]:
    """A run of frames: every `step`-th, all others, or in ever finer steps."""
    way = 1 if last >= first else -1
    run = list(range(first, last + way, way))
    size = abs(step)
    if how == "y":
        return [number for at, number in enumerate(run) if at % size]
    numbers = run[::size]
    while how == ":" and size > 1:
        size = size // 2
        numbers += run[::size]
    return numbers


def format_frames(numbers: Iterable[int]) -> str:
    """Frame numbers as a short range: 1, 2, 3, 7 becomes ``1-3,7``."""
    runs: list[list[int]] = []
    for number in sorted(set(numbers)):
        if runs and number == runs[-1][1] + 1:
            runs[-1][1] = number
        else:
            runs.append([number, number])
    return ",".join(f"{a}" if a == b else f"{a}-{b}" for a, b in runs)


def frame_path(pattern: str | Path, frame: int) -> Path:
    """The path of one frame; a path without a frame number is returned as it is."""
    path = Path(pattern)
    token = _token_of(path)
    if token is None:
        return path
    sign = "-" if frame < 0 else ""
    number = f"{sign}{abs(frame):0{_padding(token)}d}"
    return path.with_name(path.name.replace(token[0], number, 1))


def frame_of(path: str | Path) -> int | None:
    """The frame number in a picture's name: the digits at its end, as in plate.1001.exr
    or plate_1001.exr; None where there are none. The number of v002 is a version."""
    match = _NUMBER.search(Path(path).stem)
    return None if match is None else int(match[1])


def sequence_name(path: str | Path) -> str:
    """The name that the frames of a sequence share: that of a picture without its
    number, or "plate" where nothing else is left."""
    path = Path(path)
    match = _NUMBER.search(path.stem)
    if match is None:
        return path.stem
    return path.stem[: match.start()].rstrip("._-") or "plate"


def is_in_frames(text: str, number: int) -> bool:
    """Whether a range such as ``1001-1050x2,1100`` has a frame.

    Raises
    ------
    ImageError : The text is no range.
    """
    return any(_item_contains(item, text, number) for item in text.split(","))


def _item_contains(item: str, text: str, number: int) -> bool:
    match = _RANGE.fullmatch(item.strip()) if len(item) < 100 else None
    if match is None or int(match[4] or 1) == 0:
        raise _bad_range(text)
    first = int(match[1])
    last = first if match[2] is None else int(match[2])
    if not min(first, last) <= number <= max(first, last):
        return False
    on_step = (number - first) % abs(int(match[4] or 1)) == 0
    return {"x": on_step, "y": not on_step}.get(match[3] or "x", True)


def output_path(source: str | Path, folder: str | Path) -> Path:
    """Where the result for a picture goes: its own name, in another folder.

    Raises
    ------
    OutputError : The result would replace its own source.
    """
    source = Path(source)
    path = Path(folder) / source.name
    if path.resolve() == source.resolve():
        raise OutputError(
            "would replace its own source", where=path, remedy="choose another folder"
        )
    return path


def _token_of(path: Path) -> re.Match | None:
    tokens = list(_TOKEN.finditer(path.name))
    if len(tokens) > 1:
        raise ImageError(
            "holds more than one frame number", where=path, remedy="leave one, as ####"
        )
    return tokens[0] if tokens else None


def _padding(token: re.Match) -> int:
    if token[0].startswith(("%", "$")):
        return int(token[1] or token[2] or 1)
    return len(token[0])


def _single(path: Path, frames: str | Iterable[int] | None) -> Path:
    if frames is not None:
        raise ImageError(
            "is a single picture, so frames cannot be chosen",
            where=path,
            remedy="write the frame number as ####",
        )
    if path.is_dir():
        raise ImageError(
            "is a folder", where=path, remedy="name the pictures in it: plate.####.exr"
        )
    if path.exists() and not path.is_file():
        raise ImageError(
            "is no ordinary file",
            where=path,
            remedy="a pipe or a device cannot be read again: give a file",
        )
    if not path.is_file():
        raise ImageError(
            "does not exist",
            where=path,
            remedy="check its path; a sequence is written as plate.####.exr",
        )
    return path


def _existing(path: Path, token: re.Match) -> list[tuple[int | None, Path]]:
    before, after = path.name[: token.start()], path.name[token.end() :]
    shape = re.compile(rf"{re.escape(before)}(-?\d+){re.escape(after)}")
    found: Sequence[Path] = ()
    if path.parent.is_dir():
        found = [p for p in path.parent.iterdir() if shape.fullmatch(p.name)]
    matches = [(int(shape.fullmatch(p.name)[1]), p) for p in found]  # pyright: ignore
    # Only names that the pattern itself would give: 001 is no frame of plate.##.exr.
    pictures = sorted(
        (n, p) for n, p in matches if frame_path(path, n).name == p.name and p.is_file()
    )
    if not pictures:
        raise ImageError(
            "no frame exists",
            where=path,
            remedy="check the folder, the name and the digits (0001 is ####)",
        )
    return [*pictures]


def _bad_range(text: str) -> ImageError:
    return ImageError(
        f"{text[:80]!r} is no range of frames", remedy="write it as 1-10,20-30x2"
    )
