"""Renders luminous discs, or an even sky, through a camera shader with Cycles.

Run by a Python that has Blender's `bpy`, with a JSON file of what to render: "shader",
"out" (EXR), "size_px", "sensor_width_mm", "samples", "discs" (x, y, z and radius in mm,
x right, y down, z ahead of the entrance pupil), "sky" (radiance), "region" (columns and
rows of the first pixel and of that behind the last), "threads".
"""

import json
import sys
from pathlib import Path

import bpy
from mathutils import Vector

_MM_PER_UNIT = 1000.0
_CORNERS = 48


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
    material = _light()
    for disc in request.get("discs", []):
        _disc(scene, material, *disc)
    scene.render.filepath = request["out"]
    bpy.ops.render.render(write_still=True)


def _settings(scene, request: dict) -> None:
    scene.render.engine = "CYCLES"
    cycles, render = scene.cycles, scene.render
    cycles.device = "CPU"
    cycles.samples = request["samples"]
    cycles.use_adaptive_sampling = cycles.use_denoising = False
    cycles.pixel_filter_type = "BOX"
    cycles.sample_clamp_direct = cycles.sample_clamp_indirect = 0
    render.threads_mode, render.threads = "FIXED", request.get("threads", 2)
    width, height = render.resolution_x, render.resolution_y = request["size_px"]
    if "region" in request:
        x0, y0, x1, y1 = request["region"]
        render.use_border = render.use_crop_to_border = True
        # a quarter of a pixel more: Blender cuts fractions off
        render.border_min_x, render.border_max_x = (
            (x + 0.25) / width for x in (x0, x1)
        )
        render.border_min_y, render.border_max_y = (
            (height - y + 0.25) / height for y in (y1, y0)
        )
    render.image_settings.file_format = "OPEN_EXR"
    render.image_settings.color_depth = "32"
    render.image_settings.exr_codec = "ZIP"


def _camera(scene, request: dict) -> None:
    camera = bpy.data.cameras.new("camera")
    camera.sensor_width = request["sensor_width_mm"]
    camera.type, camera.custom_mode = "CUSTOM", "EXTERNAL"
    camera.clip_start = 1e-4
    camera.custom_filepath = request["shader"]
    thing = bpy.data.objects.new("camera", camera)
    scene.collection.objects.link(thing)
    scene.camera = thing


def _light():
    material = bpy.data.materials.new("light")
    material.use_nodes = True
    nodes, links = material.node_tree.nodes, material.node_tree.links
    nodes.clear()
    emission, output = (
        nodes.new(kind) for kind in ("ShaderNodeEmission", "ShaderNodeOutputMaterial")
    )
    emission.inputs[1].default_value = 1.0
    links.new(emission.outputs[0], output.inputs[0])
    return material


def _disc(scene, material, x: float, y: float, z: float, radius: float) -> None:
    from math import cos, pi, sin

    turns = [2 * pi * n / _CORNERS for n in range(_CORNERS)]
    ring = [Vector((radius * cos(t), radius * sin(t), 0)) / _MM_PER_UNIT for t in turns]
    mesh = bpy.data.meshes.new("disc")
    mesh.from_pydata(ring, [], [list(range(_CORNERS))])
    mesh.materials.append(material)
    thing = bpy.data.objects.new("disc", mesh)
    thing.location = Vector((x, -y, -z)) / _MM_PER_UNIT
    scene.collection.objects.link(thing)


if __name__ == "__main__":
    main(json.loads(Path(sys.argv[1]).read_text()))
