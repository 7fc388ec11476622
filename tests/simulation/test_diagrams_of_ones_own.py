"""A station in a diagram of the user's own runs as it does alone, with monitors, forces, recorder and files."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pydrake.systems.framework import Diagram, DiagramBuilder
from pydrake.systems.primitives import ConstantVectorSource

from simrob_drake import StationPorts, add_station, build_station, load_station, simulate, simulate_diagram
from simrob_drake.errors import SimrobError

STILL = {"reference": {"kind": "hold", "target_deg": None}}


def own(station: str, overrides: dict[str, Any] | None = None) -> tuple[Diagram, StationPorts]:
    """Return a diagram in which a constant is the reference: where the robot begins."""
    builder = DiagramBuilder()
    ports = add_station(builder, load_station(station, {**STILL, **(overrides or {})}))
    (robot,) = ports.plant.robots.values()
    where = builder.AddNamedSystem("where", ConstantVectorSource(robot.initial))
    builder.Connect(where.get_output_port(), ports.inputs["reference"])
    return builder.Build(), ports


@pytest.mark.parametrize(("station", "duration"), [("irb120_dynamic", 1.0), ("humanoid_dynamic", 0.3)])
def test_it_is_the_run_of_the_station(station: str, duration: float) -> None:
    alone = simulate(load_station(station, STILL), duration=duration, progress=False)
    inside = simulate_diagram(*own(station), duration=duration, progress=False)
    assert (inside.ending, inside.names, inside.units) == ("completed", alone.names, alone.units)
    np.testing.assert_allclose(inside.axes("q"), alone.axes("q"), atol=1e-6)
    np.testing.assert_allclose(inside.pose("base"), alone.pose("base"), atol=1e-6)


def test_its_forces_act_and_its_monitors_end_it() -> None:
    overrides = {
        "forces": {"push": {"start": 0.2, "duration": 0.3, "force": [0, -40, 0]}},
        "monitors": {"fall": {"tilt_deg": 30}},
    }
    alone = simulate(load_station("humanoid_dynamic", {**STILL, **overrides}), duration=3, progress=False)
    inside = simulate_diagram(*own("humanoid_dynamic", overrides), duration=3, progress=False)
    assert inside.stopped_by == alone.stopped_by == "fall"
    assert inside.stop_time == pytest.approx(alone.stop_time, abs=2e-3)
    assert "leans by more than 30 deg" in inside.message
    np.testing.assert_array_equal(inside["applied_force.push.y"][21:50], -40)


def test_its_result_is_saved_as_any_other(tmp_path: Path) -> None:
    result = simulate_diagram(*own("irb120_dynamic"), duration=0.2, progress=False)
    folder = result.save(tmp_path / "result")
    assert {"signals.csv", "summary.json", "recording.html", "station.yaml"} <= {file.name for file in folder.iterdir()}
    assert json.loads((folder / "summary.json").read_text())["station"] == "irb120_dynamic"
    assert (folder / "plots" / "torque.png").is_file()


def test_in_a_box_cenic_says_that_it_cannot() -> None:
    builder = DiagramBuilder()
    box = builder.AddNamedSystem("box", build_station(load_station("humanoid_dynamic", STILL)))
    where = builder.AddSystem(ConstantVectorSource(box.ports.plant.robots["robot"].initial))
    builder.Connect(where.get_output_port(), box.GetInputPort("reference"))
    with pytest.raises(SimrobError, match="cenic"):
        simulate_diagram(builder.Build(), box.ports, duration=0.1, progress=False)
