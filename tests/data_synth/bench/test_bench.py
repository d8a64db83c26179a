"""The benchmark's own figures against closed forms, and its shoot files."""

from pathlib import Path

import numpy as np
import pytest
from command_line import run

from data_synth.bench.fit import lens as bench_lens
from data_synth.bench.fit.benchmark import bench_fit
from data_synth.bench.result import Row, as_tables
from data_synth.bench.sets import SETS, chosen_sets, shoot_of
from lensfit.errors import LensfitError, ShootError
from lensfit.workflow.shoot.shoot_file import load_shoot

SHOOTS = Path(__file__).parents[3] / "data_synth" / "shoots"


@pytest.mark.parametrize("path", sorted(SHOOTS.glob("*.toml")), ids=lambda p: p.stem)
def test_every_shoot_file_is_read_and_belongs_to_a_set(path: Path, tmp_path: Path):
    shoot = load_shoot(path, tmp_path)
    assert path.stem in {one.name for one in SETS}
    assert shoot.notes == ()
    assert shoot.image_path(shoot.takes[0]) == tmp_path / shoot.takes[0].image


def test_photographs_are_beside_the_shoot_file_unless_told_otherwise():
    path = SHOOTS / "gopro8.toml"
    shoot = load_shoot(path)
    assert shoot.image_path(shoot.takes[0]).is_relative_to(SHOOTS)


def test_distance_from_a_tilted_line_is_the_noise_across_it():
    along = np.linspace(-50, 50, 400)
    noise = np.random.default_rng(0).normal(0, 0.3, 400)
    angle = np.radians(35)
    line = np.outer(along, [np.cos(angle), np.sin(angle)])
    points = line + np.outer(noise, [-np.sin(angle), np.cos(angle)]) + (700, -30)
    rms = np.sqrt(np.mean(bench_lens._squared_distances(points)))
    assert rms == pytest.approx(noise.std(), rel=0.01)


def test_alignment_absorbs_an_affine_map_and_nothing_else():
    fixed = np.random.default_rng(1).uniform(-1, 1, (200, 2))
    moved = fixed @ np.array([[1.02, 0.1], [-0.1, 0.99]]) + (3.0, -1.0)
    np.testing.assert_allclose(bench_lens._aligned(moved, fixed), fixed, atol=1e-12)
    bent = moved + 0.1 * moved**2
    assert np.abs(bench_lens._aligned(bent, fixed) - fixed).max() > 1e-3


@pytest.mark.parametrize(
    ("row", "passed"),
    [
        (Row("a", "px", 0.1, bar=0.2), True),
        (Row("a", "px", 0.3, bar=0.2), False),
        (Row("a", "px", float("nan"), bar=0.2), False),
        (Row("a", "marks", 98, bar=99, least=True), False),
        (Row("a", "marks", 99, bar=99, least=True), True),
        (Row("a", "px", -0.35, bar=0.1, expected=-0.38), True),
        (Row("a", "px", 0.05, bar=0.1, expected=-0.38), False),
        (Row("a", "px", 0.1), None),
    ],
)
def test_a_row_passes_by_its_bar(row: Row, passed: bool | None):
    assert row.passed is passed
    assert as_tables([row])[0]["passed"] is passed


def test_undefined_figures_are_null_in_json():
    table = as_tables([Row("a", "px", float("nan"), 1.0, peers={"b": float("inf")})])
    assert table[0]["value"] is None
    assert table[0]["peers"] == {"b": None}


def test_an_unknown_set_and_a_folder_without_photographs_are_refused(tmp_path: Path):
    with pytest.raises(LensfitError, match="use one of dot_pattern_01"):
        chosen_sets("nothing")
    with pytest.raises(ShootError, match="1 photographs are missing"):
        shoot_of(chosen_sets("gopro8")[0], tmp_path)


def test_missing_photographs_are_one_line_and_exit_code_one(tmp_path: Path):
    told = ["bench", "fit", "--data", str(tmp_path), "--only", "gopro8"]
    result = run(*told)
    assert result.exit_code == 1
    assert "gopro8: " in result.stderr
    assert "give the folder" in result.stderr


@pytest.mark.slow
def test_the_cleanest_photograph_meets_its_bars(data_dir: Path, tmp_path: Path):
    result = bench_fit(data_dir, tmp_path, only="dot_pattern_05")
    rows = {row["what"]: row for row in result["rows"]}
    assert result["errors"] == []
    for what in ("held-out reprojection, px rms", "points used"):
        assert rows[what]["passed"], rows[what]
    held_out = rows["held-out reprojection, px rms"]
    assert held_out["value"] < held_out["peers"]["OpenCV 14"]
    assert (tmp_path / "bench_fit.json").is_file()
    assert list((tmp_path / "dot_pattern_05" / "overlays").glob("*.png"))
