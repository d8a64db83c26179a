"""Photographs that the fit is held to: which sets, and what each must reach.

Held-out bars are pixels; `aim` is close to what detection noise and a free smooth map
allow. `detections` counts what independent code found on the same photographs. Lateral
colour is the median radial shift beyond 0.8 of the largest radius, measured by other
code. Shoot files lie in `data_synth/shoots`, photographs in the data folder.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from importlib.resources import as_file, files
from pathlib import Path

from msgspec.structs import replace

from lensfit.errors import LensfitError, ShootError
from lensfit.workflow.shoot.shoot_file import Shoot, load_shoot

LEAST_PART_OF_DETECTIONS = 0.99
MOST_ROUND_TRIP_PX = 1e-3
MOST_COLOUR_DIFFERENCE_PX = 0.1
"""Two estimators of an edge shift on blurred chroma differ by about this."""


@dataclass(frozen=True)
class BenchSet:
    """One set of photographs.

    Attributes
    ----------
    name : Of the set and its shoot file.
    bar_px, aim_px : Held-out reprojection rms; for a line grid the straightness rms.
    detections : Found by other code; None where lines are counted differently.
    detect_bar_s : Longest detection and indexing.
    colour_px : Radial red minus green and blue minus green at the edge.
    focus_distance_mm : The one lens state to fit; None for all.
    traced : Its truth is known from an exact ray trace.
    points : File of the points that other code found, in the data folder's points/.
    """

    name: str
    bar_px: float
    aim_px: float
    detections: int | None = None
    detect_bar_s: float | None = None
    colour_px: tuple[float, float] | None = None
    focus_distance_mm: float | None = None
    traced: bool = False
    points: str | None = None


SETS = (
    BenchSet("dot_pattern_01", 0.062, 0.057, 6617, points="dot01.npz"),
    BenchSet("dot_pattern_05", 0.029, 0.025, 4414, points="dot05.npz"),
    BenchSet("dot_pattern_04", 0.43, 0.41, 19723, detect_bar_s=4.0, points="dot04.npz"),
    BenchSet(
        "gopro8", 0.34, 0.28, 1746, colour_px=(-0.10, -0.23), points="gopro8dot.npz"
    ),
    BenchSet("robvis", 0.17, 0.12, 10617),
    BenchSet("surg_metal", 0.44, 0.38, 1342, colour_px=(-0.38, -0.32)),
    BenchSet("udacity_wide", 0.50, 0.42, 1594),
    BenchSet("line_pattern_01", 0.100, 0.06),
    BenchSet("dg50", 0.05, 0.05, focus_distance_mm=2000.0, traced=True),
)


def chosen_sets(only: str | Sequence[str] | None) -> tuple[BenchSet, ...]:
    """All sets, or those of one or several names.

    Raises
    ------
    LensfitError : There is no set of a name.
    """
    if only is None:
        return SETS
    known = {one.name: one for one in SETS}
    wanted = [only] if isinstance(only, str) else only
    for name in wanted:
        if name not in known:
            remedy = f"use one of {', '.join(known)}"
            raise LensfitError(f'no set is called "{name}"', remedy=remedy)
    return tuple(known[name] for name in wanted)


def shoot_of(bench_set: BenchSet, data: Path) -> Shoot:
    """The shoot of a set, with its photographs looked up in the data folder.

    Raises
    ------
    ShootError : The data folder lacks the photographs.
    """
    if bench_set.traced:
        shoot = load_shoot(data / "oracle" / bench_set.name / "shoot.toml")
    else:
        with as_file(files("data_synth") / "shoots") as folder:
            shoot = load_shoot(folder / f"{bench_set.name}.toml", data / "real")
    wanted = bench_set.focus_distance_mm
    if wanted is not None:
        takes = tuple(t for t in shoot.takes if t.focus_distance_mm == wanted)
        shoot = replace(shoot, takes=takes)
    missing = [t.image for t in shoot.takes if not shoot.image_path(t).is_file()]
    if missing:
        raise ShootError(
            f"{len(missing)} photographs are missing, first {missing[0]}",
            where=data,
            remedy="give the folder that holds real/ and oracle/ with --data",
        )
    return shoot
