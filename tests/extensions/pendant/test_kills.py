"""Kill -9 at random moments of a session: nothing that was taught is lost, and no file is damaged."""

import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from fake_runs import CountingRun

from simrob_drake import Program
from simrob_drake.extensions.pendant.session import Session

HERE = Path(__file__)


def taught(number):
    """Return the angle that the n-th move of the script has [deg]."""
    return float(number % 60)


def opened(folder):
    session = Session.open("humanoid", folder, live=CountingRun)
    session.hear()
    return session


def teach(session, told):
    """Teach moves for ever, and tell of each that was stored."""
    number = len(session.book.program.moves)
    while True:
        session.test({"left_elbow": taught(number)})
        session.hear()
        session.hear()
        if number % 7 == 3:  # some of it is undone and done again
            session.undo()
            session.redo()
        session.add()
        number += 1
        os.write(told, b".")


def killed_again_and_again(folder, kills, seed):
    """Kill one process after the other that teaches; print how much was taught."""
    chance, session = random.Random(seed), opened(folder)
    for _ in range(kills):
        stored = len(session.book.program.moves)
        hears, tells = os.pipe()
        child = os.fork()
        if child == 0:
            teach(session, tells)
        os.close(tells)
        session.close()
        os.read(hears, 1)  # it is at work
        time.sleep(chance.uniform(0.0, 0.03))
        os.kill(child, signal.SIGKILL)
        os.waitpid(child, 0)
        stored += 1 + sum(len(part) for part in iter(lambda pipe=hears: os.read(pipe, 4096), b""))
        os.close(hears)
        session = opened(folder)
        moves = [move.target_deg["left_elbow"] for move in session.book.program.moves]
        assert str(session.message) == "", session.message
        assert moves == [taught(number) for number in range(len(moves))], (
            "what was taught is not in order"
        )
        assert stored <= len(moves) <= stored + 1, (
            f"{stored} moves were stored, {len(moves)} are there"
        )
        assert Program.load(session.book.file).moves == session.book.program.moves
        assert session.book.history.can_undo
    print(len(moves))


@pytest.mark.parametrize("kills", [10, pytest.param(50, marks=pytest.mark.long)])
def test_kills_lose_nothing(tmp_path, kills):
    command = [sys.executable, str(HERE), str(tmp_path), str(kills)]
    run = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
    assert run.returncode == 0, run.stderr
    assert int(run.stdout) > kills
    assert sorted(
        file.name for file in (tmp_path / "humanoid_dynamic").iterdir() if file.suffix == ".yaml"
    ) == ["program.yaml"]


if __name__ == "__main__":
    killed_again_and_again(Path(sys.argv[1]), int(sys.argv[2]), seed=14)
