"""Out to another program and back: every pixel of the frame, and what is said."""

import json
from pathlib import Path

import numpy as np
import pytest
from exchange_presets import SENSOR_MM, SIZE_PX, make_entry, make_lopsided, make_preset

from lensfit.batches import in_batches
from lensfit.coords import mm_from_px
from lensfit.errors import ExchangeError, LensfitError
from lensfit.exchange.export import FORMATS, export_preset
from lensfit.exchange.export_request import ExportRequest, WantedState
from lensfit.exchange.foreign import StatedValues
from lensfit.exchange.imports import import_preset, read_foreign
from lensfit.exchange.samples import ExchangeFrame
from lensfit.preset.schema import Preset
from lensfit.preset.store import load_preset, save_preset

FRAME = ExchangeFrame(SIZE_PX, SENSOR_MM[0])
STATED = StatedValues(sensor_width_mm=SENSOR_MM[0], size_px=SIZE_PX)
FITTED = ("nuke-radial", "nuke-anamorphic", "opentrackio", "opencv", "lensfun")


def request(preset: Preset, out: Path, **state: float) -> ExportRequest:
    return ExportRequest(preset, WantedState(**state), FRAME, out)


def every_pixel_mm() -> np.ndarray:
    x, y = np.meshgrid(np.arange(SIZE_PX[0]) + 0.5, np.arange(SIZE_PX[1]) + 0.5)
    return mm_from_px(np.stack([x.ravel(), y.ravel()], -1), SIZE_PX, SENSOR_MM)


def apart_px(first, second, channel="g") -> np.ndarray:
    """Distance, on the photograph, of rays that land on every pixel of the first."""
    points = every_pixel_mm()
    straight = in_batches(
        lambda p: first.undistorted_from_distorted(p, channel), points
    )
    # the direction of a ray counts, not where the undistorted pictures put it
    one, two = first.distortion, second.distortion
    rays = (straight - np.asarray(one.principal_point_mm)) / float(
        one.principal_distance_mm
    )
    undistorted = np.asarray(two.principal_point_mm) + rays * float(
        two.principal_distance_mm
    )
    landed = in_batches(
        lambda p: second.distorted_from_undistorted(p, channel), undistorted
    )
    return np.linalg.norm(landed - points, axis=-1) / FRAME.pitch_mm


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("exchange")


@pytest.mark.slow
@pytest.mark.parametrize("to", FITTED)
@pytest.mark.parametrize(
    "preset", [make_preset(), make_lopsided()], ids=["round", "lopsided"]
)
def test_every_pixel_is_as_far_off_as_was_said(folder: Path, to: str, preset: Preset):
    path = folder / to
    written = export_preset(to, request(preset, path))
    said = written.nearness[0].residual
    assert said is not None
    imported = import_preset(path, STATED)
    save_preset(imported.preset, folder / "back.json")
    lens = load_preset(folder / "back.json").at()
    # lensfun's file knows no principal distance: then the pictures are compared
    if to == "lensfun":
        points = every_pixel_mm()
        straight = in_batches(preset.at().undistorted_from_distorted, points)
        landed = in_batches(lens.distorted_from_undistorted, straight)
        off = np.linalg.norm(landed - points, axis=-1) / FRAME.pitch_mm
    else:
        off = apart_px(preset.at(), lens)
    own = imported.fits[0].distortion
    assert own.worst_px < 0.01
    assert np.sqrt(np.mean(off**2)) == pytest.approx(said.rms_px, rel=0.1, abs=0.002)
    assert off.max() == pytest.approx(said.worst_px, rel=0.1, abs=0.02)
    assert (said.worst_px > 0.5) == any("cannot hold" in n for n in written.notes)


def test_colour_and_fall_off_come_back_where_the_format_has_them(folder: Path):
    preset = make_preset()
    for to, limit_px in (("opentrackio", 0.02), ("lensfun", 0.05)):
        export_preset(to, request(preset, folder / to, f_number=1.4))
        back = import_preset(folder / to, STATED).preset
        points = every_pixel_mm()[::97]
        mine, theirs = preset.at(f_number=1.4), back.at(f_number=1.4)
        for channel in ("r", "b"):
            landed = [
                np.asarray(
                    lens.distorted_from_undistorted(points, channel)
                    - lens.distorted_from_undistorted(points, "g")
                )
                for lens in (mine, theirs)
            ]
            off = np.linalg.norm(landed[0] - landed[1], axis=-1) / FRAME.pitch_mm
            assert off.max() < limit_px
        light = [np.asarray(k.relative_illumination(points)) for k in (mine, theirs)]
        assert np.abs(light[0] - light[1]).max() < 0.01


@pytest.mark.slow
def test_uv_maps_come_back_as_the_lens_they_were_made_of(folder: Path):
    preset = make_preset(
        make_entry(projection=make_entry().projection.__class__(51.0, (0.0, 0.0), 60.0))
    )
    written = export_preset(
        "stmap",
        ExportRequest(
            preset,
            WantedState(),
            ExchangeFrame(SIZE_PX, SENSOR_MM[0], 12.0),
            folder / "maps",
            per_channel=True,
        ),
    )
    for path in written.paths:
        back = import_preset(path, StatedValues(focal_length_mm=51.0))
        off = apart_px(preset.at(), back.preset.at())
        assert off.max() < 5e-3
        for channel in ("r", "b"):
            assert apart_px(preset.at(), back.preset.at(), channel).max() < 5e-3


def make_zoom() -> Preset:
    return make_preset(
        make_entry(24.0, 1000.0), make_entry(24.0, 5000.0), make_entry(70.0, 5000.0)
    )


@pytest.mark.slow
def test_a_zoom_goes_as_a_table_and_comes_back_as_entries(folder: Path):
    zoom = make_zoom()
    export_preset("opentrackio", request(zoom, folder / "zoom.json"))
    assert len(json.loads((folder / "zoom.json").read_text())) == 3
    back = import_preset(folder / "zoom.json", STATED).preset
    states = [(e.focal_length_mm, e.focus_distance_mm) for e in back.entries]
    assert states == [(24.0, 1000.0), (24.0, 5000.0), (70.0, 5000.0)]
    measured = {"focal_length_mm": 24.0, "focus_distance_mm": 1000.0}
    between = {"focal_length_mm": 40.0, "focus_distance_mm": 5000.0}
    assert apart_px(zoom.at(**measured), back.at(**measured)).max() < 0.02
    # other coefficients for the same entries, other numbers between them
    assert apart_px(zoom.at(**between), back.at(**between)).max() < 0.3

    written = export_preset("lensfun", request(zoom, folder / "zoom.xml"))
    assert any("no focus distance" in note for note in written.notes)
    back = import_preset(folder / "zoom.xml", STATED).preset
    assert [e.focal_length_mm for e in back.entries] == [24.0, 70.0]


def test_a_format_of_one_state_wants_one_state_of_a_zoom(folder: Path):
    zoom = make_zoom()
    one = request(
        zoom, folder / "one.json", focal_length_mm=70.0, focus_distance_mm=5e3
    )
    export_preset("opentrackio", one)
    assert json.loads((folder / "one.json").read_text())["lens"]["focusDistance"] == 5.0
    with pytest.raises(LensfitError, match="--focal-length-mm"):
        export_preset("opencv", request(zoom, folder / "zoom.yaml"))


def test_a_moved_and_magnified_picture_keeps_the_direction_of_rays(folder: Path):
    """dC moves the undistorted picture, an uneven squeeze magnifies it."""
    path = folder / "moved.json"
    path.write_text(
        json.dumps(
            {
                "lens": {
                    "distortion": [{"radial": [5e-4], "tangential": [0.0, 0.0]}],
                    "distortionOffset": {"x": 0.5, "y": -0.3},
                    "projectionOffset": {"x": 0.1, "y": 0.2},
                    "pinholeFocalLength": 35.0,
                }
            }
        )
    )
    theirs = read_foreign(path, STATED).states[0]
    found = import_preset(path, STATED)
    lens = found.preset.at()
    assert any("is moved by" in note for note in found.notes)
    rays = np.array([[0.0, 0.0], [0.2, -0.15], [-0.3, 0.2]])
    undistorted = np.array(theirs.principal_point_mm) + rays * 35.0
    known = theirs.map.distorted(undistorted)
    objects = np.column_stack([rays * 1e6, np.full(3, 1e6)])
    objects[:, 2] += float(lens.entrance_pupil_offset_mm)
    landed = np.asarray(lens.project(objects))
    assert np.abs(landed - known).max() / FRAME.pitch_mm < 5e-3


def test_an_imported_preset_says_what_it_does_not_know(folder: Path):
    export_preset("opencv", request(make_preset(), folder / "c.yaml"))
    found = import_preset(folder / "c.yaml", STATED)
    assert any("no uncertainty and no blur" in note for note in found.notes)
    (entry,) = found.preset.entries
    assert entry.covariance is None
    assert entry.blur is None
    assert entry.projection.assumed == ("entrance_pupil_offset_mm",)
    assert "imported from OpenCV" in entry.terms[0].reason
    assert found.preset.provenance.images[0].path == "c.yaml"


def test_nuke_gets_maps_that_are_there(folder: Path):
    written = export_preset("nuke-stmap", request(make_preset(), folder / "n" / "a.nk"))
    text = written.paths[0].read_text()
    for path in written.paths[1:]:
        assert path.is_file()
        assert path.parent == folder / "n"
        assert f'file "{path.as_posix()}"' in text
    assert text.count("\nSTMap {") == 2
    assert text.count("raw true") == 2
    # what is pushed last is input 0: the plate
    order = [text.index(word) for word in ("Read {", "NoOp {", "STMap {")]
    assert order == sorted(order)


def test_what_is_no_lens_is_one_sentence(folder: Path):
    with pytest.raises(ExchangeError, match="is no format; known are"):
        export_preset("maya", request(make_preset(), folder / "x"))
    assert "nuke-radial" in FORMATS
    (folder / "words.txt").write_text("hello")
    with pytest.raises(ExchangeError, match="is of no format that is known here"):
        import_preset(folder / "words.txt", STATED)
    (folder / "fold.yaml").write_text(
        "%YAML:1.0\n---\nimage_width: 640\nimage_height: 480\ncamera_matrix: "
        "[400, 0, 320, 0, 400, 240, 0, 0, 1]\n"
        "distortion_coefficients: [-2, 0, 0, 0]\n"
    )
    with pytest.raises(ExchangeError, match=r"fold.yaml: .* 90 degrees"):
        import_preset(folder / "fold.yaml", STATED)


@pytest.mark.parametrize(
    ("changed", "to", "said"),
    [
        ("[400, 0", "[1e300, 0", "is not one of a camera"),
        ("width: 640", "width: 1", "is not one of a camera"),
        ("-0.1", "1e300", "turns over, on the axis"),
        ("320", "1e12", "turns over, on the axis"),
    ],
)
def test_a_camera_that_cannot_be_is_one_sentence(
    folder: Path, changed: str, to: str, said: str
):
    text = (
        "%YAML:1.0\n---\nimage_width: 640\nimage_height: 480\ncamera_matrix: "
        "[400, 0, 320, 0, 400, 240, 0, 0, 1]\n"
        "distortion_coefficients: [-0.1, 0, 0, 0]\n"
    )
    assert changed in text
    (folder / "odd.yaml").write_text(text.replace(changed, to))
    with pytest.raises(ExchangeError, match=said):
        import_preset(folder / "odd.yaml", StatedValues(sensor_width_mm=24.0))
