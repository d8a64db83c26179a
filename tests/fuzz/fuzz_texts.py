"""Small text files with every table that they may have, to be spoiled."""

SHOOT = """\
[lens]
name = "SMC Takumar 50/1.4"
serial = "1234567"
[camera]
model = "ALEXA"
sensor_width_mm = 24.89
sensor_height_mm = 18.6675
[[target]]
name = "dots"
kind = "dot-grid"
pitch_mm = 37.5
hole_diameter_mm = 0.47
polarity = "bright"
[[target]]
name = "lines"
kind = "line-grid"
pitch_mm = [20.0, 21.0]
line_width_mm = 1.4
[[target]]
name = "board"
kind = "charuco"
pitch_mm = 30.0
squares = [8, 6]
dictionary = "DICT_5X5_250"
marker_ratio = 0.75
[[take]]
image = "dots_f1p4.exr"
target = "dots"
focal_length_mm = 50.0
f_number = 1.4
focus_distance_mm = inf
target_distance_mm = 2000.0
anamorphic_squeeze = 1.9
roi = [0, 0, 2048, 1536]
encoding = "linear"
[[take]]
image = "sub/lines.png"
target = "lines"
encoding = "srgb"
"""

SETTINGS = """\
[camera]
sensor_width_mm = 24.89
f_number = 2.8
[[frames]]
range = "1001-1050x2,1100"
focal_length_mm = 50
[[frames]]
at = [1001, 1020, 1050]
focus_distance_mm = [1500, 1500, inf]
t_number = [2, 2.8, 4.0]
[aliases]
focal_length_mm = ["myrenderer/focal", { key = "cam/fl", unit = "cm" }]
focus_distance_mm = { key = "cam/focus", factor = 304.8 }
lens_model = "cam/lens"
[knobs]
coma_gain = 0.5
"""
