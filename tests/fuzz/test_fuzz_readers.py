"""Whatever a file holds: it is read, or refused in one line; nothing else happens.

`fuzz_readers` lists the readers and `fuzz_worker` says what counts as a finding.
"""

import os
from pathlib import Path

import pytest
from fuzz_readers import READERS, Reader
from fuzz_run import WORKER, Plan, Tally, run

pytestmark = pytest.mark.skipif(
    os.name == "nt", reason="limits of a process are set as POSIX does"
)

FEWEST_FILES = 10_000


def assert_nothing_was_found(tally: Tally, plan: Plan) -> None:
    assert tally.findings == []
    assert tally.files == sum(stop - start for _, start, stop in plan)


def test_each_kind_of_damage_to_each_kind_of_file(tmp_path: Path):
    plan = [(r.name, 0, len(r.mutations)) for r in READERS]
    tally = run(plan, tmp_path)
    assert_nothing_was_found(tally, plan)
    assert set(tally.refused) == {r.name for r in READERS} - {"raw header"}


@pytest.mark.slow
@pytest.mark.parametrize("reader", READERS, ids=lambda reader: reader.name)
def test_many_spoiled_files(tmp_path: Path, reader: Reader):
    plan = [(reader.name, 0, reader.files)]
    tally = run(plan, tmp_path)
    assert_nothing_was_found(tally, plan)
    assert tally.read[reader.name] > 0


def test_all_together_are_enough():
    assert sum(reader.files for reader in READERS) >= FEWEST_FILES
    assert len({reader.name for reader in READERS}) == len(READERS)


PLANTED = {
    "raise KeyError(path.name)": "KeyError at",
    "raise Odd('a\\nb')": "or no text",
    "raise LensfitError('is bad', where=path)": None,
    "print('look')": "prints 'look",
    "path.with_name('x').write_text('')": "leaves or takes a file",
    "open('/etc/hostname').close()": "opens '/etc/hostname'",
    "bytearray(400 << 20)": "MiB",
    "bytearray(5 << 30)": "MemoryError at",
    "os.abort()": "the process ended with -6",
}
"""What a reader might do, and what is said of it; nothing if that is right."""


def test_planted_faults_are_found(tmp_path: Path):
    planted = tmp_path / "planted.py"
    planted.write_text(
        f"import json, os, sys\nsys.path.insert(0, {str(WORKER.parent)!r})\n"
        "import fuzz_worker\nfrom pathlib import Path\n"
        "from lensfit.errors import LensfitError\n"
        "class Odd(LensfitError):\n    def __str__(self):\n        return self.what\n"
        f"faults = ['pass', *{list(PLANTED)!r}]\n"
        "def read(path):\n    exec(faults.pop(0))\n"
        "reader = next(r for r in fuzz_worker.READERS if r.name == 'chan')\n"
        "fuzz_worker.READERS = (reader._replace(read=read),)\n"
        "fuzz_worker.main(json.loads(sys.argv[1]), Path(sys.argv[2]))\n"
    )
    tally = run([("chan", 0, len(PLANTED))], tmp_path, planted)
    for index, expected in enumerate(PLANTED.values()):
        said = [line for line in tally.findings if line.startswith(f"chan {index}")]
        assert bool(said) == (expected is not None), index
        assert (expected or "") in " ".join(said)
    assert tally.files == len(PLANTED) - 1
