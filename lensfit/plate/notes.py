"""Notes on frames for the user, each given once.

The same often holds for many frames of a sequence, perhaps with other numbers, and
deserves one line: notes of one topic are one note, from any frame and process.
"""

from collections.abc import Iterable
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
