"""A small plate and the view of it, anew for each test."""

from collections.abc import Iterator
from pathlib import Path

import pytest
from view_makers import Client, plate_client, thin_lens, write_depth_plate


@pytest.fixture
def plate(tmp_path: Path) -> Path:
    return write_depth_plate(tmp_path / "plate.1001.exr")


@pytest.fixture
def client(plate: Path) -> Iterator[Client]:
    with plate_client(plate, thin_lens()) as asked:
        yield asked
