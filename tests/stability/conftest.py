"""Every case records what it measured; the run of this folder ends with their table.

The docstring of a case is "name: expected behaviour." and stands in the table as it is.
"""

from collections.abc import Iterator

import pytest

_KEY = "stability"


class Measured:
    """The largest error of each quantity of a case, held against its bar."""

    def __init__(self) -> None:
        self.rows: dict[str, tuple[float, float]] = {}

    def __call__(self, what: str, error: float, bar: float) -> None:
        """Fail unless `error` is at most `bar`; `what` names it, with its unit."""
        worst = max(float(error), self.rows.get(what, (0.0, 0.0))[0])
        self.rows[what] = (worst, float(bar))
        assert float(error) <= bar, f"{what}: {error:g}, and {bar:g} is allowed"


@pytest.fixture
def measured(request: pytest.FixtureRequest) -> Iterator[Measured]:
    """Call it with a quantity, its error and its bar."""
    found = Measured()
    request.node.user_properties.append((_KEY, found.rows))
    yield found
    assert found.rows, "a case measures something"


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item: pytest.Item):
    """Tell the name and the expectation of a case with its figures."""
    report = yield
    told = (item.function.__doc__ or "").split("\n\n")[0]  # pyright: ignore
    report.user_properties = [
        (key, {"told": " ".join(told.split()), "rows": rows} if key == _KEY else rows)
        for key, rows in item.user_properties
    ]
    return report


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """The table of notebooks/guide/benchmarks.md, in Markdown."""
    found = [
        (report.location[:2], value)
        for reports in terminalreporter.stats.values()
        for report in reports
        if getattr(report, "when", None) == "call"
        for key, value in report.user_properties
        if key == _KEY
    ]
    if not found:
        return
    terminalreporter.write_line("\n| case | expected | measured |\n|---|---|---|")
    cases: dict[str, dict[str, float]] = {}
    for _, value in sorted(found, key=lambda pair: pair[0]):
        rows = cases.setdefault(value["told"], {})
        for what, (error, _) in value["rows"].items():
            rows[what] = max(error, rows.get(what, 0.0))
    for told, rows in cases.items():
        name, _, expected = told.partition(": ")
        figures = "; ".join(f"{what} {error:.2g}" for what, error in rows.items())
        terminalreporter.write_line(f"| {name} | {expected.rstrip('.')} | {figures} |")
