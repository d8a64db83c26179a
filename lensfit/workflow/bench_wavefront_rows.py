"""Figures of judged calibrations as rows with the bars they are held to."""

from typing import Any

from lensfit.workflow.bench_rows import Row

MOST_CHIEF_PX = 0.05
MOST_COLOUR_PX = 0.03
MOST_LIGHT = 0.02
MOST_PSF = (0.10, 0.20)
_AIMS = {"chief": 0.02, "colour": 0.01, "light": 0.01, "psf": (0.03, 0.08)}
_UNSEEN = 1.5
"""How much larger errors may be at settings that were not photographed."""


def wavefront_rows(row: dict[str, Any]) -> list[Row]:
    """Of one lens that was judged; undefined where it failed."""
    name, figures = row["lens"], row["figures"]
    if figures is None:
        return [Row(name, "calibrated and judged", float("nan"), bar=0.0)]
    psf, thin = figures["psf"] or {}, figures["thin_lens"]["psf"] or {}
    found = [
        _largest(name, "chief rays, px rms", figures["chief_ray_px"], MOST_CHIEF_PX,
                 _AIMS["chief"]),
        _largest(name, "lateral colour, px rms", figures["lateral_colour_px"],
                 MOST_COLOUR_PX, _AIMS["colour"]),
        _largest(name, "relative illumination, worst", figures["illumination_worst"],
                 MOST_LIGHT, _AIMS["light"]),
    ]  # fmt: skip
    settings = {"all": "psf", "unseen_stop": "psf at a stop never shot",
                "unseen_depth": "psf at a depth never shot"}  # fmt: skip
    for key, what in settings.items():
        factor = 1.0 if key == "all" else _UNSEEN
        for k, part in enumerate(("median", "p90")):
            if key in psf:
                disc = {"thin lens": thin[key][part]} if key in thin else {}
                found.append(
                    Row(
                        name,
                        f"{what}, {part}",
                        psf[key][part],
                        bar=factor * MOST_PSF[k],
                        aim=_AIMS["psf"][k],
                        peers=disc,
                    )
                )
    wrong = float(figures["defocus_sign"] != "right")
    found.append(Row(name, "sign of defocus wrong or undecided", wrong, bar=0.0))
    flags = float(len(figures["flags"]))
    found.append(Row(name, "folds and negative light", flags, bar=0.0))
    return found


def _largest(
    name: str, what: str, figures: dict[str, float], bar: float, aim: float
) -> Row:
    return Row(name, what, max(figures.values()), bar=bar, aim=aim)
