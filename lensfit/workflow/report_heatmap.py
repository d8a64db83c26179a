"""The uncertainty of the map over the frame, as a smooth colour field.

The standard deviations are interpolated linearly between the grid's points and drawn
as one small picture in cividis (Nunez, Anderton, Renslow 2018), which reads the same
to colour-blind eyes and in grey; where nothing is known the picture is transparent.
"""

import base64
from collections.abc import Iterator

import cv2
import numpy as np
from jaxtyping import Float

from lensfit.workflow.report_axes import Frame, sensor_frame, tick_text
from lensfit.workflow.report_coverage import numbers
from lensfit.workflow.report_markup import Markup, number, tag
from lensfit.workflow.report_svg import WIDTH, Figure, drawing, words

_PICTURE_WIDTH = 200
_CIVIDIS = np.array(
    [
        (0, 34, 78), (35, 62, 108), (87, 92, 109), (124, 123, 120), (165, 156, 116),
        (210, 192, 96), (254, 232, 56),
    ]
)  # fmt: skip


def uncertainty(entry: dict, camera: dict) -> Figure | None:
    """Predicted standard deviation of the imaged position over the frame."""
    grid = entry.get("uncertainty_grid") or {}
    x, y, sd = (numbers(grid.get(k)) for k in ("x_mm", "y_mm", "sd_px"))
    if sd.shape != (y.size, x.size) or sd.size < 4 or not np.isfinite(sd).any():
        return None
    frame = sensor_frame(camera, x, y)
    low, high = float(np.nanmin(sd)), float(np.nanmax(sd))
    share = (sd - low) / (high - low) if high > low else np.zeros_like(sd)
    marks = [
        words(px, py, number(float(sd[j, i]), digits=2), "onmap", anchor)
        for (j, i, px, py, anchor) in _corner_places(frame, sd)
    ]
    key = _heat_key(frame, low, high)
    caption = "How far the map may be from the truth (1σ of the imaged position, px), "
    caption += f"if the model is right: {number(low, 'px', 2)} at best, "
    caption += f"{number(high, 'px', 2)} at worst."
    shapes = [_field(frame, x, y, share), *marks, frame.border(), key]
    picture = drawing("Uncertainty", *shapes, height=frame.height + 22)
    return Figure("uncertainty", "Uncertainty over the frame", picture, caption)


def _field(frame: Frame, x: np.ndarray, y: np.ndarray, share: np.ndarray) -> Markup:
    """The colour field over the frame, as an embedded picture."""
    (x0, y0), (x1, y1) = frame.low, frame.high
    height = max(2, round(_PICTURE_WIDTH * (y1 - y0) / (x1 - x0)))
    across = x0 + (np.arange(_PICTURE_WIDTH) + 0.5) / _PICTURE_WIDTH * (x1 - x0)
    down = y0 + (np.arange(height) + 0.5) / height * (y1 - y0)
    rows = np.stack([np.interp(across, x, row) for row in share])
    fine = np.stack([np.interp(down, y, column) for column in rows.T], axis=1)
    known = np.isfinite(fine)
    bgra = np.zeros((*fine.shape, 4), dtype=np.uint8)
    bgra[..., :3] = np.rint(_colours(np.where(known, fine, 0.0)))[..., ::-1]
    bgra[..., 3] = np.where(known, 255, 0)
    encoded = base64.b64encode(cv2.imencode(".png", bgra)[1].tobytes()).decode("ascii")
    px, py = frame.place(np.array([x0, x1]), np.array([y0, y1]))
    return tag(
        "image",
        href=f"data:image/png;base64,{encoded}",
        x=f"{px[0]:.1f}",
        y=f"{py[0]:.1f}",
        width=f"{px[1] - px[0]:.1f}",
        height=f"{py[1] - py[0]:.1f}",
        preserveAspectRatio="none",
    )


def _colours(share: Float[np.ndarray, "..."]) -> Float[np.ndarray, "... 3"]:
    """Cividis red, green and blue (0 to 255) at shares between 0 and 1."""
    at = np.linspace(0, 1, len(_CIVIDIS))
    return np.stack([np.interp(share, at, _CIVIDIS[:, k]) for k in range(3)], axis=-1)


def _corner_places(frame: Frame, sd: np.ndarray) -> Iterator[tuple]:
    left, right = frame.margin + 8, WIDTH - frame.margin - 8
    top, bottom = frame.margin + 18, frame.height - frame.margin - 10
    yield 0, 0, left, top, "start"
    yield 0, -1, right, top, "end"
    yield -1, 0, left, bottom, "start"
    yield -1, -1, right, bottom, "end"
    rows, columns = sd.shape
    middle = (frame.height / 2) + 5
    yield rows // 2, columns // 2, WIDTH / 2, middle, "middle"


def _heat_key(frame: Frame, low: float, high: float) -> Markup:
    """The colour scale under the frame."""
    y, width, steps = frame.height - frame.margin + 10, 160.0, 40
    parts = []
    for k, rgb in enumerate(_colours(np.linspace(0, 1, steps))):
        fill = "#{:02x}{:02x}{:02x}".format(*(round(float(c)) for c in rgb))
        box = {"x": f"{frame.margin + k * width / steps:.1f}", "y": f"{y:.1f}"}
        parts.append(tag("rect", **box, width="4.4", height="9", fill=fill))
    ends = [tick_text(float(f"{value:.2g}")) for value in (low, high)]
    right = frame.margin + width
    parts.append(words(frame.margin, y + 25, ends[0], "small", "start"))
    parts.append(words(right, y + 25, f"{ends[1]} px", "small", "end"))
    return Markup("".join(parts))
