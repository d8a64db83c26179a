"""Writing photographs and truth: half-float EXR, PNG, JPEG, compact JSON.

EXR and 16-bit PNG hold scene-linear samples; 8-bit PNG and JPEG are sRGB. JPEG has
colour at half resolution (4:2:0), as cameras write it. Files appear whole or not at
all.
"""

import json
from pathlib import Path
from typing import Literal

import cv2
import numpy as np
from jaxtyping import Float

from data_synth.sensor import srgb_codes
from lensfit.atomic import atomic_path, write_text_atomic
from lensfit.coords import Window
from lensfit.io.exr import ExrImage, ExrPart, write_exr

PictureFormat = Literal["exr", "png16", "png", "jpg"]
ENCODINGS = {"exr": "linear", "png16": "linear", "png": "srgb", "jpg": "srgb"}
JPEG_QUALITY = 95


def picture_name(name: str, form: PictureFormat) -> str:
    """File name of a photograph."""
    return f"{name}.{'png' if form == 'png16' else form}"


def write_picture(
    path: Path, linear: Float[np.ndarray, "height width 3"], form: PictureFormat
) -> None:
    """Write scene-linear samples (1 is full scale) in one of the formats."""
    if form == "exr":
        _write_exr(path, linear)
        return
    if form == "png16":
        codes = np.round(np.clip(linear, 0.0, 1.0) * 65535).astype(np.uint16)
    else:
        codes = srgb_codes(linear).astype(np.uint8)
    options = {
        "jpg": [
            cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY,
            cv2.IMWRITE_JPEG_SAMPLING_FACTOR, cv2.IMWRITE_JPEG_SAMPLING_FACTOR_420,
        ],
    }.get(form, [cv2.IMWRITE_PNG_COMPRESSION, 9])  # fmt: skip
    with atomic_path(path) as temporary:
        cv2.imwrite(str(temporary), np.ascontiguousarray(codes[..., ::-1]), options)


def _write_exr(path: Path, linear: Float[np.ndarray, "height width 3"]) -> None:
    window = Window.of_size(linear.shape[1], linear.shape[0])
    channels = {
        name: np.ascontiguousarray(linear[..., k].astype(np.float16))
        for k, name in enumerate("RGB")
    }
    part = ExrPart(channels=channels, display_window=window, data_window=window)
    write_exr(path, ExrImage((part,)), compression="zip")


def write_json(path: Path, table: dict) -> None:
    """Write JSON with one row of a table per line, so that it stays readable."""
    lines = []
    for key, value in table.items():
        if isinstance(value, list) and value and isinstance(value[0], list):
            rows = ",\n  ".join(json.dumps(row, separators=(",", ":")) for row in value)
            lines.append(f"{json.dumps(key)}: [\n  {rows}\n ]")
        else:
            lines.append(f"{json.dumps(key)}: {json.dumps(value)}")
    write_text_atomic(path, "{\n " + ",\n ".join(lines) + "\n}\n")
