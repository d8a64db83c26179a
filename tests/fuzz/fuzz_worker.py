"""Reads spoiled files and says of each what came of it.

Runs as a process of its own, with an address space that is limited, so that nothing
that a file does to it harms the tests: `fuzz_run` starts it. Each file is answered
with one line of JSON on standard output. A finding is whatever is not a whole reading
or one clean `LensfitError`: another exception, more than a line, something printed by
a library, a file written, a file read that nobody named, too much time or memory.
"""

import contextlib
import ctypes
import json
import os
import random
import resource
import sys
import tempfile
import time
import traceback
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from fuzz_readers import READERS, Reader

from lensfit.errors import LensfitError
from lensfit.printable import printable

MOST_ADDRESSES = 4 << 30
MOST_CPU_S = 8.0
LONGEST_LINE = 1500
_WRITING = (
    "os.mkdir",
    "os.rename",
    "os.remove",
    "os.symlink",
    "os.link",
    "os.truncate",
)


class Watch:
    """What a reading opens, writes and prints."""

    def __init__(self, folder: Path):
        self.on = False
        self.seen: list[str] = []
        own = (
            folder,
            sys.prefix,
            sys.base_prefix,
            Path(__file__).parents[2],
            "/proc",
            "/sys",
        )
        self._fine = tuple(os.path.realpath(place) for place in own)
        # Files without a name are opened by their folder.
        self._nameless = os.path.realpath(tempfile.gettempdir())
        self._said = (folder / "printed").open("w+b", buffering=0)
        sys.addaudithook(self._hear)

    def _hear(self, event: str, arguments: tuple) -> None:
        if self.on and event in _WRITING:
            self.seen.append(f"{event}{arguments[:2]}")
        elif self.on and event == "open" and isinstance(arguments[0], (str, bytes)):
            self._opened(os.fsdecode(arguments[0]), *arguments[1:3])

    def _opened(self, path: str, mode: str | None, flags: int | None) -> None:
        place = os.path.realpath(path) if "\0" not in path else path
        changing = os.O_WRONLY | os.O_RDWR | os.O_CREAT
        writes = bool(set(mode or "") & set("wax+")) or bool((flags or 0) & changing)
        if place != self._nameless and (writes or not place.startswith(self._fine)):
            self.seen.append(f"opens {path!r} ({mode or flags})")

    @contextlib.contextmanager
    def reading(self) -> Iterator[None]:
        """Everything between is the reader's."""
        self.seen.clear()
        self._said.truncate(0)
        self._said.seek(0)
        _flush()
        kept = [os.dup(1), os.dup(2)]
        for stream in (1, 2):
            os.dup2(self._said.fileno(), stream)
        self.on = True
        try:
            yield
        finally:
            self.on = False
            _flush()
            for stream, own in zip((1, 2), kept, strict=True):
                os.dup2(own, stream)
                os.close(own)

    def printed(self) -> str:
        """What was printed while reading, whoever printed it."""
        self._said.seek(0)
        return self._said.read(2000).decode("utf-8", "replace")


def _flush() -> None:
    sys.stdout.flush()
    sys.stderr.flush()
    ctypes.CDLL(None).fflush(None)


def peak_kib() -> int:
    """Most memory that the process has held since `forget_peak`."""
    with contextlib.suppress(OSError), open("/proc/self/status") as lines:
        for line in lines:
            if line.startswith("VmHWM"):
                return int(line.split()[1])
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss


def forget_peak() -> None:
    """Begin to measure again, where the system can; else the peak only rises."""
    with contextlib.suppress(OSError):
        Path("/proc/self/clear_refs").write_text("5")


def spoiled(reader: Reader, seed: bytes, index: int) -> tuple[str, bytes]:
    """The name of what is wrong with file `index`, and the file."""
    rng = random.Random(f"{reader.name} {index}")
    mutation = reader.mutations[index % len(reader.mutations)]
    data = mutation(seed, rng)
    while rng.random() < 0.15:
        data = rng.choice(reader.mutations[:6])(data, rng)
    return mutation.__name__, data


def complaint(error: Exception) -> str | None:
    """What is wrong with an error; None for one line that says what, and where."""
    if not isinstance(error, LensfitError):
        place = traceback.extract_tb(error.__traceback__)
        own = [f for f in place if "lensfit" in f.filename and "fuzz" not in f.filename]
        at = f"{Path(own[-1].filename).name}:{own[-1].lineno}" if own else "?"
        return f"{type(error).__name__} at {at}: {' '.join(str(error).split())[:200]}"
    line = str(error)
    if line != printable(line) or len(line) > LONGEST_LINE:
        return f"says {len(line)} characters, or no text: {line[:300]!a}"
    return None


def answered(reader: Reader, path: Path, watch: Watch) -> dict[str, Any]:
    """What came of reading one file."""
    forget_peak()
    before, start = peak_kib(), time.process_time()
    outcome, says, found = "read", "", []
    with watch.reading():
        try:
            reader.read(path)
        except Exception as error:
            outcome, says = "refused", " ".join(str(error).split())[:200]
            found += [fault] if (fault := complaint(error)) else []
    cpu_s, peak = time.process_time() - start, peak_kib()
    growth_kib = peak - before
    found += watch.seen
    if printed := watch.printed():
        found.append(f"prints {printed[:300]!r}")
    if cpu_s > MOST_CPU_S:
        found.append(f"takes {cpu_s:.1f} s")
    if growth_kib > reader.most_mib << 10:
        found.append(f"takes {growth_kib >> 10} MiB")
    measured = {"cpu_s": round(cpu_s, 3), "growth_kib": growth_kib, "peak_kib": peak}
    return {"outcome": outcome, "says": says, "found": found, **measured}


def read_spoiled(
    reader: Reader, start: int, stop: int, folder: Path, watch: Watch
) -> None:
    """Spoil and read files `start` to `stop` of a kind."""
    folder.mkdir()
    seeds = {path: path.read_bytes() for path in reader.seeds(folder)}
    for path in seeds:
        reader.read(path)  # whole files are read; and what is lazy is imported
    listed = set(folder.rglob("*"))
    for index in range(start, stop):
        path = list(seeds)[index // len(reader.mutations) % len(seeds)]
        mutation, data = spoiled(reader, seeds[path], index)
        path.write_bytes(data)
        answer = answered(reader, path, watch)
        path.write_bytes(seeds[path])
        found = set(folder.rglob("*"))
        if found != listed:
            answer["found"].append("leaves or takes a file")
            listed = found
        head = {"name": reader.name, "index": index, "mutation": mutation}
        say({**head, "seed": path.name, **answer})


def say(answer: dict[str, object]) -> None:
    """One line of JSON to the process that asked."""
    sys.stdout.write(json.dumps(answer) + "\n")
    sys.stdout.flush()


def main(plan: list[tuple[str, int, int]], folder: Path) -> None:
    """Spoil and read, kind after kind, what the plan says."""
    warnings.simplefilter("ignore")
    readers = {reader.name: reader for reader in READERS}
    watch = Watch(folder)
    resource.setrlimit(resource.RLIMIT_AS, (MOST_ADDRESSES, MOST_ADDRESSES))
    for number, (name, start, stop) in enumerate(plan):
        read_spoiled(readers[name], start, stop, folder / str(number), watch)


if __name__ == "__main__":
    main(json.loads(sys.argv[1]), Path(sys.argv[2]))
