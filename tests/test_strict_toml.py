"""TOML within bounds: tables, or one line that says why not."""

from pathlib import Path

import pytest

from lensfit._strict import read_toml_tables
from lensfit.errors import ShootError


def tables_of(path: Path) -> dict:
    return read_toml_tables(path, error=ShootError, source="give one", mend="mend it")


def test_tables_and_a_byte_order_mark(tmp_path: Path):
    path = tmp_path / "a.toml"
    path.write_bytes(b"\xef\xbb\xbf[a]\nb = [1, inf]\n")
    assert tables_of(path) == {"a": {"b": [1, float("inf")]}}


@pytest.mark.parametrize(
    ("content", "says"),
    [
        (b"a = " + b"[" * 100_000, "not valid TOML"),
        (b"a = " + b"[" * 70 + b"]" * 70, "nested deeper than 64"),
        (b"a." * 5000 + b"b = 1", "more than 2000 dots"),
        ('"\u2028".'.encode() * 5000 + b"b = 1", "more than 2000 dots"),
        (b"a = " + b"9" * 5000, "not valid TOML"),
        (b"a = 9223372036854775808", "more than 64 bits"),
        (b"#" * (2**20 + 1), "larger than 1 MiB"),
        ("a = 1".encode("utf-16"), "not text in UTF-8"),
        (b"a = 1\0", "NUL bytes"),
        (b"a = 1\na = 2", "not valid TOML"),
    ],
)
def test_what_is_refused(tmp_path: Path, content: bytes, says: str):
    path = tmp_path / "a.toml"
    path.write_bytes(content)
    with pytest.raises(ShootError, match=says) as caught:
        tables_of(path)
    assert len(str(caught.value)) < 500 + len(str(path))


def test_what_is_no_file(tmp_path: Path):
    for path in (tmp_path, tmp_path / "none", Path("a\0b")):
        with pytest.raises(ShootError, match=r"(cannot be read|no ordinary).*give one"):
            tables_of(path)
