"""A script for a Python that has `bpy`: one picture by Cycles.

Run by `cycles.shaded_lens` in a process of its own, with a JSON file of what to
render. It imports no lensfit. Positions and lengths are millimetres before the entrance
pupil, x right, y down, z ahead; Blender's world has metres, y up, and looks along -z.

Keys: "out" (EXR), "size_px", "sensor_width_mm", "samples", "seed", "region"
(columns and rows of the first pixel and of that behind the last), "sky" (radiance).
The camera is that of the file "shader", or else a pinhole of "focal_length_mm" whose
axis meets the sensor at "axis_mm". "discs" are luminous (x, y, z, radius). "things"
are solids: "shape" (plane, ball, box, bar), "at_mm", "size_mm", "turn_deg" about z,
"colours" (two), "check_mm" of their pattern (0: none), "shaded" by a sun. With
"transparent" the picture has alpha; with "depth" it is the distance along the axis, in
metres, of what the pixels' centres show.
"""

import json
import sys
from math import cos, pi, radians, sin
from pathlib import Path

import bpy  # pyright: ignore[reportMissingImports]
from mathutils import Vector  # pyright: ignore[reportMissingImports]

_MM_PER_UNIT = 1000.0
_CORNERS = 48
_SUN = (-0.45, 0.75, 0.5)
_SHADOW = 0.25
"""Of the light on what faces the sun, on what does not."""
_OFF_THE_EDGE = 0.37
"""Of a square, so that no plane lies between two of them."""
_MOST_NARROW = 0.01


def main(request: dict) -> None:
    """Render one picture."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    _settings(scene, request)
    _camera(scene, request)
    world = bpy.data.worlds.new("sky")
    world.use_nodes = True
    sky = request.get("sky", 0.0)
    world.node_tree.nodes["Background"].inputs[0].default_value = (sky, sky, sky, 1)
    scene.world = world
    for disc in request.get("discs", []):
        _disc(*disc)
    for thing in request.get("things", []):
        _thing(thing)
    scene.render.filepath = request["out"]
    bpy.ops.render.render(write_still=True)


def _settings(scene, request: dict) -> None:
    scene.render.engine = "CYCLES"
    cycles, render = scene.cycles, scene.render
    cycles.device = "CPU"
    cycles.samples, cycles.seed = request["samples"], request.get("seed", 0)
    cycles.use_adaptive_sampling = cycles.use_denoising = False
    cycles.pixel_filter_type, cycles.filter_width = "BOX", 1.0
    cycles.sample_clamp_direct = cycles.sample_clamp_indirect = 0
    cycles.max_bounces = 0
    render.threads_mode, render.threads = "FIXED", 2
    render.resolution_x, render.resolution_y = request["size_px"]
    if "region" in request:
        _region(render, request["size_px"], request["region"])
    image = render.image_settings
    image.file_format = "OPEN_EXR"
    render.film_transparent = bool(request.get("transparent"))
    image.color_mode = "RGBA" if render.film_transparent else "RGB"
    if request.get("depth"):
        cycles.filter_width = _MOST_NARROW
        scene.view_layers[0].use_pass_z = True
        image.media_type = "MULTI_LAYER_IMAGE"
        image.file_format = "OPEN_EXR_MULTILAYER"
    image.color_depth, image.exr_codec = "32", "ZIP"


def _region(render, size_px: list[int], region: list[int]) -> None:
    """A quarter of a pixel more: Blender cuts fractions off."""
    (width, height), (x0, y0, x1, y1) = size_px, region
    render.use_border = render.use_crop_to_border = True
    render.border_min_x, render.border_max_x = ((x + 0.25) / width for x in (x0, x1))
    render.border_min_y, render.border_max_y = (
        (height - y + 0.25) / height for y in (y1, y0)
    )


def _camera(scene, request: dict) -> None:
    camera = bpy.data.cameras.new("camera")
    camera.sensor_fit = "HORIZONTAL"
    width_mm = camera.sensor_width = request["sensor_width_mm"]
    camera.clip_start, camera.clip_end = 1e-4, 1e4
    if "shader" in request:
        camera.type, camera.custom_mode = "CUSTOM", "EXTERNAL"
        camera.custom_filepath = request["shader"]
    else:
        camera.lens = request["focal_length_mm"]
        x_mm, y_mm = request["axis_mm"]
        camera.shift_x, camera.shift_y = -x_mm / width_mm, y_mm / width_mm
    thing = bpy.data.objects.new("camera", camera)
    scene.collection.objects.link(thing)
    scene.camera = thing


def _disc(x: float, y: float, z: float, radius: float) -> None:
    turns = [2 * pi * n / _CORNERS for n in range(_CORNERS)]
    ring = [Vector((radius * cos(t), radius * sin(t), 0)) / _MM_PER_UNIT for t in turns]
    mesh = bpy.data.meshes.new("disc")
    mesh.from_pydata(ring, [], [list(range(_CORNERS))])
    mesh.materials.append(_paint({"colours": [[1, 1, 1]]}))
    thing = bpy.data.objects.new("disc", mesh)
    thing.location = Vector((x, -y, -z)) / _MM_PER_UNIT
    bpy.context.scene.collection.objects.link(thing)


def _thing(wanted: dict) -> None:
    x, y, z = wanted["at_mm"]
    made = {
        "plane": lambda: bpy.ops.mesh.primitive_cube_add(size=1),
        "box": lambda: bpy.ops.mesh.primitive_cube_add(size=1),
        "ball": lambda: bpy.ops.mesh.primitive_uv_sphere_add(
            radius=0.5, segments=96, ring_count=48
        ),
        "bar": lambda: bpy.ops.mesh.primitive_cylinder_add(
            radius=0.5, depth=1, vertices=64, rotation=(pi / 2, 0, 0)
        ),
    }
    made[wanted["shape"]]()
    thing = bpy.context.object
    if wanted["shape"] == "bar":
        bpy.ops.object.transform_apply(location=False, rotation=True, scale=False)
    thing.scale = Vector(wanted["size_mm"]) / _MM_PER_UNIT
    thing.location = Vector((x, -y, -z)) / _MM_PER_UNIT
    thing.rotation_euler = (0, 0, radians(wanted.get("turn_deg", 0.0)))
    for face in thing.data.polygons:
        face.use_smooth = wanted["shape"] in ("ball", "bar")
    thing.data.materials.append(_paint(wanted))


def _paint(wanted: dict):
    """Light of its own alone, so that every ray that meets it brings the same."""
    material = bpy.data.materials.new("paint")
    material.use_nodes = True
    nodes, links = material.node_tree.nodes, material.node_tree.links
    nodes.clear()
    emission = nodes.new("ShaderNodeEmission")
    output = nodes.new("ShaderNodeOutputMaterial")
    links.new(emission.outputs[0], output.inputs[0])
    first = wanted["colours"][0]
    emission.inputs[0].default_value = (*first, 1)
    if wanted.get("check_mm"):
        links.new(_checks(nodes, links, wanted), emission.inputs[0])
    if wanted.get("shaded"):
        links.new(_sunlight(nodes, links), emission.inputs[1])
    return material


def _checks(nodes, links, wanted: dict):
    geometry, moved = (
        nodes.new("ShaderNodeNewGeometry"),
        nodes.new("ShaderNodeVectorMath"),
    )
    pattern = nodes.new("ShaderNodeTexChecker")
    side = wanted["check_mm"] / _MM_PER_UNIT
    moved.inputs[1].default_value = (_OFF_THE_EDGE * side,) * 3
    links.new(geometry.outputs["Position"], moved.inputs[0])
    links.new(moved.outputs[0], pattern.inputs["Vector"])
    for number, colour in enumerate(wanted["colours"], 1):
        pattern.inputs[f"Color{number}"].default_value = (*colour, 1)
    pattern.inputs["Scale"].default_value = 1 / side
    return pattern.outputs["Color"]


def _sunlight(nodes, links):
    """Of Lambert's law, and some everywhere; nothing casts a shadow."""
    geometry, dot = (
        nodes.new("ShaderNodeNewGeometry"),
        nodes.new("ShaderNodeVectorMath"),
    )
    dot.operation = "DOT_PRODUCT"
    dot.inputs[1].default_value = Vector(_SUN).normalized()
    links.new(geometry.outputs["Normal"], dot.inputs[0])
    lit = nodes.new("ShaderNodeMapRange")
    lit.inputs["To Min"].default_value = _SHADOW
    links.new(dot.outputs["Value"], lit.inputs["Value"])
    return lit.outputs["Result"]


if __name__ == "__main__":
    main(json.loads(Path(sys.argv[1]).read_text()))
