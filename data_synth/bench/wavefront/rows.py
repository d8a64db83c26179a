"""Figures of judged calibrations as rows with the bars they are held to.

Rows over many lenses count each alike. A lens that falls short
and says so is known to whoever uses it. What must not be is one that was said to be
measured and is not: of a hundred one is passed, and none with the wrong side of focus.
"""

from collections.abc import Callable
from typing import Any

from data_synth.bench.result import HONEST, SLACK, Row

MOST_CHIEF_PX = 0.05
MOST_COLOUR_PX = 0.03
MOST_LIGHT = 0.02
MOST_PSF = (0.10, 0.20)
_AIMS = {"chief": 0.02, "colour": 0.01, "light": 0.01, "psf": (0.03, 0.08)}
_PSF_OF = {
    "all": "psf",
    "unseen_stop": "psf at a stop never shot",
    "unseen_depth": "psf at a depth never shot",
}
_UNSEEN = 1.5
"""How much larger errors may be at settings that were not photographed."""


def wavefront_rows(row: dict[str, Any]) -> list[Row]:
    """Of one lens that was judged; undefined where it failed."""
    name, figures = row["lens"], row["figures"]
    if figures is None:
        return [Row(name, "calibrated and judged", float("nan"), bar=0.0)]
    beside = row.get("beside", {})
    return [
        *_map_rows(name, figures),
        *_psf_rows(row),
        *_verdict_rows(name, figures),
        *(
            left_out
            for image, one in beside.get("left_out", {}).items()
            for left_out in _left_out_rows(name, image, one)
        ),
        *(
            _effort_row(name, effort, one)
            for effort, one in beside.get("efforts", {}).items()
        ),
    ]


def _map_rows(name: str, figures: dict[str, Any]) -> list[Row]:
    """Where light lands, and how much of it."""
    return [
        _largest(name, "chief rays, px rms", figures["chief_ray_px"], MOST_CHIEF_PX,
                 _AIMS["chief"]),
        _largest(name, "lateral colour, px rms", figures["lateral_colour_px"],
                 MOST_COLOUR_PX, _AIMS["colour"]),
        _largest(name, "relative illumination, worst", figures["illumination_worst"],
                 MOST_LIGHT, _AIMS["light"]),
    ]  # fmt: skip


def _psf_rows(row: dict[str, Any]) -> list[Row]:
    """Spots, at settings that were photographed and at others."""
    psf = row["figures"]["psf"] or {}
    return [
        Row(
            row["lens"],
            f"{what}, {part}",
            _number(psf[key][part]),
            bar=(1.0 if key == "all" else _UNSEEN) * MOST_PSF[k],
            aim=_AIMS["psf"][k],
            peers=_peers(row, key, part),
        )
        for key, what in _PSF_OF.items()
        if key in psf
        for k, part in enumerate(("median", "p90"))
    ]


def _verdict_rows(name: str, figures: dict[str, Any]) -> list[Row]:
    """What must not happen at all."""
    wrong = float(figures["defocus_sign"] != "right")
    flags = float(len(figures["flags"]))
    return [
        Row(name, "sign of defocus wrong or undecided", wrong, bar=0.0),
        Row(name, "folds and negative light", flags, bar=0.0),
    ]


def _peers(row: dict[str, Any], key: str, part: str) -> dict[str, float]:
    """What the others make of the same photographs, where the truth can say."""
    others = {
        name: one["psf"] for name, one in row.get("beside", {}).get("peers", {}).items()
    }
    others["thin lens"] = row["figures"]["thin_lens"]["psf"] or {}
    found = {name: psf.get(key, {}).get(part) for name, psf in others.items()}
    return {name: value for name, value in found.items() if value is not None}


def _left_out_rows(name: str, image: str, one: dict[str, Any]) -> list[Row]:
    """At the setting of a take that no fit has seen."""
    return [
        Row(
            name,
            f"psf with {image} left out, {part}",
            _number(one[part]),
            bar=_UNSEEN * MOST_PSF[k],
            aim=_AIMS["psf"][k],
            peers={who: _number(psf[part]) for who, psf in one["peers"].items()},
        )
        for k, part in enumerate(("median", "p90"))
    ]


def _effort_row(name: str, effort: str, one: dict[str, Any]) -> Row:
    """Error and seconds at a setting of the accuracy knob."""
    psf = one["psf"]["all"]
    more = {"p90": _number(psf["p90"]), "seconds": one["seconds"]}
    more["processor seconds"] = one["cpu_seconds"]
    return Row(name, f"psf at effort {effort}, median", psf["median"], peers=more)


def _number(value: float | None) -> float:
    return float("nan") if value is None else value


def _largest(
    name: str, what: str, figures: dict[str, float], bar: float, aim: float
) -> Row:
    return Row(name, what, max(figures.values()), bar=bar, aim=aim)


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
