"""Starts the process that reads spoiled files, and survives what they do to it.

A process that dies, or says nothing for too long, is a finding against the file that it
was reading; another one goes on with the next.
"""

import json
import os
import queue
import subprocess
import sys
import threading
from dataclasses import dataclass, field
from pathlib import Path

WORKER = Path(__file__).with_name("fuzz_worker.py")
LONGEST_WAIT_S = 120.0
"""For one file, and for a process to start; machines may be busy."""

Plan = list[tuple[str, int, int]]


@dataclass
class Tally:
    """What came of the files of a plan.

    Attributes
    ----------
    read, refused : How many, by the name of the reader.
    findings : One line for each file that was not answered as it should be.
    peak_kib : Most memory that a process held.
    most_growth_kib, most_cpu_s : Most that one file took.
    """

    read: dict[str, int] = field(default_factory=dict)
    refused: dict[str, int] = field(default_factory=dict)
    findings: list[str] = field(default_factory=list)
    peak_kib: int = 0
    most_growth_kib: int = 0
    most_cpu_s: float = 0.0

    def add(self, answer: dict) -> None:
        """One file's answer."""
        counts = self.read if answer["outcome"] == "read" else self.refused
        counts[answer["name"]] = counts.get(answer["name"], 0) + 1
        self.peak_kib = max(self.peak_kib, answer["peak_kib"])
        self.most_growth_kib = max(self.most_growth_kib, answer["growth_kib"])
        self.most_cpu_s = max(self.most_cpu_s, answer["cpu_s"])
        for what in answer["found"]:
            file = f"{answer['name']} {answer['index']} ({answer['mutation']}"
            self.findings.append(f"{file} of {answer['seed']}): {what}")

    @property
    def files(self) -> int:
        """How many were answered."""
        return sum(self.read.values()) + sum(self.refused.values())


def run(plan: Plan, folder: Path, worker: Path | None = None) -> Tally:
    """Spoil and read files, in as many processes as it takes."""
    tally, left, attempt = Tally(), list(plan), 0
    while left:
        own = folder / f"process{attempt}"
        own.mkdir()
        done, end = _run_once(left, own, tally, worker or WORKER)
        attempt += 1
        while left and done >= left[0][2] - left[0][1]:
            done -= left[0][2] - left[0][1]
            left.pop(0)
        if left:
            name, start, stop = left[0]
            tally.findings.append(f"{name} {start + done}: {end}")
            left[0] = (name, start + done + 1, stop)
            if start + done + 1 >= stop:
                left.pop(0)
    return tally


def _run_once(plan: Plan, folder: Path, tally: Tally, worker: Path) -> tuple[int, str]:
    """How many files were answered, and how the process ended."""
    threads = {f"{n}_NUM_THREADS": "1" for n in ("OPENBLAS", "OMP", "MKL")}
    with (folder / "stderr").open("w+b") as errors:
        process = subprocess.Popen(
            [sys.executable, str(worker), json.dumps(plan), str(folder)],
            stdout=subprocess.PIPE,
            stderr=errors,
            cwd=folder,
            env=os.environ | threads,
            text=True,
        )
        lines = _lines_of(process)
        done, end = 0, None
        while end is None:
            try:
                line = lines.get(timeout=LONGEST_WAIT_S)
            except queue.Empty:
                process.kill()
                end = f"nothing for {LONGEST_WAIT_S:g} s"
                break
            if line is None:
                end = f"the process ended with {process.wait()}"
            else:
                tally.add(json.loads(line))
                done += 1
        process.wait()
        errors.seek(0)
        return done, f"{end}: {errors.read()[-600:].decode('utf-8', 'replace')}"


def _lines_of(process: subprocess.Popen) -> "queue.Queue[str | None]":
    """Lines as they come; None when there are no more."""
    lines: queue.Queue[str | None] = queue.Queue()

    def pass_on() -> None:
        assert process.stdout is not None
        with process.stdout as stream:
            for line in stream:
                lines.put(line)
        lines.put(None)

    threading.Thread(target=pass_on, daemon=True).start()
    return lines
