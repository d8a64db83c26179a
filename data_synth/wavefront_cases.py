"""What a wavefront fit is judged on: random lenses, and a table of hard cases.

A subject is everything `write_shoot` needs. Random lenses are bundled designs made
larger or smaller (14 to 135 mm), opened to f/1.2 to f/8, and made with the errors of a
workshop; all of it follows from the seed.
"""

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

import numpy as np

from data_synth.chart import Pose
from data_synth.files import PictureFormat
from data_synth.prescription import Prescription, load_prescription, prescription_names
from data_synth.sensor import Frame, Sensor
from data_synth.shoot import Camera, Shot, write_shoot
from data_synth.tolerances import (
    behind_meniscus,
    perturbed,
    scaled,
    with_rims_closed,
)
from data_synth.wavefront_plan import CHART_PLANS, WavefrontPlan, wavefront_shots

WAVELENGTHS = 5
FOCAL_MM = (14.0, 135.0)
SLOWEST = 8.0
SIZE_FACTORS = (0.5, 1.3)
OPEN_STOPS = 1.5
"""Random lenses are closed by up to this many stops."""
STRENGTHS = (0.3, 1.5)
BLADES = (0, 5, 6, 7, 8, 9, 11)
_FORMS: tuple[PictureFormat, ...] = ("exr", "png16", "jpg")
_TILTED_SHARE = 0.75
"""Of shoots drawn by chance, which have a tilted take."""
_TARGETS_ALONG = 12
"""Widths of a target in the lesser side of a frame, at least: a lattice needs some four
of them along it, with their gaps."""


@dataclass(frozen=True)
class Subject:
    """A lens and how it is photographed."""

    name: str
    about: str
    prescription: Prescription
    camera: Camera
    plan: WavefrontPlan = field(default_factory=WavefrontPlan)

    def shots(self) -> list[Shot]:
        """The takes, planned for this lens."""
        return wavefront_shots(self.prescription, self.camera.frame, self.plan)

    def write(
        self,
        folder: Path,
        *,
        seed: int = 0,
        keep_light: bool = False,
        progress: Callable[[str], None] = lambda _: None,
    ) -> None:
        """Photograph everything into a folder, with the wavefront's truth.

        Parameters
        ----------
        keep_light : As for `write_shoot`.
        """
        write_shoot(
            folder,
            self.prescription,
            self.camera,
            self.shots(),
            seed=seed,
            with_wavefront=True,
            keep_light=keep_light,
            progress=progress,
        )


@dataclass(frozen=True)
class Case:
    """A hard case: what is hard about it, the lens, and the departures of the shoot."""

    about: str
    lens: Callable[[tuple[int, int]], Prescription]
    plan: WavefrontPlan = field(default_factory=WavefrontPlan)
    sensor: Sensor = field(default_factory=Sensor)


def _bundled(name: str, _: tuple[int, int]) -> Prescription:
    return load_prescription(name)


def _corner_clipped(size_px: tuple[int, int]) -> Prescription:
    prescription = load_prescription("biotar_50")
    frame = frame_for(prescription, size_px)
    return with_rims_closed(
        dataclasses.replace(prescription, f_number=2.0), frame, corner_part=1 / 3
    )


def _decentred(_: tuple[int, int]) -> Prescription:
    return perturbed(load_prescription("nikkor_28"), 5, strength=4.0, shape=False)


def _fisheye(_: tuple[int, int]) -> Prescription:
    wide = behind_meniscus(load_prescription("nikkor_28"))
    return dataclasses.replace(wide, f_number=5.6, sensor_size_mm=(26.0, 19.5))


CASES = {
    "overlapping": Case(
        "spots out of focus are wider than the dots' pitch",
        partial(_bundled, "biotar_50"),
        WavefrontPlan(blur_in_pitches=1.3),
    ),
    "saturated": Case(
        "the brightest parts of every dot are at full scale",
        partial(_bundled, "biotar_50"),
        WavefrontPlan(brightest=3.0),
    ),
    "tiny_dots": Case(
        "holes of 0.8 px",
        partial(_bundled, "cooke_triplet_50"),
        WavefrontPlan(hole_px=0.8),
    ),
    "cropped_grid": Case(
        "the chart fills about a third of the frame, off centre",
        partial(_bundled, "nikkor_28"),
        WavefrontPlan(
            reach=(0.55, 0.62), pose=Pose(0.0, roll_deg=1.0, shift_mm=(3.0, -2.0))
        ),
    ),
    "tilted_chart": Case(
        "the chart is tilted, panned and rolled in every take",
        partial(_bundled, "flektogon_35"),
        WavefrontPlan(pose=Pose(0.0, tilt_deg=12.0, pan_deg=-15.0, roll_deg=25.0)),
    ),
    "corner_clipped": Case(
        "rims leave a third of the pupil open in the corner", _corner_clipped
    ),
    "decentred": Case("elements are decentred and tilted strongly", _decentred),
    "fast": Case("f/1.2", partial(_bundled, "angenieux_50")),
    "fisheye": Case("barrel distortion of a fifth in the corner", _fisheye),
    "bayer": Case(
        "one colour a pixel, the others interpolated",
        partial(_bundled, "nikkor_28"),
        sensor=Sensor(bayer=True),
    ),
    "jpeg": Case(
        "8-bit sRGB JPEG", partial(_bundled, "biotar_50"), WavefrontPlan(form="jpg")
    ),
    "anamorphic": Case("squeeze 1.92", partial(_bundled, "schneider_31")),
    "printed_dots": Case(
        "black dots of 20 px, fitted along their rims",
        partial(_bundled, "biotar_50"),
        WavefrontPlan(hole_px=20.0, dark=True),
    ),
    "checkerboard": Case(
        "a checkerboard in place of dots",
        partial(_bundled, "biotar_50"),
        CHART_PLANS["checkerboard"],
    ),
    "line_grid": Case(
        "lines of 3 px in place of dots",
        partial(_bundled, "biotar_50"),
        CHART_PLANS["line_grid"],
    ),
    "single_focus": Case(
        "no take is out of focus",
        partial(_bundled, "biotar_50"),
        WavefrontPlan(focus_states=("in",)),
    ),
    "left_out": Case(
        "wide open only, neither tilt nor lines",
        partial(_bundled, "biotar_50"),
        WavefrontPlan(with_tilted=False, with_lines=False, with_stopped_down=False),
    ),
}


def case_subject(name: str, size_px: tuple[int, int]) -> Subject:
    """A hard case by name.

    Raises
    ------
    ValueError : There is none of that name.
    """
    if name not in CASES:
        raise ValueError(f"no case is called {name}; there are {', '.join(CASES)}")
    case = CASES[name]
    prescription = case.lens(size_px)
    return _subject(name, case.about, prescription, size_px, case.plan, case.sensor)


def subject_of(
    prescription: Prescription,
    size_px: tuple[int, int],
    plan: WavefrontPlan | None = None,
    sensor: Sensor | None = None,
) -> Subject:
    """Any lens, as its prescription has it."""
    return _subject(
        prescription.name, prescription.title, prescription, size_px, plan, sensor
    )


def random_subject(number: int, seed: int, size_px: tuple[int, int]) -> Subject:
    """The lens of that number of a series: every design comes once in a row of them."""
    names = prescription_names()
    rng = np.random.default_rng([seed, number])
    base = load_prescription(np.random.default_rng(seed).permutation(names)[
        number % len(names)
    ])  # fmt: skip
    own_mm = base.states[0].focal_length_mm
    focal_mm = float(np.clip(own_mm * rng.uniform(*SIZE_FACTORS), *FOCAL_MM))
    f_number = min(base.f_number * 2 ** (rng.uniform(0, OPEN_STOPS) / 2), SLOWEST)
    f_number = round(max(f_number, base.f_number), 1)
    opened = dataclasses.replace(
        scaled(base, round(focal_mm, 1)), f_number=max(f_number, base.f_number)
    )
    strength = float(rng.uniform(*STRENGTHS))
    made = perturbed(opened, int(rng.integers(2**31)), strength=strength)
    camera = Camera(
        frame_for(made, size_px),
        Sensor(),
        blades=int(rng.choice(BLADES)),
        blade_rotation_deg=round(float(rng.uniform(0, 90)), 1),
        wavelengths=WAVELENGTHS,
    )
    about = f"{focal_mm:.1f} mm f/{made.f_number:g}, errors x {strength:.2f}"
    return Subject(f"{base.name}_{seed}_{number}", about, made, camera)


def random_plan(
    number: int, seed: int, size_px: tuple[int, int]
) -> tuple[str, WavefrontPlan]:
    """How the lens of that number is photographed, in a few words and as a plan: with
    what chart, of enough targets in a frame of that size, in what files."""
    rng = np.random.default_rng([seed, number, 1])
    largest_px = min(size_px) / _TARGETS_ALONG
    charts = [one for one in CHART_PLANS.items() if one[1].hole_px <= largest_px]
    name, plan = charts[int(rng.integers(len(charts)))]
    form = _FORMS[int(rng.integers(len(_FORMS)))]
    with_lines = plan.kind == "dot-grid" and bool(rng.integers(2))
    with_tilted = bool(rng.random() < _TILTED_SHARE)
    roll_deg = round(float(rng.uniform(-6, 6)), 1)
    plan = dataclasses.replace(
        plan,
        form=form,
        with_lines=with_lines,
        with_tilted=with_tilted,
        pose=dataclasses.replace(plan.pose, roll_deg=roll_deg),
    )
    return f"{name}, {form}", plan


def _subject(
    name: str,
    about: str,
    prescription: Prescription,
    size_px: tuple[int, int],
    plan: WavefrontPlan | None = None,
    sensor: Sensor | None = None,
) -> Subject:
    frame = frame_for(prescription, size_px)
    camera = Camera(frame, sensor or Sensor(), wavelengths=WAVELENGTHS)
    return Subject(name, about, prescription, camera, plan or WavefrontPlan())


def frame_for(prescription: Prescription, size_px: tuple[int, int]) -> Frame:
    """The lens' sensor, cut to the picture's shape."""
    pitch_mm = min(
        mm / px for mm, px in zip(prescription.sensor_size_mm, size_px, strict=True)
    )
    width, height = size_px
    return Frame(size_px, (round(pitch_mm * width, 6), round(pitch_mm * height, 6)))
