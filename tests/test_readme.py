"""The README tells the truth: commands exist, every shoot key is described."""

import re
import tomllib
from pathlib import Path

import msgspec
import typer

from lensfit.cli.main import COMMANDS, app
from lensfit.workflow.kit.file import load_kit
from lensfit.workflow.kit.plan import kit_plan
from lensfit.workflow.shoot.records import Camera, LensName, Take, Target

README = (Path(__file__).parents[1] / "README.md").read_text(encoding="utf-8")


def keys_of(record: type[msgspec.Struct]) -> set[str]:
    return {field.encode_name for field in msgspec.structs.fields(record)}


def test_every_key_of_a_shoot_file_is_described():
    block = re.search(r"```toml\n(.*?)```", README, re.DOTALL)
    assert block is not None
    tables = tomllib.loads(block[1])
    assert set(tables["lens"]) == keys_of(LensName)
    assert set(tables["camera"]) == keys_of(Camera)
    assert set(tables["target"][0]) == keys_of(Target)
    assert set(tables["take"][0]) == keys_of(Take)
    for record, table in ((Target, tables["target"]), (Take, tables["take"])):
        msgspec.convert(table, list[record])


def test_the_kit_file_is_one(tmp_path: Path):
    section = README.split("### A kit of lenses\n", 1)[1]
    block = re.search(r"```toml\n(.*?)```", section, re.DOTALL)
    assert block is not None
    (tmp_path / "kit.toml").write_text(block[1], encoding="utf-8")
    prime, zoom = kit_plan(load_kit(tmp_path / "kit.toml"))
    assert len(prime.views) == 3 * 3 + 2
    assert len(zoom.views) == 3 * (3 * 3 + 2)


def test_every_command_shown_exists():
    blocks = re.findall(r"```sh\n(.*?)```", README, re.DOTALL)
    shown = set(re.findall(r"\blensfit (\w+)", "".join(blocks)))
    assert {"demo", "inspect", "calibrate", "apply", "stmap"} <= shown
    assert shown <= set(COMMANDS)


def test_every_room_is_in_the_table():
    rooms = {p.parent.name for p in Path(__file__).parents[1].glob("lensfit/*/*.py")}
    described = set(re.findall(r"^\| \d \| `(\w+)/`", README, re.MULTILINE))
    assert described == rooms


def rows_with_tests() -> list[tuple[str, str]]:
    """Options and tests of the table that names both."""
    section = README.split("## Every row, its option and its test", 1)[1]
    lines = [
        line for line in section.split("\n## ", 1)[0].splitlines() if line[:1] == "|"
    ]
    cells = [line.strip("|").split("|") for line in lines[2:]]
    return [(row[2], row[3]) for row in cells]


def test_every_row_has_a_test_that_is_there():
    here = Path(__file__).parent
    for _, tests in rows_with_tests():
        named = re.findall(r"`(\S+\.py)`", tests)
        assert named
        for path in named:
            assert "def test_" in (here / path).read_text(encoding="utf-8"), path


def test_every_option_of_the_table_is_one_of_apply():
    shown = {
        o
        for options, _ in rows_with_tests()
        if "`lensfit" not in options
        for o in re.findall(r"`(--\S+)`", options)
    }
    known = {
        option
        for parameter in typer.main.get_command(app).commands["apply"].params
        for option in parameter.opts
    }
    assert len(shown) > 40
    assert shown <= known
