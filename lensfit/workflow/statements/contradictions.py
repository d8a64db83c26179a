"""Every contradiction of a shoot, the gravest first.

Each kind is found by its own small model. What cannot be judged from the photographs
(an unconfirmed field, an encoding that was assumed) comes last.
"""

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from lensfit.fitting.breathing import reversed_breathing
from lensfit.fitting.chart_view import View
from lensfit.fitting.lens_states import FittedLens
from lensfit.fitting.wavefront.fit import WavefrontFit
from lensfit.preset.verdict_levels import LEVELS
from lensfit.workflow.calibration.observe import Observed
from lensfit.workflow.shoot.shoot_records import Shoot
from lensfit.workflow.statements.aspect_contradictions import aspect_contradictions
from lensfit.workflow.statements.blur_statements import (
    contradicted_f_numbers,
    exchanged_focus_distances,
    f_number_contradiction,
    unlikely_blur,
    unlikely_focus_distances,
)
from lensfit.workflow.statements.contradiction import Contradiction
from lensfit.workflow.statements.encoding import (
    assumed_encodings,
    impossible_fall_off,
    nonlinear_views,
)
from lensfit.workflow.statements.focus_curves import focus_units
from lensfit.workflow.statements.lens_identity import mixed_lenses
from lensfit.workflow.statements.released_statements import contradicted_statements
from lensfit.workflow.statements.targets_seen import contradicted_counts

_ORDER = (
    "exchanged", "aspect", "photograph_size", "lens_identity",
    "focal_length pitch target_distance", "statements", "side_of_focus",
    "blurred_view", "encoding", "f_number", "exposure", "repeated_exposure",
    "unconfirmed", "target",
)  # fmt: skip
"""Kinds of one rank stay as they were found: what explains most was found first."""
_RANKS = {kind: k for k, kinds in enumerate(_ORDER) for kind in kinds.split()}
_MOSTLY = 0.5
_STOP_RATIO_LOG = 0.12
"""Of the radius of a stop: a third of a stop."""


def contradictions_of_views(takes: Sequence[View]) -> list[Contradiction]:
    """Those that the detected points of the views show, before anything is fitted."""
    # A cause that others follow from is looked for first.
    for causes in (
        aspect_contradictions,
        mixed_lenses,
        exchanged_focus_distances,
        focus_units,
        contradicted_statements,
    ):
        found = list(causes(takes))
        if found:
            break
    if all(one.kind == "statements" for one in found):
        # A wrong focus distance contradicts the others through the lens' breathing.
        found = list(unlikely_focus_distances(takes)) or found
    if any(one.kind == "side_of_focus" for one in found):
        return found
    return [*found, *unlikely_blur(takes)]


def contradictions_of_fit(
    takes: Sequence[View], fitted: FittedLens
) -> Iterator[Contradiction]:
    """Those that the fitted lens shows."""
    for focal_mm, sentence in reversed_breathing(fitted.states).items():
        wavefront = fitted.wavefronts.get(focal_mm)
        if wavefront is not None and wavefront.fits_stated_side:
            continue
        yield Contradiction(
            kind="side_of_focus",
            limit="undistortion",
            text=f"near and far are probably swapped: {sentence}",
            remedy="check focus_distance_mm of near and far views",
            statement="focus_distance_mm",
        )
    by_fit: list[Contradiction] = []
    for wavefront in fitted.wavefronts.values():
        if wavefront.mirrored:
            yield Contradiction(
                kind="side_of_focus",
                limit="look",
                text="near and far are probably swapped: the dots look as if they lay "
                "on the other side of focus than was stated",
                remedy="check focus_distance_mm of near and far views",
                statement="focus_distance_mm",
            )
        by_fit += _f_numbers_of(wavefront, takes)
    yield from by_fit or contradicted_f_numbers(takes)


def contradictions_of_report(
    shoot: Shoot, observed: Sequence[Observed], entries: Sequence[dict[str, Any]]
) -> Iterator[Contradiction]:
    """Those of the light and of counts, and what nobody stated or confirmed."""
    views = [
        one.take for one in observed if one.take is not None and not one.sharpening
    ]
    yield from nonlinear_views(views) or impossible_fall_off(entries)
    yield from contradicted_counts(shoot, observed)
    yield from assumed_encodings(observed)
    yield from exposure_contradictions(observed)
    if shoot.unconfirmed:
        named = "; ".join(shoot.unconfirmed)
        yield Contradiction(
            kind="unconfirmed",
            limit="undistortion",
            text=f"drafted and never confirmed: {named}",
            remedy="put in what is true and remove the TODO of these lines",
            statement=shoot.unconfirmed[0],
        )


def exposure_contradictions(observed: Sequence[Observed]) -> Iterator[Contradiction]:
    """Photographs most of whose points touch clipped samples, if most do."""
    views = [one.take for one in observed if one.take is not None]
    clipped = [one for one in views if np.mean(one.observations.saturated) > _MOSTLY]
    if len(clipped) <= _MOSTLY * len(views):
        return
    yield Contradiction(
        kind="exposure",
        limit="match-moving",
        text=f"{len(clipped)} of {len(views)} photographs are over-exposed: their dots "
        "or lines are clipped, which hides fall-off and blur and moves what is found",
        remedy="expose less, until nothing on the chart is at full scale",
        images=tuple(one.name for one in clipped),
    )


def gravest_first(found: Sequence[Contradiction]) -> list[Contradiction]:
    """The one that limits most first; of those alike the most specific cause."""
    unique = {(one.kind, one.text): one for one in found}
    return sorted(
        unique.values(),
        key=lambda one: (LEVELS.index(one.limit), _RANKS[one.kind]),
    )


def _f_numbers_of(
    wavefront: WavefrontFit, takes: Sequence[View]
) -> Iterator[Contradiction]:
    """Stops whose size beside the widest the dots' shape shows otherwise. Where the
    photographs do not determine it, errors of the model would be taken for it."""
    name = "stop_ratios"
    if not wavefront.has(name) or name in wavefront.undetermined_term_groups:
        return
    stops = [float(one) for one in wavefront.dot_data.f_numbers]
    where = wavefront.stage.layout.blocks["stop_ratio"]
    ratios = np.asarray(wavefront.stage.parameters[where])[: len(stops) - 1]
    for stop, ratio in zip(stops[1:], ratios.tolist(), strict=False):
        if abs(ratio) > _STOP_RATIO_LOG:
            measured = stop * float(np.exp(-ratio))
            yield f_number_contradiction(stops[0], stop, measured, takes)
