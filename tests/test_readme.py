"""README and guide tell the truth: commands, keys, files and links exist."""

import re
import tomllib
from pathlib import Path

import msgspec
import pytest
import typer
from documents import EVERYTHING, GUIDE, PAGES, README, README_PATH, ROOT, section

from lensfit.cli.main import COMMANDS, MEASURING, app
from lensfit.workflow.kit.kit_file import load_kit
from lensfit.workflow.kit.kit_plan import kit_plan
from lensfit.workflow.shoot.shoot_file import load_shoot
from lensfit.workflow.shoot.shoot_records import Camera, LensName, Take, Target

LONGEST_README = 300
RECORDS = {"lens": LensName, "camera": Camera, "target": Target, "take": Take}
DOCUMENTS = [README_PATH, *sorted(GUIDE.glob("*.md")), ROOT / "presets" / "README.md"]
documents = pytest.mark.parametrize(
    "path", DOCUMENTS, ids=lambda path: str(path.relative_to(ROOT))
)


def keys_of(record: type[msgspec.Struct]) -> set[str]:
    return {field.encode_name for field in msgspec.structs.fields(record)}


def required_keys_of(record: type[msgspec.Struct]) -> set[str]:
    fields = msgspec.structs.fields(record)
    return {field.encode_name for field in fields if field.required}


def toml_block(text: str) -> str:
    """The first block of TOML of a section."""
    block = re.search(r"```toml\n(.*?)```", text, re.DOTALL)
    assert block is not None
    return block[1]


def table_rows(text: str) -> list[list[str]]:
    """Cells of the body of the only table of a text."""
    lines = [line for line in text.splitlines() if line.startswith("|")]
    assert set(lines[1]) <= set("|-")
    return [[one.strip() for one in line.strip("|").split("|")] for line in lines[2:]]


def test_readme_is_read_in_ten_minutes():
    assert README.count("\n") <= LONGEST_README


def test_the_test_command_stands_by_itself():
    assert "python -m pip install '.[dev]' && pytest" in README.splitlines()


def test_readme_names_every_page_of_the_guide():
    read_on = section(README, "Where to read on")
    contributing = section(README, "Contributing")
    named = set(re.findall(r"\]\(notebooks/guide/([\w.]+)\)", read_on + contributing))
    assert named == set(PAGES)


def anchors_of(text: str) -> set[str]:
    """Where links may lead within a page, as the sites that show Markdown call it."""
    outside = re.sub(r"```.*?```", "", text, flags=re.DOTALL)
    headings = re.findall(r"^#+ (.*)$", outside, re.MULTILINE)
    assert len(set(headings)) == len(headings)
    return {re.sub(r"[^\w\- ]", "", one.lower()).replace(" ", "-") for one in headings}


def links_of(text: str) -> list[str]:
    """Targets of links and pictures that lead into the repository."""
    outside = re.sub(r"```.*?```|`[^`\n]*`", "", text, flags=re.DOTALL)
    return re.findall(r"\]\((?!https?://)([^)\s]+)\)", outside)


def broken_links(path: Path, root: Path = ROOT) -> list[str]:
    """Links of a document to files or headings that are not there."""
    broken = []
    for link in links_of(path.read_text(encoding="utf-8")):
        name, _, anchor = link.partition("#")
        to = (path.parent / name).resolve() if name else path
        if not (to.is_relative_to(root) and to.exists()) or (
            anchor and anchor not in anchors_of(to.read_text(encoding="utf-8"))
        ):
            broken.append(link)
    return broken


@documents
def test_every_link_and_picture_resolves(path: Path):
    assert broken_links(path) == []


def test_a_broken_link_is_seen(tmp_path: Path):
    page = tmp_path / "page.md"
    page.write_text("# One: a\n[a](#one-a) [b](#b) ![c](c.png) `[d](d)` [e](page.md)\n")
    assert broken_links(page, tmp_path) == ["#b", "c.png"]
    assert broken_links(page, tmp_path / "elsewhere") == links_of(page.read_text())


def test_every_key_of_a_shoot_file_is_in_the_table():
    described: dict[str, dict[str, bool]] = {}
    table = ""
    for name, key, _ in table_rows(section(README, "The shoot file")):
        table = name.strip("`") or table
        described.setdefault(table, {})[key.strip("*`")] = key.startswith("**")
    assert {one: set(keys) for one, keys in described.items()} == {
        one: keys_of(record) for one, record in RECORDS.items()
    }
    for one, keys in described.items():
        required = {key for key, bold in keys.items() if bold}
        assert required == required_keys_of(RECORDS[one])


def test_every_key_of_a_shoot_file_is_described(tmp_path: Path):
    text = toml_block(section(PAGES["measuring.md"], "The shoot file"))
    tables = tomllib.loads(text)
    assert set(tables["lens"]) == keys_of(LensName)
    assert set(tables["camera"]) == keys_of(Camera)
    assert set().union(*tables["target"]) == keys_of(Target)
    assert set(tables["take"][0]) == keys_of(Take)
    (tmp_path / "shoot.toml").write_text(text, encoding="utf-8")
    assert len(load_shoot(tmp_path / "shoot.toml").targets) == 5


def test_the_kit_file_is_one(tmp_path: Path):
    text = toml_block(section(PAGES["kit.md"], "A kit of lenses"))
    (tmp_path / "kit.toml").write_text(text, encoding="utf-8")
    prime, zoom = kit_plan(load_kit(tmp_path / "kit.toml"))
    assert len(prime.views) == 3 * 3 + 2
    assert len(zoom.views) == 3 * (3 * 3 + 2)


@pytest.mark.parametrize("text", [README, EVERYTHING], ids=["README", "with guide"])
def test_every_command_shown_exists(text: str):
    blocks = re.findall(r"```sh\n(.*?)```", text, re.DOTALL)
    shown = set(re.findall(r"\blensfit (\w+)", "".join(blocks)))
    assert {"demo", "inspect", "calibrate", "apply", "stmap"} <= shown
    assert shown <= {*COMMANDS, *MEASURING}


def test_every_room_is_in_the_table():
    rooms = {p.parent.name for p in ROOT.glob("lensfit/*/*.py")}
    house = PAGES["contributing.md"]
    described = set(re.findall(r"^\| \d+ \| `(\w+)/`", house, re.MULTILINE))
    assert described == rooms


def rows_with_tests() -> list[tuple[str, str]]:
    """Options and tests of the table that names both."""
    return [(row[2], row[3]) for row in table_rows(PAGES["every_row.md"])]


def test_every_row_has_a_test_that_is_there():
    for _, tests in rows_with_tests():
        named = re.findall(r"`(\S+\.py)`", tests)
        assert named
        for path in named:
            assert "def test_" in (ROOT / "tests" / path).read_text("utf-8"), path


def test_every_file_named_is_there():
    of_rows = {path for _, tests in rows_with_tests() for path in tests.split("`")}
    named = set(re.findall(r"`([a-z_]+/[a-z_/]+\.py)`", EVERYTHING)) - of_rows
    assert len(named) > 5
    assert [one for one in named if not is_file(one)] == []


def is_file(name: str) -> bool:
    """Whether the repository or the package has a file of that name."""
    return (ROOT / name).is_file() or (ROOT / "lensfit" / name).is_file()


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


def named_paths() -> set[str]:
    """Python files that the guide names in its text, with a folder."""
    text = "\n".join(PAGES.values())
    return set(re.findall(r"`((?:\w+/)+\w+\.py)`", text))


def test_every_file_that_the_guide_names_is_there():
    assert len(named_paths()) > 30
    tops = [ROOT, ROOT / "lensfit", ROOT / "data_synth", ROOT / "tests"]
    missing = {
        path
        for path in named_paths()
        if "NAME" not in path and not any((top / path).is_file() for top in tops)
    }
    assert missing == set()
