"""Whole commands on spoiled files: what they answer, print and leave behind.

Runs as a process of its own, as `fuzz_worker` does. A command may write under its own
folder of results and nowhere else; it ends with 0, or with 1 and one line that says
what is wrong; what it leaves is whole.
"""

import json
import os
import re
import resource
import shutil
import sys
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import fuzz_exchange as exchange
import fuzz_pictures as pictures
from exr_mutations import EXR
from fuzz_readers import READERS, Seeds, texts
from fuzz_worker import Watch, forget_peak, peak_kib, say, spoiled
from mutations import BYTES, JSON, TEXT, XML, Mutation
from typer.testing import CliRunner, Result

from lensfit.cli.main import app
from lensfit.io.exr import read_exr
from lensfit.preset.store import load_preset
from lensfit.workflow.shoot.shoot_file import load_shoot

MOST_ADDRESSES = 12 << 30
_RAW = re.compile(r"\b[A-Z]\w*(?:Error|Exception|Interrupt)\b|Traceback|--debug")
_STATE = (
    *("--focal-length-mm", 50, "--f-number", 2.8, "--focus-distance-mm", 2000),
    *("--sensor-width-mm", 24),
)


class Command(NamedTuple):
    """A command and the file of it that is spoiled.

    Attributes
    ----------
    name : For people.
    seeds : Makes whole files, and names those to spoil.
    arguments : Of the command line, for a spoiled file, a folder of whole files and
        the folder of results.
    mutations : That suit the file.
    files : How many are spoiled.
    needs_jax : Whether it takes seconds.
    sound : Whether it can be done with the whole file.
    """

    name: str
    seeds: Seeds
    arguments: Callable[[Path, Path, Path], list[object]]
    mutations: tuple[Mutation, ...]
    files: int
    needs_jax: bool = True
    sound: bool = True


def _seeds(name: str) -> Seeds:
    return next(reader.seeds for reader in READERS if reader.name == name)


def _few(seeds: Seeds, *names: str) -> Seeds:
    return lambda folder: [p for p in seeds(folder) if p.stem in names]


def _apply(path: Path, whole: Path, out: Path) -> list[object]:
    return ["apply", whole / "one.json", path, "--out", out]


def _inspect(path: Path, whole: Path, out: Path) -> list[object]:
    return ["inspect", path, "--write-shoot", out / "shoot.toml"]


def _beside(option: str) -> Callable[[Path, Path, Path], list[object]]:
    def arguments(path: Path, whole: Path, out: Path) -> list[object]:
        return ["inspect", whole / "plate.1001.exr", option, path]

    return arguments


def _import(path: Path, whole: Path, out: Path) -> list[object]:
    known = ("--sensor-width-mm", 24, "--focal-length-mm", 50, "--direction")
    out = out / "lens.json"
    return ["preset", "import", path, *known, "redistort", "--out", out]


def _stmap(path: Path, whole: Path, out: Path) -> list[object]:
    return ["stmap", path, "--focal-length-mm", 50, "--out", out]


_PLATE = _few(pictures.plates, "plate_zip", "plate_tiles", "plate_parts")
_DEEP = _few(pictures.deep_plates, "deep_zips")
_ONE = _few(_seeds("preset"), "one")

COMMANDS = (
    Command("inspect EXR", pictures.plates, _inspect, EXR, 20, False),
    Command("inspect PNG", pictures.pngs, _inspect, pictures.PNG, 8, False),
    Command("inspect JPEG", pictures.jpegs, _inspect, BYTES, 8, False),
    Command("inspect TIFF", pictures.tiffs, _inspect, BYTES, 8, False),
    Command("ARRI", _seeds("ARRI"), _beside("--metadata"), TEXT, 8, False),
    Command("nk camera", _seeds("nk camera"), _beside("--camera"), TEXT, 8, False),
    Command("settings", _seeds("settings"), _beside("--settings"), TEXT, 8, False),
    Command(
        "validate",
        _seeds("library"),
        lambda path, whole, out: ["preset", "validate", path],
        JSON,
        8,
        False,
    ),
    Command(
        "validate all",
        _seeds("library"),
        lambda path, whole, out: ["preset", "validate", path.parents[2]],
        JSON,
        8,
        False,
    ),
    Command(
        "save",
        _seeds("preset"),
        lambda path, whole, out: ["preset", "save", path, "--library", out],
        JSON,
        8,
        False,
    ),
    Command(
        "calibrate",
        _seeds("shoot"),
        lambda path, whole, out: ["calibrate", path, "--out", out],
        TEXT,
        8,
        sound=False,  # its photographs are not there
    ),
    Command("import OpenCV", texts("c", *exchange.opencv_texts()), _import, XML, 8),
    Command("import lensfun", texts("l.xml", exchange.LENSFUN), _import, XML, 6),
    Command(
        "import JSON", texts("s", exchange.opentrackio_texts()[0]), _import, JSON, 6
    ),
    Command("import nk", texts("l.nk", *exchange.tde4_texts()), _import, TEXT, 6),
    Command("import map", _few(pictures.maps, "three"), _import, EXR, 6),
    Command(
        "plan",
        _PLATE,
        lambda path, whole, out: ["plan", whole / "one.json", path],
        EXR,
        10,
    ),
    Command("apply", _PLATE, _apply, EXR, 12),
    Command("apply deep", _DEEP, _apply, EXR, 8),
    Command(
        "apply preset",
        _ONE,
        lambda path, whole, out: [
            *("apply", path, whole / "plate.1001.exr", "--out", out, *_STATE),
            "--no-defocus",
        ],
        JSON,
        6,
    ),
    Command(
        "apply map",
        pictures.maps,
        lambda path, whole, out: [
            *("apply", whole / "one.json", whole / "plate.1001.exr", "--stmap", path),
            *("--out", out, "--no-defocus", *_STATE),
        ],
        EXR,
        6,
    ),
    Command("stmap", _ONE, _stmap, JSON, 8),
)


def outside(root: Path, out: Path) -> dict[str, tuple[int, int]]:
    """Size and time of every file that is not a result."""
    found = {}
    for folder, folders, files in os.walk(root):
        folders[:] = [f for f in folders if Path(folder, f) != out]
        for name in (*folders, *files):
            at = os.lstat(os.path.join(folder, name))
            found[os.path.join(folder, name)] = (
                at.st_size * (name in files),
                at.st_mtime_ns * (name in files),
            )
    return found


def complaints(result: Result) -> list[str]:
    """What is wrong with an answer."""
    found = []
    if result.exit_code not in (0, 1):
        found.append(f"exit code {result.exit_code}: {result.stderr[-200:]!r}")
    lines = result.stderr.splitlines()
    errors = [line for line in lines if line.startswith("lensfit: error: ")]
    others = [line for line in lines if not line.startswith("lensfit: ")]
    if len(errors) != result.exit_code and result.exit_code in (0, 1):
        found.append(f"exit code {result.exit_code}, {len(errors)} errors: {errors!r}")
    if others:
        found.append(f"says {others[0][:200]!r}")
    found += [f"says {line[:300]!r}" for line in errors if _RAW.search(line)]
    return found


def half_files(out: Path) -> list[str]:
    """What stands under the results and is not whole."""
    read: dict[str, Callable[[Path], Any]] = {
        ".exr": read_exr,
        ".toml": load_shoot,
        ".json": load_preset,
    }
    found = []
    for path in (p for p in out.rglob("*") if p.is_file()):
        if path.name.startswith(".") and path.name != ".highest":
            found.append(f"leaves {path.name}")
        elif path.suffix in read and path.name != "default.json":
            try:
                read[path.suffix](path)
            except Exception as error:
                found.append(f"leaves half of {path.name}: {error}")
    return found


def run_command(command: Command, root: Path, count: int, watch: Watch) -> None:
    """A command on each of `count` spoiled files."""
    place, whole, out = root / "files", root / "whole", root / "out"
    for folder in (place, whole):
        folder.mkdir(parents=True)
    plates = pictures.plates(whole)
    shutil.copy(plates[3], whole / "plate.1001.exr")
    _seeds("preset")(whole)
    seeds = {path: path.read_bytes() for path in command.seeds(place)}
    os.chdir(place)
    out.mkdir()
    first = [str(a) for a in command.arguments(next(iter(seeds)), whole, out)]
    answer = CliRunner().invoke(app, first)
    assert (answer.exit_code == 0) == command.sound, answer.stderr
    shutil.rmtree(out, ignore_errors=True)
    for index in range(count):
        path = list(seeds)[index % len(seeds)]
        mutation, data = spoiled(command, seeds[path], index)
        path.write_bytes(data)
        out.mkdir(exist_ok=True)
        before = outside(root, out)
        forget_peak()
        with watch.reading():
            arguments = [str(a) for a in command.arguments(path, whole, out)]
            result = CliRunner().invoke(app, arguments)
        found = [*complaints(result), *half_files(out)]
        if printed := watch.printed():
            found.append(f"prints {printed[:300]!r}")
        if outside(root, out) != before:
            found.append("writes outside its folder of results")
        head = {"name": command.name, "index": index, "seed": path.name}
        outcome = "refused" if result.exit_code else "read"
        taken = {"growth_kib": 0, "peak_kib": peak_kib(), "cpu_s": 0.0}
        head["mutation"] = mutation
        says = result.stderr[-300:]
        say({**head, **taken, "outcome": outcome, "found": found, "says": says})
        shutil.rmtree(out, ignore_errors=True)
        path.write_bytes(seeds[path])


def main(plan: list[tuple[str, int, int]], folder: Path) -> None:
    """Run, command after command, what the plan says."""
    warnings.simplefilter("ignore")
    resource.setrlimit(resource.RLIMIT_AS, (MOST_ADDRESSES, MOST_ADDRESSES))
    commands = {command.name: command for command in COMMANDS}
    watch = Watch(folder)
    for number, (name, _, stop) in enumerate(plan):
        run_command(commands[name], folder / str(number), stop, watch)


if __name__ == "__main__":
    main(json.loads(sys.argv[1]), Path(sys.argv[2]))
