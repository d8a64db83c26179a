"""Makes every preset of this folder: `python presets/make.py [NAME ...]`.

Each lens is photographed by the exact ray tracer of `data_synth`, calibrated by lensfit
from those photographs and the shoot file alone, and then judged against the trace. All
figures are written as they come out. With `--shoots FOLDER` photographs and
calibrations stay there, and those that are there already are used again.
"""

import argparse
import dataclasses
import json
import math
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from pictures import write_picture

from data_synth.judge import geometry_figures, judge, thin_lens_figures
from data_synth.lens import set_lens
from data_synth.plan import planned_shots
from data_synth.prescription import Prescription, load_prescription
from data_synth.psf_truth import FILE_NAME, geometry_truth
from data_synth.sensor import Sensor, camera_bands
from data_synth.shoot import Camera, Shot, write_shoot
from data_synth.thin_lens import ThinLens
from data_synth.wavefront_cases import frame_for, subject_of
from lensfit.preset.schema import Preset
from lensfit.preset.store import load_preset, save_preset
from lensfit.workflow.calibrate import calibrate
from lensfit.workflow.shoot.shoot_file import load_shoot

HERE = Path(__file__).parent
SEED = 0
EVERY = 2
"""Blur is judged at every so manieth field point."""


@dataclass(frozen=True)
class Made:
    """A preset to make.

    Attributes
    ----------
    kind : What sort of lens it stands for.
    prescription : Name of a bundled prescription.
    f_number : Widest that is photographed; the prescription's own if None.
    size_px : Of the photographs.
    wavelengths : That the tracer mixes in each colour band.
    focus_mm : Focus distances of a lens that is photographed in focus alone; None for
        one photographed through focus.
    """

    kind: str
    prescription: str
    f_number: float | None = None
    size_px: tuple[int, int] = (640, 480)
    wavelengths: int = 5
    focus_mm: tuple[float, ...] | None = None

    def lens(self) -> Prescription:
        """The prescription, opened as far as it is photographed."""
        lens = load_prescription(self.prescription)
        return dataclasses.replace(lens, f_number=self.f_number or lens.f_number)


PRESETS = {
    "prime_50": Made("prime", "biotar_50", f_number=2.0, size_px=(800, 600)),
    "wide_28": Made("wide angle", "nikkor_28"),
    "vintage_50": Made("vintage", "petzval_50"),
    "tele_135": Made("telephoto", "kreitzer_135"),
    "zoom_35_51": Made(
        "zoom with breathing",
        "itoh_zoom",
        size_px=(800, 600),
        focus_mm=(1000.0, 4000.0),
    ),
    "anamorphic_31": Made(
        "anamorphic, squeeze 1.9", "schneider_31", size_px=(800, 600)
    ),
}


def make(name: str, folder: Path) -> None:
    """Photograph, calibrate and judge one lens; write preset, figures and picture."""
    made, out = PRESETS[name], HERE / name
    last = "truth_lens.json" if made.focus_mm else FILE_NAME
    if not (folder / last).is_file():
        photograph(made, folder)
    shoot = load_shoot(folder / "shoot.toml")
    results = folder / "calibrated"
    if not (results / "report.json").is_file():
        calibrate(shoot, results)
    report = json.loads((results / "report.json").read_text(encoding="utf-8"))
    preset = load_preset(results / "preset.json")
    out.mkdir(exist_ok=True)
    save_preset(preset, out / "preset.json")
    write_picture(preset, out / "picture.jpg")
    figures = _figures(made, shoot, report, preset, folder)
    text = json.dumps(_rounded(figures), indent=1, ensure_ascii=False)
    (out / "figures.json").write_text(text + "\n", encoding="utf-8")


def photograph(made: Made, folder: Path) -> None:
    """All takes of a lens, into a folder."""
    if made.focus_mm is None:
        subject = subject_of(made.lens(), made.size_px)
        dataclasses.replace(subject, camera=_camera(made)).write(folder, seed=SEED)
    else:
        write_shoot(folder, made.lens(), _camera(made), _still_shots(made), seed=SEED)


def _camera(made: Made) -> Camera:
    frame = frame_for(made.lens(), made.size_px)
    return Camera(frame, Sensor(), wavelengths=made.wavelengths)


def _still_shots(made: Made) -> list[Shot]:
    """Square and tilted dots in focus, at every focal length and focus distance."""
    lens = made.lens()
    frame = frame_for(lens, made.size_px)
    return [
        dataclasses.replace(
            shot,
            name=f"{shot.name}_focus{focus_mm:g}",
            from_maps=True,
        )
        for focus_mm in made.focus_mm or ()
        for shot in planned_shots(lens, frame, focus_distance_mm=focus_mm)
    ]


def _figures(
    made: Made, shoot, report: dict[str, Any], preset: Preset, folder: Path
) -> dict[str, Any]:
    """What was photographed, how well it fits, and how far it is from the truth."""
    lens = made.lens()
    measured = ["geometry", "lateral colour", "fall-off"]
    with_blur = all(entry.blur is not None for entry in preset.entries)
    return {
        "schema": "lensfit.preset-figures.1",
        "kind": made.kind,
        "lens": lens.title,
        "source": lens.source,
        "photographs": {
            "by": "exact ray trace of the published design (data_synth)",
            "takes": len(shoot.takes),
            "size_px": made.size_px,
            "wavelengths_per_channel": made.wavelengths,
            "sensor_mm": [
                preset.camera.sensor_width_mm,
                preset.camera.sensor_height_mm,
            ],
            "focal_lengths_mm": _distinct(shoot, "focal_length_mm"),
            "f_numbers": _distinct(shoot, "f_number"),
            "focus_distances_mm": _distinct(shoot, "focus_distance_mm"),
        },
        "measured": [*measured, "blur"] if with_blur else measured,
        "fit": {
            "rms_px": report["rms_px"],
            "held_out_rms_px": report["held_out_rms_px"],
            "points_used": report["points_used"],
            "points_detected": report["points_detected"],
            "notes": report["notes"],
        },
        "against_the_trace": {
            "lensfit": _judged(preset, folder)
            if made.focus_mm is None
            else _judged_still(made, preset.at),
            "thin_lens": _of_thin_lens(made, folder),
        },
    }


def _distinct(shoot, key: str) -> list[float]:
    return sorted({getattr(take, key) for take in shoot.takes})


def _judged(preset: Preset, folder: Path) -> dict[str, Any]:
    return _without_settings(judge(preset, folder, every=EVERY))


def _of_thin_lens(made: Made, folder: Path) -> dict[str, Any]:
    """The same figures of a perfect thin lens, with a disc for blur."""
    if made.focus_mm is None:
        return _without_settings(thin_lens_figures(folder))
    return _judged_still(made, _thin)


def _thin(
    focal_length_mm: float, f_number: float, focus_distance_mm: float
) -> ThinLens:
    return ThinLens(focal_length_mm, f_number, focus_distance_mm)


def _without_settings(figures: dict[str, Any]) -> dict[str, Any]:
    """Pooled figures of the blur only: one number for each setting is too much."""
    psf = figures["psf"] and {
        key: value for key, value in figures["psf"].items() if key != "by_setting"
    }
    return figures | {"psf": psf}


def _judged_still(made: Made, at: Callable[..., Any]) -> dict[str, Any]:
    """Figures of geometry, colour and fall-off at each photographed state."""
    return {
        f"{focal_mm:g}mm_focus{focus_mm:g}": _judged_at(made, at, focal_mm, focus_mm)
        for focal_mm in (state.focal_length_mm for state in made.lens().states)
        for focus_mm in made.focus_mm or ()
    }


def _judged_at(
    made: Made, at: Callable[..., Any], focal_mm: float, focus_mm: float
) -> dict[str, Any]:
    camera, lens = _camera(made), made.lens()
    truth = geometry_truth(
        partial(_traced, lens, camera, focal_mm),
        camera.frame,
        camera_bands(made.wavelengths),
        (2 * lens.f_number, focus_mm, focus_mm),
        focal_mm,
    )
    return geometry_figures(partial(_at, at, focal_mm), truth)


def _traced(lens: Prescription, camera: Camera, focal_mm, f_number, focus_mm):
    return set_lens(
        lens,
        focal_length_mm=focal_mm,
        f_number=f_number,
        focus_distance_mm=focus_mm,
        blades=camera.blades,
        blade_rotation_rad=math.radians(camera.blade_rotation_deg),
    )


def _at(at: Callable[..., Any], focal_mm: float, f_number: float, focus_mm: float):
    return at(focal_length_mm=focal_mm, f_number=f_number, focus_distance_mm=focus_mm)


def _rounded(value: Any) -> Any:
    """Numbers to four digits, so that figures can be read."""
    if isinstance(value, dict):
        return {key: _rounded(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_rounded(item) for item in value]
    return float(f"{value:.4g}") if isinstance(value, float) else value


def main() -> None:
    """Make the presets that are named, or all."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", choices=[*PRESETS, []], default=[])
    parser.add_argument("--shoots", type=Path, help="keep and reuse photographs here")
    chosen = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        for name in chosen.names or PRESETS:
            make(name, (chosen.shoots or Path(temporary)) / name)


if __name__ == "__main__":
    main()
