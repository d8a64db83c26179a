"""The bundled shoot without its blur, so that it is calibrated in seconds.

Its three photographs that are in focus, and nothing said of how large the holes are.
"""

from importlib.resources import files
from pathlib import Path

import msgspec

from lensfit.workflow.shoot.file import load_shoot
from lensfit.workflow.shoot.records import Shoot

DEMO = Path(str(files("data_synth") / "demo"))


def demo_in_focus() -> Shoot:
    """Of its dots straight on and tilted, and its lines."""
    shoot = load_shoot(DEMO / "shoot.toml")
    takes = [take for take in shoot.takes if take.focus_distance_mm == 1500.0]
    targets = {
        name: msgspec.structs.replace(target, hole_diameter_mm=None)
        for name, target in shoot.targets.items()
    }
    return msgspec.structs.replace(shoot, takes=tuple(takes), targets=targets)
