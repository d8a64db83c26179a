"""Frames for which a sidecar lacks what it states for others.

A table marks single rows as unknown where the lens was not read. The next source counts
there, and the frame jumps against its neighbours: whoever renders is told.
"""

from collections.abc import Collection, Iterator, Mapping, Sequence
from pathlib import Path

from lensfit.io.camera.table import CameraFile, FrameKey
from lensfit.plate.camera.header_source import HEADER
from lensfit.plate.camera.known import Known
from lensfit.plate.camera.spelling import SPELT, option_of
from lensfit.plate.notes import FrameNote


def lacking_notes(
    files: Sequence[tuple[int, CameraFile, Collection[str]]],
    words: Mapping[str, Sequence[Known]],
    frame: FrameKey,
    plate: Path,
) -> Iterator[FrameNote]:
    """A sentence for each quantity that a worse source tells in a sidecar's place.

    Parameters
    ----------
    files : Rank of each, the file, and the quantities that it lacks for this frame.
    words : By quantity, the word that counts most first.
    frame, plate : The frame, and its file where it has no number.
    """
    which = plate.name if frame.number is None else f"frame {frame.number}"
    for rank, file, names in files:
        for name, spelt in SPELT.items():
            known = words.get(name)
            if name not in names or not known or known[0].rank <= rank:
                continue
            yield FrameNote(
                f"{file.path.name} states no {spelt} for {which}, as it does for "
                f"others; {_shown(name, known[0])} is used ({option_of(name)} states "
                "another)",
                f"lacking {name}",
            )


def _shown(name: str, known: Known) -> str:
    value = known.value
    number = f"{value:g}" if isinstance(value, float) else str(value)
    unit = " mm" if name.endswith("_mm") else ""
    whose = " of the header" if known.rank == HEADER else ""
    return f"{known.source} ({number}{unit}){whose}"
