"""Beside the calibration of a traced lens: its peers, takes left out, efforts.

All of it is fitted to the same detections, and judged by the same truth at the same
settings.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple, Protocol

from data_synth.bench.peers.fitted import (
    SEIDEL_ONLY,
    LensMaker,
    Peer,
    refitted,
    simple_peers,
)
from lensfit.errors import ShootError
from lensfit.fitting.chart_view import View
from lensfit.fitting.wavefront.effort import Effort
from lensfit.preset.schema import Preset
from lensfit.progress import silent
from lensfit.workflow.calibration.observe import Observed, observe_shoot
from lensfit.workflow.shoot.resolve_take import with_identified_charts
from lensfit.workflow.shoot.shoot_records import Shoot

EACH = "each"
Setting = tuple[float, float, float]
"""f-number, focus and object distance (mm)."""


class SpotsJudge(Protocol):
    """As `data_synth.judge_spots`."""

    def __call__(
        self, lens: Preset | LensMaker, folder: Path, *, only: Setting | None = None
    ) -> dict[str, Any] | None:
        """Figures, those of one setting where it is told; None without truth."""
        ...


class Seen(NamedTuple):
    """A shoot with its charts read, and what was found on its photographs."""

    shoot: Shoot
    observed: list[Observed]

    @classmethod
    def of(cls, shoot: Shoot, out_dir: Path) -> "Seen":
        """Photographs are searched and drawn as `calibrate` does it."""
        read = with_identified_charts(shoot, silent)
        return cls(read, observe_shoot(read, out_dir, silent))


@dataclass(frozen=True)
class Beside:
    """What is wanted beside one calibration.

    Attributes
    ----------
    spots : Judges the point-spread functions of anything.
    peers : Whether peers are fitted.
    leave_out : Images of takes (or their stems) to be left out of a fit, one at a time;
        "each" for every take of dots whose setting is stated.
    efforts : Settings of the accuracy knob.
    """

    spots: SpotsJudge
    peers: bool = False
    leave_out: tuple[str, ...] = ()
    efforts: tuple[str, ...] = ()

    @property
    def is_wanted(self) -> bool:
        """Whether there is anything to do."""
        return bool(self.peers or self.leave_out or self.efforts)


def add_figures(
    found: dict[str, Any], beside: Beside, seen: Seen, folder: Path
) -> None:
    """What is wanted of one lens, under "peers", "efforts" and "left_out" of `found`,
    one after the other: what comes before a failure stays.

    Raises
    ------
    LensfitError : Something could not be fitted, or no take has that name.
    """
    images = images_left_out(beside.leave_out, seen.shoot)
    takes = {o.image: o.take for o in seen.observed if o.take is not None}

    def judged(peer: Peer) -> dict[str, Any]:
        spent = {name: round(value, 2) for name, value in peer.seconds.items()}
        return {"psf": beside.spots(peer.lens, folder)} | spent

    if beside.peers:
        peers = simple_peers(list(takes.values()))
        peers[SEIDEL_ONLY] = refitted(*seen, seidel_only=True)
        found["peers"] = {name: judged(peer) for name, peer in peers.items()}
    if beside.efforts:
        found["efforts"] = {}
        for effort in beside.efforts:
            peer = refitted(*seen, effort=Effort.from_name(effort))
            found["efforts"][effort] = judged(peer)
    if images:
        found["left_out"] = {}
    for image in images:
        one = _without(beside, seen, takes[image], folder) if image in takes else None
        if one is not None:
            found["left_out"][image] = one


def _without(
    beside: Beside, seen: Seen, take: View, folder: Path
) -> dict[str, Any] | None:
    """Figures at the setting of a take that no fit has seen; None without truth."""
    setting = _setting(take)
    if setting is None:
        return None

    def judged(peer: Peer) -> dict[str, Any] | None:
        return beside.spots(peer.lens, folder, only=setting)

    found = judged(refitted(*seen, without=take.name))
    if found is None:
        return None
    takes = [o.take for o in seen.observed if o.take is not None]
    others = [one for one in takes if one is not take]
    peers = simple_peers(others) if beside.peers else {}
    return found | {"peers": {name: judged(peer) for name, peer in peers.items()}}


def _setting(take: View) -> Setting | None:
    stated = take.f_number, take.focus_distance_mm, take.target_distance_mm
    if take.dot_images is None or None in stated:
        return None
    return stated  # pyright: ignore[reportReturnType]


def images_left_out(names: tuple[str, ...], shoot: Shoot) -> list[str]:
    """Images of the takes that are meant.

    Raises
    ------
    ShootError : No take has that name.
    """
    known = {take.image: take.image for take in shoot.takes}
    stems = {Path(take.image).stem: take.image for take in shoot.takes}
    if EACH in names:
        return list(known)
    images = [known.get(name) or stems.get(name) for name in names]
    if None in images:
        missing = names[images.index(None)]
        raise ShootError(
            f"no take is called {missing}",
            where=shoot.path,
            remedy=f"leave out {', '.join(stems)}, or each",
        )
    return [image for image in images if image is not None]
