"""The picture of knobs in the guide: one frame, turned one knob at a time.

`python presets/knob_sheet.py` renders the demo's plate through `prime_50` wide open and
writes `knobs.jpg` beside itself.
"""

from pathlib import Path

import matplotlib as mpl
from matplotlib.figure import Figure
from pictures import frame_within, halved_plate, shown
from PIL import Image

import lensfit
from lensfit.preset.knobs import NEUTRAL, adjusted_knobs

HERE = Path(__file__).parent
PRESET = HERE / "prime_50" / "preset.json"
FOCUS_MM = 1430.0
NEAREST_MM = 1350.0
"""The scene is scaled so that its nearest sphere is here, in front of the focus."""
TURNED: tuple[tuple[str, dict[str, float | int]], ...] = (
    ("as measured, f/2", {}),
    (
        "--disable coma,astigmatism",
        {
            "coma_gain": 0.0,
            "astigmatism_tangential_gain": 0.0,
            "astigmatism_sagittal_gain": 0.0,
        },
    ),
    ("--coma-gain 4", {"coma_gain": 4.0}),
    ("--lateral-red-gain 40", {"lateral_red_gain": 40.0}),
    ("--distortion-percent -12", {"distortion_percent": -12.0}),
    ("--mechanical-vignetting-stops 2", {"mechanical_vignetting_stops": 2.0}),
    ("--blades 6", {"blades": 6}),
    ("--cat-eye-percent 60", {"cat_eye_percent": 60.0}),
    ("--squeeze 2", {"squeeze": 2.0}),
    ("--bloom-gain 0.3", {"bloom_gain": 0.3}),
    ("--glint-gain 0.3", {"glint_gain": 0.3}),
    ("--ghost-gain 0.3", {"ghost_gain": 0.3}),
)
COLUMNS = 3
CROP = (0.0, 0.52, 0.45, 1.0)
"""Top, bottom, left and right of what is shown, in shares of the frame."""


def main() -> None:
    """Render every turned frame and lay them out."""
    mpl.rcParams["font.size"] = 8
    mpl.rcParams["font.family"] = "monospace"
    rgb, depth_mm, window = halved_plate()
    depth_mm = depth_mm * (NEAREST_MM / depth_mm.min())
    preset = lensfit.load_preset(PRESET)
    rows = -(-len(TURNED) // COLUMNS)
    figure = Figure(figsize=(9.6, 1.95 * rows), dpi=100, layout="constrained")
    for axes, (title, knobs) in zip(
        figure.subplots(rows, COLUMNS).ravel(), TURNED, strict=True
    ):
        lens = preset.at(
            focal_length_mm=50.0,
            f_number=2.0,
            focus_distance_mm=FOCUS_MM,
            knobs=adjusted_knobs(NEUTRAL, knobs),
        )
        frame = lensfit.render(
            rgb,
            depth_mm,
            lens,
            tolerance=3e-3,
            data_window=window,
            display_window=frame_within(lens),
            look=adjusted_knobs(NEUTRAL, knobs).look,
        )
        height, width = frame.shape[:2]
        top, bottom, left, right = CROP
        shown_part = frame[
            int(top * height) : int(bottom * height),
            int(left * width) : int(right * width),
        ]
        axes.imshow(shown(shown_part), interpolation="lanczos")
        axes.set_title(title)
        axes.set_axis_off()
    figure.savefig(HERE / "knobs.png")
    page = Image.open(HERE / "knobs.png").convert("RGB")
    page.save(HERE / "knobs.jpg", quality=88, optimize=True)
    (HERE / "knobs.png").unlink()


if __name__ == "__main__":
    main()
