"""Notes for the user: on frames, each given once, and on a sequence as a whole.

The same often holds for many frames of a sequence, perhaps with other numbers, and
deserves one line: notes of one topic are one note, from any frame and process.

What holds of a sequence as a whole no single frame shows. Frames that are missing
between others are likelier lost than left out, and a frame of another size is likelier
from another render; both are rendered as they are, and noted.
"""

import itertools
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import final


@final
class FrameNote(str):
    """One sentence that begins with the name of a frame.

    Attributes
    ----------
    topic : What it is about, the same for every frame.
    """

    topic: str

    def __new__(cls, sentence: str, topic: str = "") -> "FrameNote":
        """Pickled with its topic, as any attribute is."""
        note = super().__new__(cls, sentence)
        note.topic = topic
        return note


def topic_of(note: str) -> str:
    """What a remark is about: that of most remarks is all that they say."""
    return note.topic if isinstance(note, FrameNote) else note


def notes_of_new_topics(notes: Iterable[str], said: Iterable[str]) -> list[str]:
    """The remarks whose topics are new, one of each."""
    topics = {topic_of(note) for note in said}
    found = []
    for note in notes:
        if topic_of(note) not in topics:
            topics.add(topic_of(note))
            found.append(note)
    return found


@final
class Notes:
    """Sentences for the user, each said once; of a topic the first one.

    Attributes
    ----------
    said : In the order they came.
    """

    def __init__(self):
        self.said: list[str] = []

    def add(self, *notes: str | None) -> None:
        """Say these too; None is nothing to say."""
        self.said += notes_of_new_topics(filter(None, notes), self.said)


_MOST_RUNS = 12
"""That are listed; a sequence with more holes is no list to read."""
_LEAST_STEPPED = 3
"""Frames at even steps, before they are taken for every second, third ..."""


def gaps_note(pattern: str | Path, numbers: Sequence[int]) -> str | None:
    """Which frames are missing between the first and the last one.

    Parameters
    ----------
    pattern : Of the sequence.
    numbers : Of the frames that exist, rising.
    """
    pairs = [(a, b) for a, b in itertools.pairwise(numbers) if b - a > 1]
    if not pairs:
        return None
    first, last = numbers[0], numbers[-1]
    lost = last - first + 1 - len(numbers)
    which = f"frames {_range(numbers, pairs)} are missing"
    if lost == 1:
        which = f"frame {_range(numbers, pairs)} is missing"
    return (
        f"{pattern}: {which} between {first} and {last}; --frames says which are wanted"
    )


def _range(numbers: Sequence[int], pairs: Sequence[tuple[int, int]]) -> str:
    """Frames between the pairs, as fileseq writes them: 17,20-22 or, of a sequence on
    twos, 1-99y2."""
    steps = {b - a for a, b in pairs}
    if (
        len(numbers) >= _LEAST_STEPPED
        and len(pairs) == len(numbers) - 1
        and len(steps) == 1
    ):
        return f"{numbers[0]}-{numbers[-1]}y{steps.pop()}"
    runs = [
        f"{a + 1}" if b - a == 2 else f"{a + 1}-{b - 1}" for a, b in pairs[:_MOST_RUNS]
    ]
    more = len(pairs) - len(runs)
    return ",".join(runs) + (f" and {more} more ranges" if more else "")


def sizes_note(sizes: Iterable[tuple[Path, tuple[int, int] | None]]) -> str | None:
    """Whether a frame has another size than the first one.

    Parameters
    ----------
    sizes : Plates in order, with width and height of their display windows, pixels;
        None where it is not known, as of a frame that failed.
    """
    known = [(plate, size) for plate, size in sizes if size is not None]
    others = [(plate, size) for plate, size in known if size != known[0][1]]
    if not others:
        return None
    plate, size = others[0]
    first, wanted = known[0]
    more = f" (and of {len(others) - 1} more another)" if len(others) > 1 else ""
    return (
        f"{plate.name}: the display window is {size[0]} x {size[1]} pixels{more}, that "
        f"of {first.name} {wanted[0]} x {wanted[1]}; each frame is rendered in its own"
    )
