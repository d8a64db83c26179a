"""Lens files of other programs, to be spoiled, and what an import does with them.

The fit of an import is left out, as it takes seconds; the lens is looked up at a few
points of its picture instead.
"""

from collections.abc import Callable
from pathlib import Path

import numpy as np

from lensfit.exchange.brown_conrady import D_U, U_D, BrownMap
from lensfit.exchange.foreign import ForeignLens, StatedValues
from lensfit.exchange.lensfun_lens import lens_of_lensfun
from lensfit.exchange.lensfun_xml import read_lensfun
from lensfit.exchange.mrcal import (
    SplinedMap,
    SplineGrid,
    mrcal_text,
    read_mrcal,
)
from lensfit.exchange.opencv import (
    OpenCvMap,
    lens_of_opencv,
    opencv_text,
    read_opencv,
)
from lensfit.exchange.opentrackio import (
    ColourShift,
    LensSample,
    opentrackio_text,
    read_opentrackio,
)
from lensfit.exchange.opentrackio_lens import lens_of_opentrackio
from lensfit.exchange.syntheyes import (
    LniNotes,
    RadialTable,
    read_syntheyes,
    syntheyes_text,
)
from lensfit.exchange.tde4 import KNOBS, Tde4Map
from lensfit.exchange.tde4_node import (
    lens_of_tde4,
    read_tde4_nodes,
    tde4_node_text,
)
from lensfit.exchange.unreal import UnrealState, read_unreal, unreal_text

_STATED = StatedValues(sensor_width_mm=24.0)
_MATRIX = np.array([[600.0, 0, 320], [0, 600, 240], [0, 0, 1]])

OPENCV_XML = """\
<?xml version="1.0"?>
<opencv_storage>
<image_width>640</image_width><image_height>480</image_height>
<camera_matrix type_id="opencv-matrix"><rows>3</rows><cols>3</cols><dt>d</dt>
<data>600. 0. 320. 0. 600. 240. 0. 0. 1.</data></camera_matrix>
<distortion_coefficients type_id="opencv-matrix"><rows>5</rows><cols>1</cols>
<dt>d</dt><data>-.1 .01 0. 0. 1e-3</data></distortion_coefficients>
</opencv_storage>
"""

LENSFUN = """\
<!DOCTYPE lensdatabase SYSTEM "lensfun-database.dtd">
<lensdatabase version="2">
<camera><maker>ARRI</maker><model>LF</model><cropfactor>0.98</cropfactor></camera>
<lens>
  <maker>Zeiss</maker><model>Planar 50</model><model lang="de">Planar</model>
  <mount>Generic</mount><cropfactor>1.5</cropfactor><aspect-ratio>3:2</aspect-ratio>
  <center x="0.01" y="-0.02"/>
  <calibration>
    <distortion model="ptlens" focal="24" a="0.01" b="-0.02" c="0.005"/>
    <distortion model="poly3" focal="50" k1="-0.01" real-focal="51.2"/>
    <distortion model="poly5" focal="70" k1="-0.01" k2="0.002"/>
    <tca model="poly3" focal="24" vr="1.0002" vb="0.9998" br="1e-5" cb="-1e-5"/>
    <tca model="linear" focal="50" kr="1.0001" kb="0.9999"/>
    <vignetting model="pa" focal="24" aperture="2.8" distance="10"
      k1="-0.3" k2="0.1" k3="-0.05"/>
    <vignetting model="pa" focal="24" aperture="4" distance="1000"
      k1="-0.2" k2="0.1" k3="-0.05"/>
  </calibration>
</lens>
</lensdatabase>
"""


def opencv_texts() -> tuple[str, ...]:
    """YAML of this program, and XML."""
    coefficients = np.linspace(-0.05, 0.05, 14)
    model = OpenCvMap(_MATRIX, coefficients, (640, 480), 0.01)
    return opencv_text(model, ("rms .1 px", "two: words")), OPENCV_XML


def opentrackio_texts() -> tuple[str, ...]:
    """One state, and two with lateral colour."""
    forward = BrownMap(D_U, (1e-3, 2e-4, -3e-6), (1e-5, -2e-5), (0.3, -0.1), 15.0)
    back = BrownMap(U_D, (-1e-3,), (), (0.3, -0.1), 15.0)
    shift = ColourShift(15.0, 1.1, (1e-3, 0.0), (1e-5, 0.0), (0.0, 1e-5), (1e-4, -1e-5))

    def sample(focal: float, **colour: ColourShift) -> LensSample:
        return LensSample(
            name="Fifty",
            sensor_size_mm=(24.0, 18.0),
            size_px=(2048, 1536),
            distortions=(forward, back),
            projection_offset_mm=(0.2, -0.1),
            pinhole_focal_length_mm=focal,
            nominal_focal_length_mm=focal,
            focus_distance_mm=2500.0,
            f_number=1.4,
            entrance_pupil_offset_mm=60.0,
            falloff=(1e-3, 2e-6, -1e-9),
            overscan=1.05,
            colour=colour,
            history=("lensfit",),
        )

    several = (sample(24.0, r=shift, b=shift), sample(70.0, r=shift, b=shift))
    return opentrackio_text((sample(50.0),)), opentrackio_text(several)


def tde4_texts() -> tuple[str, ...]:
    """A script with other nodes around each lens node that is known."""
    found = []
    for name, defaults in KNOBS.items():
        knobs = {knob: 0.01 for knob, value in defaults.items() if value == 0}
        model = Tde4Map(name, knobs, (24.0, 18.0), (0.1, -0.2))
        node = tde4_node_text(
            model,
            focal_length_mm=50.0,
            focus_distance_mm=2000.0,
            name="lens one",
            label='rms .1 px\n"worst" {.2} px',
        )
        found.append(f"Group {{\n inputs 0\n}}\n{node}Blur {{\n size {{{{9}}}}\n}}\n")
    return tuple(found)


def _five() -> OpenCvMap:
    coefficients = np.array([-0.1, 0.01, 1e-4, -1e-4, 1e-3, *[0.0] * 9])
    return OpenCvMap(_MATRIX, coefficients, (640, 480), 0.01)


def mrcal_texts() -> tuple[str, ...]:
    """OpenCV's coefficients, and splines."""
    grid = SplineGrid(3, 6, 5, 70)
    controls = np.linspace(-0.01, 0.01, 60).reshape(5, 6, 2)
    splined = SplinedMap((600, 600, 319.5, 239.5), grid, controls, (640, 480), 0.01)
    return tuple(mrcal_text(one, ("a lens",)) for one in (_five(), splined))


def unreal_texts() -> tuple[str, ...]:
    """Two states."""
    states = [UnrealState(_five(), focal, 2000.0) for focal in (24.0, 35.0)]
    return (unreal_text(states, "Zoom", "42", {"madeBy": "lensfit"}),)


def syntheyes_texts() -> tuple[str, ...]:
    """A table with its notes."""
    radii = np.linspace(0, 15, 12)
    table = RadialTable(radii, radii * (1 - 1e-4 * radii**2), (0.1, -0.2))
    notes = LniNotes(50.0, 51.0, 0.1, -0.2, 24.0, 640, 480, 2000.0)
    return (syntheyes_text(table, "Fifty", notes, ("a lens",)),)


def look_up(lens: ForeignLens) -> None:
    """Every state, over its picture and a little beyond."""
    width, height = lens.sensor_size_mm
    steps = np.linspace(-0.55, 0.55, 3)
    points = np.stack(np.meshgrid(steps * width, steps * height), -1).reshape(-1, 2)
    for state in lens.states[:3]:
        for found in (state.map.distorted(points), state.map.undistorted(points)):
            assert found.shape == points.shape
        for channel in state.channels.values():
            channel(points)
        for light in state.fall_off:
            light.illumination(points)


def _importer(read: Callable, lens_of: Callable) -> Callable[[Path], None]:
    def read_and_look_up(path: Path) -> None:
        with np.errstate(all="ignore"):
            look_up(lens_of(read(path), _STATED, path))

    return read_and_look_up


read_and_look_up_opencv = _importer(read_opencv, lens_of_opencv)
read_and_look_up_opentrackio = _importer(read_opentrackio, lens_of_opentrackio)
read_and_look_up_lensfun = _importer(read_lensfun, lens_of_lensfun)
read_and_look_up_tde4 = _importer(read_tde4_nodes, lens_of_tde4)


def _stated_importer(read: Callable) -> Callable[[Path], None]:
    def read_and_look_up(path: Path) -> None:
        with np.errstate(all="ignore"):
            look_up(read(path, _STATED))

    return read_and_look_up


read_and_look_up_mrcal = _stated_importer(read_mrcal)
read_and_look_up_unreal = _stated_importer(read_unreal)
read_and_look_up_syntheyes = _stated_importer(read_syntheyes)
