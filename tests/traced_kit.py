"""A kit of two traced primes: the kit file, and the photographs that its plan asks for.

Nothing is drawn by the model that judges it: every view of the plan is ray traced, with
the chart at the distance, tilt, stop and focus mark that the plan says.
"""

from pathlib import Path

from data_synth.chart import Chart, Pose
from data_synth.files import write_picture
from data_synth.prescription import load_prescription
from data_synth.sensor import Frame, Sensor, digitise
from data_synth.shoot import BRIGHTEST, Camera, Shot, take
from lensfit.workflow.kit.kit_file import Kit, load_kit
from lensfit.workflow.kit.kit_plan import TILT_DEG, LensPlan, kit_plan

SIZE_PX = (400, 300)
KIT = """\
name = "Stage 4 primes"

[camera]
model = "Test camera"
sensor_width_mm = 28.0
sensor_height_mm = 21.0
image_size_px = [400, 300]

[[target]]
name = "holes"
kind = "dot-grid"
pitch_mm = 60.0
hole_diameter_mm = 6.0
polarity = "bright"

[exposure]
f_number = 2.8
shutter_s = 0.02

[defaults]
lens_set = "Stage 4"
f_numbers = [5.6]
focus_marks = ["1.12 m", "6'"]
target_distance = "1.12 m"
tilted_views = 1
encoding = "linear"
file_format = ".png"

[[lens]]
name = "Wide 28"
serial = "101"
focal_length_mm = 28.0

[[lens]]
name = "Wide 35"
serial = "102"
focal_length_mm = 35.0
"""
LENSES = {"wide-28_101": "nikkor_28", "wide-35_102": "flektogon_35"}
_PAN = {"left": (0.0, -TILT_DEG), "right": (0.0, TILT_DEG)}


def write_kit_file(folder: Path, text: str = KIT) -> Path:
    """The kit file in a folder."""
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / "kit.toml"
    path.write_text(text)
    return path


def photograph_kit(path: Path) -> Kit:
    """Take every view of the plan, under the names of its slates."""
    kit = load_kit(path)
    for plan in kit_plan(kit):
        photograph(kit, plan, LENSES[plan.folder])
    return kit


def photograph(kit: Kit, plan: LensPlan, lens: str) -> None:
    """Take the views of one lens by exact ray tracing."""
    target, width_mm = kit.targets[plan.target], kit.camera.sensor_width_mm
    frame = Frame(SIZE_PX, (width_mm, width_mm * SIZE_PX[1] / SIZE_PX[0]))
    camera, sensor = Camera(frame, Sensor()), Sensor()
    diameter = target.hole_diameter_mm or 0.1 * target.pitch_xy_mm[0]
    chart = Chart("dot-grid", target.pitch_xy_mm[0], diameter)
    folder = kit.folder_of(plan.folder)
    folder.mkdir()
    for seed, view in enumerate(plan.views):
        tilt, pan = _PAN[view.tilted] if view.tilted else (0.6, -0.8)
        pose = Pose(plan.target_distance_mm[0], tilt, pan, roll_deg=0.5)
        shot = Shot(
            view.slate,
            chart,
            pose,
            view.f_number,
            view.focus_distance_mm,
            view.focal_length_mm,
            form="png16",
            from_maps=True,
        )
        _, taken = take(load_prescription(lens), camera, shot, seed=seed)
        light = taken.image * (BRIGHTEST / float(taken.image.max()))
        picture = digitise(light, sensor, seed + 1)
        write_picture(folder / view.image, picture, "png16")
