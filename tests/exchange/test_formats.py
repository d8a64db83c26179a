"""Every format stands in its registry, on the command line and in the guide."""

import re

import pytest
from documents import PAGES

from lensfit.cli.export import ExportFormat
from lensfit.cli.preset.foreign import ImportFormat
from lensfit.errors import ExchangeError
from lensfit.exchange.export import FORMATS
from lensfit.exchange.foreign import StatedValues
from lensfit.exchange.imports import FOREIGN_FORMATS, read_foreign


def test_the_command_line_offers_every_format():
    assert [one.value for one in ExportFormat] == list(FORMATS)
    assert [one.value for one in ImportFormat] == list(FOREIGN_FORMATS)


@pytest.mark.parametrize("name", FORMATS)
def test_the_guide_describes_every_format_that_is_written(name: str):
    assert f"`{name}`" in PAGES["presets.md"]


@pytest.mark.parametrize("name", FOREIGN_FORMATS)
def test_the_guide_describes_every_format_that_is_read(name: str):
    assert re.search(rf"`{name}[`-]", PAGES["presets.md"])


def test_a_format_that_is_not_known_is_refused(tmp_path):
    path = tmp_path / "lens.txt"
    path.write_text("k1 0.1")
    with pytest.raises(ExchangeError, match="'other' is no format"):
        read_foreign(path, StatedValues(), kind="other")
