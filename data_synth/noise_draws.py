"""The same shoot again and again, with other noise each time.

Tracing a picture takes long, its noise does not: what falls on the sensor is kept
beside the picture, and the sensor is exposed to it anew for every draw.
"""

import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import Protocol

import numpy as np
from jaxtyping import Float

from data_synth.files import PictureFormat, picture_name, write_picture
from data_synth.sensor import Sensor, digitise
from lensfit.atomic import atomic_path

_MOST_PICTURES = 1000


class Picture(Protocol):
    """What a picture file is called and how it is written; a `Shot` is one."""

    @property
    def name(self) -> str:
        """Without its ending."""
        ...

    @property
    def form(self) -> PictureFormat:
        """Of the file."""
        ...


def keep_the_light(
    folder: Path, name: str, light: Float[np.ndarray, "height width 3"]
) -> None:
    """Write what a picture would be without noise: exposed, in single precision."""
    path = folder / _light_name(name)
    with atomic_path(path) as temporary, temporary.open("wb") as file:
        np.save(file, light.astype(np.float32))


def draw_noise(
    folder: Path,
    pictures: Sequence[Picture],
    sensor: Sensor,
    draw: int,
    into: Path,
) -> None:
    """Write a shoot's pictures with noise of their own, and its shoot file.

    Parameters
    ----------
    folder : A shoot whose light was kept.
    pictures : Its shots, in their order.
    draw : Which noise; the same number gives the same.
    into : Folder for the pictures and the shoot file; what is there is overwritten.

    Raises
    ------
    OSError : No light was kept.
    """
    into.mkdir(parents=True, exist_ok=True)
    for number, one in enumerate(pictures):
        light = np.load(folder / _light_name(one.name)).astype(float)
        picture = digitise(light, sensor, _MOST_PICTURES * (draw + 1) + number)
        write_picture(into / picture_name(one.name, one.form), picture, one.form)
    shutil.copyfile(folder / "shoot.toml", into / "shoot.toml")


def _light_name(name: str) -> str:
    return f"{name}_light.npy"
