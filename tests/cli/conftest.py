"""A preset in a file, anew for each test."""

from pathlib import Path

import pytest
from plate_makers import make_preset

from lensfit.preset.store import save_preset


@pytest.fixture
def preset(tmp_path: Path) -> Path:
    save_preset(make_preset(), tmp_path / "preset.json")
    return tmp_path / "preset.json"
