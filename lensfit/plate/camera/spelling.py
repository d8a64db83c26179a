"""Spelling of camera quantities: in sentences, and as options."""

SPELT = {
    "focal_length_mm": "focal length",
    "f_number": "f-number",
    "focus_distance_mm": "focus distance",
    "sensor_width_mm": "sensor width",
}
"""Those that a frame depends on."""


def option_of(name: str) -> str:
    """The option that states a quantity or a knob."""
    return "--" + name.replace("_", "-")
