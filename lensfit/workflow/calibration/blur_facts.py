"""Figures of the fitted wavefront for the report: terms, misfits, what was not seen.

Everything is plain numbers, ready for JSON.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np

from lensfit.fitting.wavefront.fit import WavefrontFit
from lensfit.fitting.wavefront.term_groups import Family
from lensfit.report.plain_numbers import plain
from lensfit.workflow.calibration.defocus_facts import defocus_facts

_UNITS = {
    "defocus": "mm",
    "beyond": "mm",
    "third_order": "um",
    "cylinders_third_order": "um",
    "cylinders_fifth_astigmatism": "um",
    "cylinders_fifth_coma": "um",
    "cylinders_fifth_spherical": "um",
    "fifth_order": "um",
    "seventh_order": "um",
    "ninth_order": "um",
    "axial_colour": "um",
    "axial_colour_curved": "um",
    "colour_of_third_order": "um",
    "colour_of_fifth_order": "um",
    "colour_of_third_order_curved": "um",
    "decentred_elements": "um",
}


def blur_terms(wavefront: WavefrontFit) -> list[dict[str, Any]]:
    """Every family of parameters: kept or left, value, deviation, reason."""
    kept = {family.name: family for family in wavefront.families}
    tried = {verdict.name: verdict for verdict in wavefront.verdicts}
    terms = []
    for name in dict.fromkeys((*kept, *tried)):
        value, deviation = None, None
        if name in kept:
            value, deviation = _numbers(kept[name], wavefront)
        reason = tried[name].reason if name in tried else "part of every lens"
        if name in wavefront.unseen:
            reason += "; the photographs hardly show it"
        terms.append(
            {
                "name": f"blur_{name}",
                "kept": name in kept,
                "value": value,
                "standard_deviation": deviation,
                "unit": _UNITS.get(name, ""),
                "reason": reason,
            }
        )
    return terms


def blur_facts(wavefront: WavefrontFit, pictures: Mapping[str, str]) -> dict[str, Any]:
    """How well the shape of the dots is explained, per take and held out.

    Parameters
    ----------
    wavefront : The fit.
    pictures : Of the dots, by the take's name; see `blur_pictures`.
    """
    gathered, stage = wavefront.gathered, wavefront.stage
    misfit = wavefront.misfit
    takes = []
    for k, shown in enumerate(gathered.shown):
        takes.append(
            {
                "image": shown.take.name,
                "dots": int(np.sum(stage.gathered.take == k)),
                "misfit": plain(misfit.of_take[k]),
                "held_out_misfit": plain(misfit.held_out_take[k]),
                "picture": pictures.get(shown.take.name),
            }
        )
    return {
        "takes": takes,
        "held_out_misfit": plain(misfit.held_out_dots),
        "defocus": defocus_facts(wavefront),
        "blades": stage.blades,
        "sign_known": wavefront.sign_known,
        "mirrored": wavefront.mirrored,
        "guessed": list(wavefront.guessed),
        "converged": wavefront.converged,
        "not_seen": list(wavefront.unseen),
    }


def _numbers(family: Family, wavefront: WavefrontFit) -> tuple[list, list]:
    rows = list(family.indices)
    deviation = np.sqrt(np.diag(wavefront.stated_covariance))[rows]
    return wavefront.stage.parameters[rows].tolist(), deviation.tolist()
