"""Figures of judged calibrations as rows with the bars they are held to."""

from typing import Any

from data_synth.bench.rows import Row

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
