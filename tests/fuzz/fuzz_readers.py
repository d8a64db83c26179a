"""Readers of files of unknown origin, and files to spoil.

All but those of USD, camera reports and kits.

A reader is a name, a maker of whole files, a function that does with a file what
commands do before anything is rendered or written, and the mutations that suit it.
None of them needs JAX. A reader may raise a `LensfitError` and nothing else.
"""

import contextlib
import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

# Makers of files live with the tests of their rooms.
sys.path += [str(Path(__file__).parents[1] / room) for room in ("", "preset")]

import camera_files
import fuzz_exchange as exchange
import fuzz_pictures as pictures
from exr_mutations import EXR
from fuzz_texts import SETTINGS, SHOOT
from library_makers import SLUG, SQUEEZE, change, keep
from mutations import BYTES, JSON, TEXT, XML, Mutation
from preset_makers import make_blur, make_entry, make_preset

from lensfit.errors import CameraError
from lensfit.io.camera.read_camera_file import read_camera_file
from lensfit.io.camera.table import FrameKey
from lensfit.io.cryptomatte import find_cryptomattes, read_ranks
from lensfit.io.depth_channel import depth_over_window, find_depth
from lensfit.io.exr import (
    ExrImage,
    ExrPart,
    find_colour,
    read_exr,
    stack_channels,
    write_exr,
)
from lensfit.io.exr_deep import is_deep, read_deep
from lensfit.io.image import camera_state_of, read_photograph
from lensfit.io.metadata import camera_state_from
from lensfit.io.raster import tiff_header
from lensfit.io.stmap import read_stmap
from lensfit.plate.camera import settings as settings_module
from lensfit.plate.camera.settings import load_settings
from lensfit.plate.camera.sources import CameraOptions, CameraSources
from lensfit.preset.library.catalogue import catalogue, validation_faults
from lensfit.preset.library.layers import find_preset
from lensfit.preset.library.levels import levels_of
from lensfit.preset.store import load_preset, preset_text
from lensfit.workflow.inspect import as_json, facts, inspect_images
from lensfit.workflow.shoot.shoot_file import load_shoot

Seeds = Callable[[Path], list[Path]]


def _stream(folder: Path) -> list[Path]:
    return texts("track.json", *exchange.opentrackio_texts())(folder)


class Reader(NamedTuple):
    """One kind of file.

    Attributes
    ----------
    name : Of the kind.
    seeds : Makes whole files in an empty folder, and names those to spoil.
    read : What commands do with one.
    mutations : That suit it.
    files : How many are spoiled in the whole run.
    most_mib : Memory that one of them may take: a frame of 8K, for a few of its pixels.
    """

    name: str
    seeds: Seeds
    read: Callable[[Path], object]
    mutations: tuple[Mutation, ...]
    files: int
    most_mib: int = 128


def _plate(path: Path) -> None:
    image = read_exr(path)
    for crypto in find_cryptomattes(image, path):
        read_ranks(crypto, 2)
    index, names = find_colour(image)
    part = image.parts[index]
    stack_channels(part, names)
    if found := find_depth(image, beside=part):
        depth_over_window(found.part, found.name, part.data_window)
    CameraSources().of_plate(path, part.attributes, (27, 20), 36.0)


def _header(path: Path) -> None:
    for part in read_exr(path, header_only=True).parts:
        CameraSources().of_plate(path, part.attributes, (27, 20))


def _deep(path: Path) -> None:
    if not is_deep(path):
        return _plate(path)
    deep = read_deep(path)
    assert all(len(flat) == deep.counts.sum() for flat in deep.samples.values())
    return None


def _photograph(path: Path) -> None:
    found = read_photograph(path)
    assert found.pixels.ndim == 3
    inspections, errors = inspect_images([path])
    for inspection in inspections:
        json.dumps(as_json(inspection))
        facts(inspection)
    for error in errors:
        raise error
    camera_state_of(found)


def _raw_header(path: Path) -> None:
    camera_state_from(tiff_header(path.read_bytes()), (24, 20))


def _camera(path: Path) -> None:
    file = read_camera_file(path)
    sources = CameraSources(CameraOptions((path,), first_frame=0))
    sources.of_plate("plate.0000.exr", {}, (96, 64), 36.0)
    with contextlib.suppress(CameraError):  # it may have no such frame
        file.at(FrameKey(1001, "10:00:00:01"), None)


def _preset(path: Path) -> None:
    preset = load_preset(path)
    preset_text(preset, path)
    preset.select(preset.entries[0].focal_length_mm, 2.8, 1500.0)


def _library(path: Path) -> None:
    library = path.parents[2]
    catalogue(levels_of(library))
    validation_faults(library)
    find_preset(SLUG, library)
    if path.name != "default.json":
        find_preset(path)


def _manifest(path: Path) -> None:
    find_cryptomattes(read_exr(path.parent / "plate.exr"), path)


def _settings(path: Path) -> None:
    settings_module._level.cache_clear()
    settings = load_settings(path)
    for frame in (None, -5, 0, 1001, 1030, 2**40):
        list(settings.camera_at(frame))
    header = {"cam/fl": "3.5", "cam/focus": 4.0}
    sources = CameraSources(CameraOptions(settings=path))
    sources.of_plate("plate.1001.exr", header, (96, 64), 36.0)


def _presets(folder: Path) -> list[Path]:
    zoom = make_entry(focal_length_mm=70.0, blur=make_blur())
    presets = {"one": make_preset(), "zoom": make_preset(make_entry(), zoom)}
    made = []
    for name, preset in presets.items():
        made.append(folder / f"{name}.json")
        made[-1].write_text(preset_text(preset, made[-1]), encoding="utf-8")
    return made


def _library_files(folder: Path) -> list[Path]:
    """A version, a change set on it, another on that, and the default mark."""
    first = keep(folder, default=True).path
    second = change(folder, "coma_gain", 0.5).path
    third = change(folder, SQUEEZE, 2.0, unlock=True).path
    return [third, second, first, first.with_name("default.json")]


def _manifests(folder: Path) -> list[Path]:
    path = folder / "manifest.json"
    names = {"wire": "deadbeef", "a/b": "00000001", "é": "ffffffff"}
    path.write_text(json.dumps(names), encoding="utf-8")
    part = read_exr(pictures.plates(folder)[0]).parts[0]
    header = {k: v for k, v in part.attributes.items() if "manifest" not in k}
    header["cryptomatte/1/manif_file"] = path.name
    plate = ExrPart(part.channels, part.data_window, part.display_window, header)
    write_exr(folder / "plate.exr", ExrImage((plate,)))
    return [path]


def texts(name: str, *texts: str) -> Seeds:
    def make(folder: Path) -> list[Path]:
        made = [folder / f"{at}_{name}" for at in range(len(texts))]
        for path, text in zip(made, texts, strict=True):
            path.write_text(text, encoding="utf-8")
        return made

    return make


def _one(make: Callable[..., Path], *rows: object, **named: object) -> Seeds:
    return lambda folder: [make(folder, *rows, **named)]


_CURVE = "focal {{curve x1001 35 s0.5 x1050 50 K 51 52}}"
_KNOBS = (_CURVE, "haperture 24.9", 'label "a {b} \\" c"', "focal_point {2.5}")

READERS: tuple[Reader, ...] = (
    Reader("EXR plate", pictures.plates, _plate, EXR, 2800),
    Reader("EXR header", pictures.plates, _header, EXR, 800),
    Reader("EXR deep plate", pictures.deep_plates, _deep, EXR, 1200),
    Reader("EXR map", pictures.maps, read_stmap, EXR, 300),
    Reader("EXR photograph", pictures.plates, _photograph, EXR, 300, 1024),
    Reader("PNG", pictures.pngs, _photograph, pictures.PNG, 500),
    Reader("JPEG", pictures.jpegs, _photograph, BYTES, 500),
    Reader("TIFF", pictures.tiffs, _photograph, BYTES, 700),
    Reader("raw header", pictures.tiffs, _raw_header, BYTES, 200),
    Reader("ARRI", _one(camera_files.arri, {}, {}), _camera, TEXT, 300),
    Reader("RED frames", _one(camera_files.red_frames, 410, 9), _camera, TEXT, 200),
    Reader("RED static", _one(camera_files.red_static), _camera, TEXT, 200),
    Reader("Sony", _one(camera_files.sony, "T 2 3/10", "F4"), _camera, TEXT, 200),
    Reader("Canon", _one(camera_files.canon), _camera, TEXT, 200),
    Reader("Blackmagic", _one(camera_files.blackmagic, "1m"), _camera, TEXT, 200),
    Reader(
        "ALE", _one(camera_files.ale, camera_files.ALE_CLIPS[0]), _camera, TEXT, 200
    ),
    Reader("Sony XML", _one(camera_files.sony_xml), _camera, XML, 200),
    Reader("Mo-Sys F4", _one(camera_files.mosys), _camera, BYTES, 300),
    Reader("chan", _one(camera_files.chan, f0=29, f1001=30), _camera, TEXT, 200),
    Reader("OpenTrackIO stream", _stream, _camera, JSON, 500),
    Reader("nk camera", _one(camera_files.nuke, *_KNOBS), _camera, TEXT, 500),
    Reader("preset", _presets, _preset, JSON, 600),
    Reader("library", _library_files, _library, JSON, 600),
    Reader("manifest", _manifests, _manifest, JSON, 200),
    Reader("settings", texts("lensfit.toml", SETTINGS), _settings, TEXT, 600),
    Reader("shoot", texts("shoot.toml", SHOOT), load_shoot, TEXT, 600),
    Reader(
        "OpenCV",
        texts("camera", *exchange.opencv_texts()),
        exchange.read_and_look_up_opencv,
        XML,
        500,
    ),
    Reader(
        "OpenTrackIO",
        texts("sample.json", *exchange.opentrackio_texts()),
        exchange.read_and_look_up_opentrackio,
        JSON,
        500,
    ),
    Reader(
        "lensfun",
        texts("lens.xml", exchange.LENSFUN),
        exchange.read_and_look_up_lensfun,
        XML,
        500,
    ),
    Reader(
        "nk lens",
        texts("lens.nk", *exchange.tde4_texts()),
        exchange.read_and_look_up_tde4,
        TEXT,
        500,
    ),
    Reader(
        "mrcal camera model",
        texts("cam.cameramodel", *exchange.mrcal_texts()),
        exchange.read_and_look_up_mrcal,
        TEXT,
        500,
    ),
    Reader(
        "Unreal lens file",
        texts("lens.ulens", *exchange.unreal_texts()),
        exchange.read_and_look_up_unreal,
        JSON,
        500,
    ),
    Reader(
        "SynthEyes lens",
        texts("lens.lni", *exchange.syntheyes_texts()),
        exchange.read_and_look_up_syntheyes,
        XML,
        500,
    ),
)
