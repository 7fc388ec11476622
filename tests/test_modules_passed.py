"""A move passes no more modules than it did: who follows it in the code has to read them."""

import subprocess
import sys
from pathlib import Path

from simrob_drake import errors
from tests.modules_passed import modules_passed

BOUNDS = {"Arm.move_j, the first": 70, "Arm.move_j, the second": 46}


def test_moves_pass_few_modules():
    """In a process of its own: what other tests have read and built would not be passed again."""
    command = [sys.executable, "-m", "tests.modules_passed"]
    done = subprocess.run(command, capture_output=True, text=True, check=True, cwd=Path(__file__).parents[1])
    counts = {line.rpartition(": ")[0]: int(line.rpartition(": ")[2]) for line in done.stdout.splitlines()}
    assert counts.keys() == BOUNDS.keys()
    assert [f"{move}: {count}" for move, count in counts.items() if count > BOUNDS[move]] == []


def test_a_module_counts_once_and_others_do_not():
    calls = [lambda: errors.quoted("a"), lambda: (errors.quoted("a"), errors.nearest("a", ["b"])), lambda: max(1, 2)]
    assert [modules_passed(call) for call in calls] == [{"simrob_drake.errors"}, {"simrob_drake.errors"}, set()]
