"""A script for a Python that has `bpy`: Blender's Defocus node on one plate.

Run by `render.blender` in a process of its own, since Blender brings libraries that are
not to meet this program's. It reads its task from a JSON file and prints the seconds of
the compositing as JSON. Not part of the package's import graph: it imports no lensfit.
"""

import json
import sys
import time
from pathlib import Path

import bpy  # pyright: ignore[reportMissingImports]


def main(task_path: str) -> None:
    """Composite the picture of the task; see `blender.task_of`."""
    task = json.loads(Path(task_path).read_text())
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    _set_camera(scene, task)
    _set_nodes(scene, task)
    began = time.perf_counter()
    bpy.ops.render.render(write_still=False)
    spent = time.perf_counter() - began
    sys.stdout.write(json.dumps({"seconds": spent}) + "\n")


def _set_camera(scene, task: dict) -> None:
    data = bpy.data.cameras.new("camera")
    data.lens = task["focal_length_mm"]
    data.sensor_fit = "HORIZONTAL"
    data.sensor_width = task["sensor_width_mm"]
    data.dof.use_dof = True
    data.dof.focus_distance = task["focus_distance_m"]
    camera = bpy.data.objects.new("camera", data)
    scene.collection.objects.link(camera)
    scene.camera = camera
    scene.render.resolution_x, scene.render.resolution_y = task["size_px"]
    scene.render.resolution_percentage = 100


def _set_nodes(scene, task: dict) -> None:
    scene.use_nodes = True
    tree = scene.node_tree
    tree.nodes.clear()

    def picture(path: str):
        node = tree.nodes.new("CompositorNodeImage")
        node.image = bpy.data.images.load(path)
        node.image.colorspace_settings.name = "Non-Color"
        return node.outputs["Image"]

    defocus = tree.nodes.new("CompositorNodeDefocus")
    defocus.scene = scene
    defocus.use_zbuffer = True
    defocus.use_preview = False
    defocus.bokeh = "CIRCLE"
    defocus.f_stop = task["f_number"]
    defocus.blur_max = task["largest_blur_px"]
    tree.links.new(picture(task["colour"]), defocus.inputs["Image"])
    tree.links.new(picture(task["depth_m"]), defocus.inputs["Z"])
    out = tree.nodes.new("CompositorNodeOutputFile")
    out.base_path = task["folder"]
    out.format.file_format = "OPEN_EXR"
    out.format.color_depth = "32"
    out.format.color_management = "OVERRIDE"
    out.format.linear_colorspace_settings.name = "Non-Color"
    out.file_slots[0].path = task["name"]
    tree.links.new(defocus.outputs["Image"], out.inputs[0])
    composite = tree.nodes.new("CompositorNodeComposite")
    tree.links.new(defocus.outputs["Image"], composite.inputs[0])


if __name__ == "__main__":
    main(sys.argv[1])
