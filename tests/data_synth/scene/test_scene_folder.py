"""`lensfit synth scene`: what lies in its folder, and what is wrong usage."""

import json

import numpy as np
import pytest
from command_line import run
from scene_lens import focused, lamp_layer, scene_of
from wrong_usage import told_of_wrong_usage

from data_synth.scene.exposure import Exposed, expose_scene
from data_synth.scene.folder import noise_figures
from data_synth.scene.layers import Layer, square_plane
from data_synth.scene.paints import Checker
from data_synth.scene.sampling import Sampling, sampling_of
from data_synth.scene.shapes import Everywhere
from data_synth.sensor import Frame
from lensfit.io.exr import read_exr
from lensfit.io.exr_deep import read_deep

pytestmark = pytest.mark.slow

WORDS = ("--lens", "petzval_50", "--f-number", "4", "--focus-distance-mm", "1500")


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    folder = tmp_path_factory.mktemp("scene")
    words = ("synth", "scene", *WORDS, "--size", "32x18", "--rays", "24", "--seed", "2")
    done = run(*words, "--out", folder, "--json")
    assert done.exit_code == 0, done.output
    assert json.loads(done.stdout) == {"scene": str(folder / "scene.json")}
    return folder


def colours(part, names="RGBA"):
    return np.stack([part.channels[n].astype(float) for n in names], -1)


def test_the_folder_holds_photograph_plates_and_description(written):
    table = json.loads((written / "scene.json").read_text())
    assert table["lens"] == "petzval_50"
    assert table["f_number"] == 4.0
    assert table["focus_from_sensor_mm"] == 1500.0
    assert table["photo_size"] == [32, 18]
    assert table["noise_psnr_4x4_db"] > 30
    assert len(table["highlights"]) > 30
    photograph = read_exr(written / "photo_reference.exr").parts[0]
    assert photograph.channels["G"].shape == (18, 32)
    flat = read_exr(written / "cg_flat.exr").parts[0]
    assert flat.display_window == (0, 0, 31, 17)
    assert [flat.data_window.width, flat.data_window.height] == table["plate_size"]
    assert flat.attributes["lens/fstop"] == 4.0
    assert flat.attributes["lens/focus"] == pytest.approx(1.5)
    assert len(list(written.glob("cg_layer*.exr"))) == len(table["layers"])
    assert flat.channels["Z"].dtype == np.float32


def test_photograph_and_plate_show_the_same_scene(written):
    """In the mean over the frame; the lens blurs and darkens, and moves little."""
    photograph = colours(read_exr(written / "photo_reference.exr").parts[0], "RGB")
    plate = read_exr(written / "cg_flat.exr").parts[0]
    left, top = -plate.data_window.x_min, -plate.data_window.y_min
    pinhole = colours(plate, "RGB")[top : top + 18, left : left + 32]
    shown, seen = np.clip(photograph, 0, 1), np.clip(pinhole, 0, 1)
    assert shown.mean() == pytest.approx(seen.mean(), rel=0.12)
    same = np.corrcoef(shown.ravel(), seen.ravel())[0, 1]
    mirrored = np.corrcoef(shown[:, ::-1].ravel(), seen.ravel())[0, 1]
    assert same > 0.8 > mirrored


def test_the_deep_plate_holds_the_layers(written):
    deep = read_deep(written / "cg_deep.exr")
    paths = sorted(written.glob("cg_layer*.exr"))
    layers = [read_exr(path).parts[0] for path in paths]
    covered = np.stack([part.channels["A"] > 0 for part in layers])
    np.testing.assert_array_equal(deep.counts, covered.sum(axis=0))
    total = sum(part.channels["R"].astype(float).sum() for part in layers)
    assert deep.samples["R"].astype(float).sum() == pytest.approx(total, rel=1e-6)
    ends = np.cumsum(deep.counts.ravel())
    for first, last in zip([0, *ends[:-1]], ends, strict=True):
        assert (np.diff(deep.samples["Z"][first:last]) >= 0).all()


@pytest.mark.parametrize(
    ("words", "says"),
    [
        ((), "--lens"),
        (("--lens", "nosuch"), "no prescription named nosuch"),
        (("--lens", "petzval_50", "--f-number", "1"), "opens to 2"),
        (("--lens", "petzval_50", "--focus-distance-mm", "20"), "ten focal lengths"),
        (("--lens", "petzval_50", "--size", "9x9"), "WIDTHxHEIGHT"),
        (("--lens", "petzval_50", "--rays", "0"), "--rays"),
    ],
)
def test_wrong_use_is_told_and_exits_with_two(words, says, tmp_path):
    out = tmp_path / "never"
    assert says in told_of_wrong_usage("synth", "scene", *words, "--out", str(out))
    assert not out.exists()


def test_an_anamorphic_lens_is_one_line_and_leaves_nothing(tmp_path):
    out = tmp_path / "never"
    words = ["synth", "scene", "--lens", "schneider_31", "--out", str(out)]
    done = run(*words)
    assert done.exit_code == 1
    assert done.stderr.count("\n") == 1
    assert "schneider_31: is anamorphic" in done.stderr
    assert not out.exists()


def test_the_stated_standard_error_is_that_between_photographs():
    """Two photographs with other rays differ by the root of two of it."""
    lens = focused("petzval_50", 4.0)
    checks = Checker((0.9, 0.9, 0.9), (0.1, 0.1, 0.1), (40.0, 40.0))
    scene = scene_of(
        lamp_layer(2500.0, (100.0, 50.0), 4.0, 50.0),
        Layer("cloth", square_plane(3000.0), Everywhere(), checks),
    )
    frame = Frame((24, 16), (12.0, 8.0))
    sampling = Sampling(exposures=4, rays_per_pixel=1)
    one, same, other = (
        expose_scene(lens, scene, frame, sampling, seed=seed) for seed in (1, 1, 2)
    )
    np.testing.assert_array_equal(one.image, same.image)
    between = np.sqrt(((one.image - other.image) ** 2).mean() / 2)
    stated = np.sqrt((one.standard_error**2 + other.standard_error**2).mean() / 2)
    assert between == pytest.approx(stated, rel=0.25)
    assert stated > 1e-3


def test_noise_is_stated_as_it_is_shown():
    """A sample above 1 is shown as 1, without noise; 16 samples average."""
    image = np.full((8, 8, 3), 0.5)
    image[:, 4:] = 7.0
    figures = noise_figures(Exposed(image, np.full((8, 8, 3), 0.02)))
    assert figures["noise_rms"] == pytest.approx(0.02 / np.sqrt(2))
    expected = -20 * np.log10(0.02 / np.sqrt(2) / 4)
    assert figures["noise_psnr_4x4_db"] == pytest.approx(expected, abs=0.01)


@pytest.mark.parametrize("rays", [1, 24, 96, 200, 4096])
def test_rays_are_a_power_of_two_near_what_was_wanted(rays):
    sampling = sampling_of(rays)
    made = sampling.exposures * 6 * sampling.rays_per_pixel
    assert made == 24 or 1 / 1.5 < made / rays < 1.5
