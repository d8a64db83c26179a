"""What many judged lenses say together, each with the same say.

A lens that falls short and says so is known to whoever uses it. What must not be is one
that was said to be measured and is not: of a hundred one is passed, and none with the
wrong side of focus.
"""

from collections.abc import Callable
from typing import Any

from data_synth.bench.rows import HONEST, SLACK, Row
from data_synth.bench.wavefront.rows import (
    MOST_CHIEF_PX,
    MOST_COLOUR_PX,
    MOST_LIGHT,
    MOST_PSF,
)

_STATED = ("chief_rays", "lateral_colour", "fall_off", "psf")
"""Of what deviations are judged; those that no lens states fail."""
_SILENT_SHARE = 0.01

_Judged = dict[str, Any]
"""Row of a lens that has figures."""


def many_lenses_rows(rows: list[dict[str, Any]]) -> list[Row]:
    """Of all lenses that were judged; nothing of fewer than two."""
    judged = [row for row in rows if row["figures"] is not None]
    if len(judged) < 2:
        return []
    return [*_counted(judged), *_covered(judged)]


def _counted(judged: list[_Judged]) -> list[Row]:
    """How many lenses fall short, and of what."""
    name = f"{len(judged)} lenses"

    def count(what: str, short: Callable[[_Judged], bool], bar: float | None = None):
        return Row(name, f"lenses {what}", float(sum(map(short, judged))), bar=bar)

    return [
        count(
            "whose psf falls short and that did not say so",
            lambda row: _psf_short(row) and not row["said_short"],
            _SILENT_SHARE * len(judged),
        ),
        count(
            "with the side of focus wrong or undecided",
            lambda row: row["figures"]["defocus_sign"] != "right",
            0.0,
        ),
        count("that fold or darken below zero", _flagged, 0.0),
        count("said not to have converged", lambda row: not row["converged"]),
        count("whose psf falls short", _psf_short),
        count(
            f"with chief rays over {MOST_CHIEF_PX:g} px",
            lambda row: _worst(row, "chief_ray_px") > MOST_CHIEF_PX,
        ),
        count(
            f"with lateral colour over {MOST_COLOUR_PX:g} px",
            lambda row: _worst(row, "lateral_colour_px") > MOST_COLOUR_PX,
        ),
        count(
            f"with fall-off over {100 * MOST_LIGHT:g} %",
            lambda row: _worst(row, "illumination_worst") > MOST_LIGHT,
        ),
    ]


def _covered(judged: list[_Judged]) -> list[Row]:
    """How many errors are within one stated deviation; a lens that states none of
    something has no say in it."""
    found = []
    for name in _STATED:
        stated = [row["figures"].get("covered", {}) for row in judged]
        some = [covered[name] for covered in stated if name in covered]
        found.append(
            Row(
                f"{len(some)} lenses",
                f"stated deviations of {name.replace('_', ' ')} cover, %",
                sum(some) / len(some) if some else float("nan"),
                bar=SLACK,
                expected=HONEST,
            )
        )
    return found


def _psf_short(row: _Judged) -> bool:
    """Whether spots miss a bar, or were never fitted."""
    psf = (row["figures"]["psf"] or {}).get("all")
    if psf is None:
        return True
    found = (psf["median"], psf["p90"])
    return not all(
        value is not None and value <= bar
        for value, bar in zip(found, MOST_PSF, strict=True)
    )


def _flagged(row: _Judged) -> bool:
    return bool(row["figures"]["flags"])


def _worst(row: _Judged, figure: str) -> float:
    return max(row["figures"][figure].values())
