"""The bundled shoot, whole, and without its blur: calibrated in seconds then."""

import re
from importlib.resources import files
from pathlib import Path

import msgspec

from data_synth.make_demo import FOCUS_MM
from lensfit.workflow.shoot.shoot_file import load_shoot
from lensfit.workflow.shoot.shoot_records import Shoot

DEMO = Path(str(files("data_synth") / "demo"))
PHOTOGRAPHS = [DEMO / take.image for take in load_shoot(DEMO / "shoot.toml").takes]


def shoot_text_without_blur() -> str:
    """Of a shoot file that does not say how wide the holes are."""
    text, count = re.subn("hole_diameter_mm.*\n", "", (DEMO / "shoot.toml").read_text())
    assert count == 1
    return text


def demo_in_focus() -> Shoot:
    """Its dots straight on and tilted, and its lines, nothing said of the holes."""
    shoot = load_shoot(DEMO / "shoot.toml")
    takes = [take for take in shoot.takes if take.focus_distance_mm == FOCUS_MM]
    targets = {
        name: msgspec.structs.replace(target, hole_diameter_mm=None)
        for name, target in shoot.targets.items()
    }
    return msgspec.structs.replace(shoot, takes=tuple(takes), targets=targets)
