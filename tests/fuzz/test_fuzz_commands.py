"""Whole commands on spoiled files: a result, or one line; nothing else is left.

`fuzz_commands` lists the commands and what counts as a finding.
"""

import os
from pathlib import Path

import pytest
from fuzz_commands import COMMANDS
from fuzz_run import run

WORKER = Path(__file__).with_name("fuzz_commands.py")
QUICK = [command for command in COMMANDS if not command.needs_jax]

pytestmark = pytest.mark.skipif(
    os.name == "nt", reason="limits of a process are set as POSIX does"
)


def test_quick_commands_answer_in_one_line(tmp_path: Path):
    plan = [(command.name, 0, 2) for command in QUICK]
    tally = run(plan, tmp_path, WORKER)
    assert tally.findings == []
    assert tally.files == 2 * len(QUICK)


@pytest.mark.slow
def test_every_command_answers_in_one_line(tmp_path: Path):
    plan = [(command.name, 0, command.files) for command in COMMANDS]
    tally = run(plan, tmp_path, WORKER)
    assert tally.findings == []
    assert tally.files == sum(command.files for command in COMMANDS) >= 150
    assert sum(tally.read.values()) > 10
    assert sum(tally.refused.values()) > 50
