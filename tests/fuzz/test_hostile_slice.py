"""A few of the cases of ``make fuzz``, within this process."""

import pytest

from tests.fuzz.cases import CLASSES, case, kind_of
from tests.fuzz.verdicts import ALLOWED, ended, run

SLOW = {
    "option",
    "URDF",
    "xacro",
    "walking",
    "start of a loop",
    "runs of studies",
    "journals of studies",
    "MJCF",
    "SDF",
    "SRDF",
}
QUICK = [number for number in range(len(CLASSES)) if kind_of(number) not in SLOW]
"""One of each class that begins no process of its own and steps no robot on its feet."""


@pytest.mark.long
def test_hostile_input_ends_with_an_exit_code_and_one_line(tmp_path, monkeypatch, capsys):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    became = {}
    for number in QUICK:
        folder = tmp_path / str(number)
        folder.mkdir()
        monkeypatch.chdir(folder)
        made = case(number)
        made.put(folder)
        became[number] = ended(run(made), capsys.readouterr().err)
    bad = {number: word for number, word in became.items() if word not in ALLOWED}
    assert not bad, f"python -m tests.fuzz tells more of cases {bad}"
    assert {"done", "refused"} <= set(became.values())  # damage of both sorts is tried


@pytest.mark.parametrize(
    ("code", "told", "word"),
    [
        (0, "warning x: y\n", "done"),
        (2, "warning x: y\nsimrob: wrong\n", "refused"),
        (3, "", "diverged"),
        (2, "simrob: wrong\nmore\n", "refused in 1 lines"),
        (2, "simrob: a\nsimrob: b\n", "refused in 2 lines"),
        (2, f"simrob: {'x' * 3000}\n", "refused in 1 lines"),
        (1, "Traceback (most recent call last):\nKeyError: 3\n", "exit code 1: KeyError: 3"),
    ],
)
def test_only_an_exit_code_and_one_line_will_do(code, told, word):
    assert ended(code, told).startswith(word)
