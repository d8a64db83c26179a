"""How hypothesis runs here: the same examples every time, no clock, no files."""

from hypothesis import HealthCheck, Phase, settings


def examples(count: int) -> settings:
    """Settings of a property that is tried on so many examples.

    The fixture that keeps the largest error is meant to live through all of them. A
    failure is shown as it was met: kernels are too slow to search for a simpler one.
    """
    return settings(
        max_examples=count,
        deadline=None,
        derandomize=True,
        database=None,
        phases=(Phase.explicit, Phase.generate),
        suppress_health_check=[HealthCheck.function_scoped_fixture],
    )
