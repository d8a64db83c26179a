"""Photographs without their target: exchanged ones beside those that show nothing."""

from lensfit.workflow.calibration.observe import Observed
from lensfit.workflow.statements.contradictions import gravest_first
from lensfit.workflow.statements.targets_seen import MissedTarget, contradicted_targets


def observed(*targets: str) -> list[Observed]:
    return [Observed(f"view_{k}.png", name, {}) for k, name in enumerate(targets)]


def missed(k: int, target: str, shown: str | None) -> MissedTarget:
    kind = {"dots": "dot grid", "lines": "line grid"}[target]
    return MissedTarget(f"view_{k}.png", target, kind, shown)


def test_photographs_that_show_each_others_targets_are_exchanged():
    views = observed("dots", "dots", "lines")
    found = [missed(1, "dots", "lines"), missed(2, "lines", "dots")]
    (one,) = contradicted_targets(found, views)
    assert one.kind == "exchanged"
    assert "view_1 shows “lines” and view_2 shows “dots”" in one.text
    assert one.images == ("view_1.png", "view_2.png")
    assert gravest_first([one]) == [one]


def test_one_photograph_of_another_target_is_no_exchange():
    views = observed("dots", "dots", "lines")
    (one,) = contradicted_targets([missed(1, "dots", "lines")], views)
    assert one.kind == "target"
    assert one.limit == "undistortion"
    assert "no dot grid is found on view_1.png" in one.text
    assert "“lines” is seen there" in one.text


def test_nothing_is_seen_on_most_photographs():
    views = observed("dots", "dots", "lines")
    found = [missed(0, "dots", None), missed(1, "dots", None)]
    (one,) = contradicted_targets(found, views)
    assert one.limit == "look"
    assert "on view_0.png, nor on 1 more, though target “dots” is stated" in one.text
    assert contradicted_targets([], views) == []
