"""Standard deviations that a preset states, by the key they belong to.

The covariance of an entry is in the units of the fit (`lensfit.fitting.parameters`):
what counts in reference radii there, or in the logarithm of a length, is millimetres
here.
"""

import math

import numpy as np

from lensfit.preset.covariance import Covariance
from lensfit.preset.entry import Entry
from lensfit.preset.library.key_path import complete_tables, member_text
from lensfit.preset.schema import Preset

Deviations = dict[str, float]

_DISTORTION = {
    "radial": "radial_log_slope",
    "decentering": "decentering",
    "thin_prism": "thin_prism",
    "anamorphic": "anamorphic",
}


def deviations_of(preset: Preset) -> Deviations:
    """Standard deviation of every number that has one, in the number's own unit."""
    found: Deviations = {}
    for index, entry in enumerate(preset.entries):
        place = "entries" + member_text("entries", complete_tables(entry), index)
        of_entry = _of_colour_and_light(entry)
        if entry.covariance is not None:
            of_entry |= _of_entry(entry, entry.covariance)
        found |= {f"{place}.{key}": sd for key, sd in of_entry.items()}
    return found


def _of_colour_and_light(entry: Entry) -> Deviations:
    """Their parameters are named as keys of their block, and in its units."""
    found: Deviations = {}
    lateral = entry.lateral_colour
    if lateral is not None and lateral.covariance is not None:
        for channel in ("r", "b"):
            place = f"lateral_colour.{channel}"
            found |= _below(place, getattr(lateral.covariance, channel))
    for index, light in enumerate(entry.fall_off):
        if light.covariance is not None:
            member = member_text("fall_off", complete_tables(light), index)
            for channel in ("r", "g", "b"):
                covariance = getattr(light.covariance, channel)
                found |= _below(f"fall_off{member}", covariance)
    return found


def _below(place: str, covariance: Covariance) -> Deviations:
    stated = zip(covariance.parameters, covariance.standard_deviation, strict=True)
    return {f"{place}.{name}": sd for name, sd in stated}


def _of_entry(entry: Entry, covariance: Covariance) -> Deviations:
    projection, distortion = entry.projection, entry.distortion
    free = len(distortion.field.x) if distortion.field else 0
    found: Deviations = {}
    stated = zip(covariance.parameters, covariance.standard_deviation, strict=True)
    for parameter, sd in stated:
        block, _, rest = parameter.partition("[")
        number = rest.removesuffix("]")
        if not number.isdecimal():
            continue
        index = int(number)
        if block in _DISTORTION:
            found[f"distortion.{_DISTORTION[block]}[{index}]"] = sd
        elif block == "free_field" and free:
            axis = "x" if index < free else "y"
            found[f"distortion.field.{axis}[{index % free}]"] = sd
        elif block == "principal_point":
            mm = sd * distortion.reference_radius_mm
            found[f"projection.principal_point_mm[{index}]"] = mm
        elif block == "focal_length":
            found["projection.principal_distance_mm"] = (
                sd * projection.principal_distance_mm
            )
    return found | _of_squeeze(entry, covariance)


def _of_squeeze(entry: Entry, covariance: Covariance) -> Deviations:
    """Of exp(|e|) and half the angle of e, where e is what was fitted."""
    names = ("squeeze[0]", "squeeze[1]")
    size = math.log(entry.distortion.squeeze)
    if size == 0 or not set(names) <= set(covariance.parameters):
        return {}
    rows = [covariance.parameters.index(name) for name in names]
    matrix = covariance.matrix()[np.ix_(rows, rows)]
    angle = 2 * entry.distortion.squeeze_axis_rad
    along = np.array([math.cos(angle), math.sin(angle)])
    across = np.array([-along[1], along[0]])
    return {
        "distortion.squeeze": entry.distortion.squeeze
        * math.sqrt(max(along @ matrix @ along, 0.0)),
        "distortion.squeeze_axis_rad": math.sqrt(max(across @ matrix @ across, 0.0))
        / (2 * abs(size)),
    }
