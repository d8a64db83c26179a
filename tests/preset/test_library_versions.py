"""Versions: many writers, writers that die, file systems without links."""

import errno
import json
import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import msgspec
import pytest
from library_makers import SLUG, keep, make_show
from preset_makers import make_entry, make_preset

from lensfit.errors import OutputError, PresetError
from lensfit.preset.blocks import Projection
from lensfit.preset.library.layers import find_preset
from lensfit.preset.library.levels import (
    claim_next_version,
    claim_version,
    levels_of,
    version_number,
)
from lensfit.preset.schema import LensName
from lensfit.preset.store import load_preset

HERE = Path(__file__).parent
SAVER = """
import sys, itertools
sys.path.insert(0, sys.argv[1])
from pathlib import Path
import msgspec
from library_makers import keep
from preset_makers import make_preset
from lensfit.preset.schema import LensName
for n in range(int(sys.argv[4])):
    kept = keep(Path(sys.argv[2]), make_preset(), note=f"{sys.argv[3]}.{n}")
    print(kept.number, flush=True)
"""


def saver(library: Path, name: str, count: int) -> subprocess.Popen[str]:
    """A process of its own that saves presets one after the other."""
    command = [sys.executable, "-c", SAVER, str(HERE), str(library), name, str(count)]
    return subprocess.Popen(command, stdout=subprocess.PIPE, text=True)


def shelf(library: Path) -> Path:
    return library / "lenses" / SLUG


def test_eight_writers_lose_nothing_and_share_no_number(tmp_path: Path):
    writers = [saver(tmp_path, str(n), 25) for n in range(8)]
    told = [int(line) for w in writers for line in w.communicate()[0].split()]
    assert [w.returncode for w in writers] == [0] * 8
    assert sorted(told) == list(range(1, 201))
    notes = set()
    for number in told:
        saved = load_preset(shelf(tmp_path) / f"v{number:03d}.json").saved
        assert saved is not None
        notes.add(saved.note)
    assert notes == {f"{writer}.{n}" for writer in range(8) for n in range(25)}
    assert [f for f in os.listdir(shelf(tmp_path)) if f.startswith(".v")] == []


@pytest.mark.skipif(os.name == "nt", reason="SIGKILL is POSIX")
def test_killed_writers_leave_no_half_file_and_block_nobody(tmp_path: Path):
    rng = random.Random(4)
    told: list[int] = []
    for _ in range(6):
        writers = [saver(tmp_path, "x", 10_000) for _ in range(2)]
        for writer in writers:  # both are at it
            assert writer.stdout is not None
            told.append(int(writer.stdout.readline()))
        time.sleep(rng.uniform(0, 0.05))
        for writer in writers:
            writer.send_signal(signal.SIGKILL)
            told += [int(n) for n in writer.communicate()[0].split("\n")[:-1]]
    last = keep(tmp_path).number
    numbers = [version_number(p.stem) for p in shelf(tmp_path).glob("v*.json")]
    assert set(told) <= set(numbers)
    assert last == max(n for n in numbers if n is not None) == len(numbers)
    for path in shelf(tmp_path).glob("v*.json"):
        load_preset(path)
    # what the dead left aside is gone as well
    assert [f for f in os.listdir(shelf(tmp_path)) if f.startswith(".version")] == []


def no_links(*args: object, **kwargs: object) -> None:
    raise OSError(errno.EPERM, "Operation not permitted")


def test_without_hard_links_numbers_are_claimed_too(tmp_path: Path, monkeypatch):
    monkeypatch.setattr(os, "link", no_links)
    assert [keep(tmp_path).number for _ in range(3)] == [1, 2, 3]
    taken = shelf(tmp_path) / "v003.json"
    before = taken.read_bytes()
    assert not claim_version(shelf(tmp_path), 3, "other")
    assert taken.read_bytes() == before


def test_a_claim_that_was_never_written_is_skipped(tmp_path: Path):
    keep(tmp_path)
    (shelf(tmp_path) / "v002.json").touch()
    assert find_preset(SLUG, tmp_path).name == f"{SLUG}@v001"
    assert keep(tmp_path).number == 3


def test_an_answer_lost_on_the_way_is_no_failure(tmp_path: Path, monkeypatch):
    real = os.link

    def lost(source: object, target: object) -> None:
        real(source, target)  # pyright: ignore[reportArgumentType]
        raise FileExistsError(errno.EEXIST, "sent again by NFS")

    monkeypatch.setattr(os, "link", lost)
    assert [keep(tmp_path).number for _ in range(2)] == [1, 2]


def test_a_deleted_number_is_not_given_out_again(tmp_path: Path):
    for _ in range(3):
        last = keep(tmp_path)
    last.path.unlink()
    assert keep(tmp_path).number == 4


@pytest.mark.parametrize(
    "stranger", ["v999999999.json", "v2.json", "v0002.json", "v000.json", "V002.json"]
)
def test_what_is_no_version_does_not_count(tmp_path: Path, stranger: str):
    keep(tmp_path)
    (shelf(tmp_path) / stranger).write_text("{}")
    assert keep(tmp_path).number == 2
    assert find_preset(SLUG, tmp_path).name == f"{SLUG}@v002"


def test_after_the_last_number_there_is_none(tmp_path: Path):
    keep(tmp_path)
    (shelf(tmp_path) / "v999999.json").write_text("{}")
    with pytest.raises(OutputError, match="v999999 is the last number"):
        keep(tmp_path)


def test_versions_grow_beyond_three_digits(tmp_path: Path):
    keep(tmp_path)
    (shelf(tmp_path) / ".highest").write_text("999\n")
    assert keep(tmp_path).path.name == "v1000.json"
    assert find_preset(f"{SLUG}@v1000", tmp_path).name == f"{SLUG}@v1000"


def test_nothing_is_saved_that_could_not_be_read(tmp_path: Path):
    bad = make_preset(make_entry(focal_length_mm=float("nan")))
    with pytest.raises(PresetError, match="no finite number"):
        keep(tmp_path, bad)
    assert not shelf(tmp_path).exists()


def test_a_version_reads_the_same_whoever_made_the_numbers(tmp_path: Path):
    whole = make_preset(make_entry(projection=Projection(51, (0, 0), 60)))
    text = keep(tmp_path, whole).path.read_text()
    assert '"principal_distance_mm": 51.0' in text
    assert keep(tmp_path, load_preset(shelf(tmp_path) / "v001.json")).number == 2
    again = (shelf(tmp_path) / "v002.json").read_text()
    same = [a == b for a, b in zip(text.split("\n"), again.split("\n"), strict=True)]
    assert same.count(False) <= 1  # the time of saving


def test_one_lens_with_two_serials_is_two_lenses(tmp_path: Path):
    keep(tmp_path)
    other = msgspec.structs.replace(
        make_preset(), lens=LensName("SMC Takumar 50/1.4", "99")
    )
    keep(tmp_path, other)
    assert levels_of(tmp_path)[0].slugs() == [SLUG, "smc-takumar-50-1-4_99"]
    with pytest.raises(PresetError, match="is the name of several lenses"):
        find_preset("smc-takumar-50-1-4", tmp_path)
    assert find_preset("smc-takumar-50-1-4_99", tmp_path).preset.lens.serial == "99"


def test_claims_need_a_free_name(tmp_path: Path):
    assert claim_next_version(tmp_path, "{}") == 1
    assert not claim_version(tmp_path, 1, "other")
    assert (tmp_path / "v001.json").read_text() == "{}"


def test_the_project_mark_is_plain_json(tmp_path: Path):
    show, _, _ = make_show(tmp_path)
    mark = json.loads((show / "lenses" / "project.json").read_text())
    assert mark["schema"] == "lensfit.project.1"
    assert mark["who"] == "ana"
