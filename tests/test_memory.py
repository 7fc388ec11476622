"""Many runs in one process: nothing of them stays, and memory does not grow."""

import json
import subprocess
import sys
from typing import Any

import pytest

MEASURE = """
import gc, json, resource, sys
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.framework import Diagram, LeafSystem
from simrob_drake import load_station, simulate

def peak():  # of the memory of this process [MB]
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / (1e6 if sys.platform == "darwin" else 1e3)

config = load_station(sys.argv[1], {"duration": 0.2, **json.loads(sys.argv[2])})
for _ in range(10):
    result = simulate(config, progress=False)  # kept, as below: the last run's diagrams live beside the next one's
before = peak()
for _ in range(30):
    result = simulate(config, progress=False)
grown = peak() - before
if result.contacts_at:
    list(result.contacts_at(result.times[:2]))
del result
gc.collect()
kinds = (Diagram, LeafSystem, MultibodyPlant)
alive = [type(each).__name__ for each in gc.get_objects() if issubclass(type(each), kinds)]
print(json.dumps({"grown": grown, "alive": alive}))
"""


@pytest.mark.long
@pytest.mark.parametrize(
    ("station", "overrides"),
    [
        ("irb120_dynamic", {}),
        ("humanoid_dynamic", {}),
        ("irb120_force_stop", {}),
        ("yobotics_walking", {"solver": {"kind": "mujoco"}}),
    ],
)
def test_runs_leave_nothing_behind(station: str, overrides: dict[str, Any]) -> None:
    asked = [sys.executable, "-c", MEASURE, station, json.dumps(overrides)]
    done = subprocess.run(asked, check=True, capture_output=True, text=True)

    found = json.loads(done.stdout)
    assert found["alive"] == []
    assert found["grown"] < 30 * 0.1  # MB


LONG_WALK = """
import resource, sys
from simrob_drake import LeggedRobot

def peak():  # of the memory of this process [MB]
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / (1e6 if sys.platform == "darwin" else 1e3)

robot = LeggedRobot("zjudancer_dynamic")
robot.walk(2)
before = peak()
result = robot.walk(100)
print((peak() - before) / result.times[-1])
"""


@pytest.mark.long
def test_a_long_walk_takes_little_memory() -> None:
    # 0.3 MB a second over ten minutes; what is taken once counts here, too. A piecewise polynomial takes 2.7.
    done = subprocess.run(
        [sys.executable, "-c", LONG_WALK], check=True, capture_output=True, text=True
    )
    assert float(done.stdout) < 0.8
