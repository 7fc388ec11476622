"""A diagram of a user's own that holds a station is run, recorded and saved as a station is."""

import json

import numpy as np
import pytest
from pydrake.systems.framework import DiagramBuilder, LeafSystem
from pydrake.systems.primitives import ConstantVectorSource, TrajectorySource
from pydrake.trajectories import PiecewisePolynomial

from simrob_drake import add_station, build_station, load_station, simulate
from simrob_drake.base.errors import SimrobError
from simrob_drake.results.plots.own import save_plots
from simrob_drake.simulation import simulate_diagram
from simrob_drake.stations.closed import closed_station
from simrob_drake.stations.resolve import resolve

pytestmark = pytest.mark.usefixtures("no_plots")

TIMES = np.array([0.0, 0.5, 1.0])
POSITIONS = np.outer([0, 0.3, 0.1], np.ones(6))


def wired(config, course=None, **others):
    """Return a diagram that plays a course to the arm of a station, and the station's ports."""
    builder = DiagramBuilder()
    ports = add_station(builder, config)
    course = course or PiecewisePolynomial.FirstOrderHold(TIMES, POSITIONS.T)
    source = builder.AddNamedSystem("course", TrajectorySource(course))
    builder.Connect(source.get_output_port(), ports.inputs["reference"])
    for name, system in others.items():
        builder.AddNamedSystem(name, system)
    return builder.Build(), ports


def arm(**overrides):
    discrete = {"kind": "discrete", "time_step": 1e-3}
    return load_station(
        "irb120_dynamic", {"servo.realization": "implicit", "solver": discrete, **overrides}
    )


def test_it_gives_the_result_of_simulate_to_the_last_bit():
    config = arm(sensors={"felt": {"kind": "external_torque"}})
    own = simulate_diagram(*wired(config), duration=0.8, progress=False)

    ours = simulate(config, reference=(TIMES, POSITIONS), duration=0.8, progress=False)

    assert (own.names, own.units) == (ours.names, ours.units)
    np.testing.assert_array_equal(own.values, ours.values)
    np.testing.assert_array_equal(own.step_times, ours.step_times)
    assert (own.ending, own.message, own.notes) == (ours.ending, ours.message, ours.notes)
    looked = np.array([0.1234, 0.5])
    np.testing.assert_array_equal(own.positions_at(looked), ours.positions_at(looked))


@pytest.mark.parametrize("station", ["irb120_dynamic", "humanoid_dynamic", "bouncing_ball"])
def test_a_station_that_closes_itself_is_that_of_simulate(station):
    config = load_station(station, {"duration": 1.2})
    closed = closed_station(resolve(config), monitors=False)
    own = simulate_diagram(closed.diagram, closed.ports, progress=False)

    ours = simulate(config, progress=False)

    assert own.names == ours.names
    np.testing.assert_array_equal(own.values, ours.values)


def test_monitors_end_it():
    config = arm(**{"servo.torque_limit": 12, "monitors.torque_limit.hold": 0.1})
    jump = PiecewisePolynomial.ZeroOrderHold(
        [0, 0.1, 5], np.array([np.zeros(6), np.full(6, 1.2), np.full(6, 1.2)]).T
    )
    own = simulate_diagram(*wired(config, jump), duration=2.0, progress=False)

    ours = simulate(config, reference=jump, duration=2.0, progress=False)

    assert (own.ending, own.stopped_by) == ("monitor", "torque_limit")
    assert own.stop_time == pytest.approx(ours.stop_time, abs=2e-3)


@pytest.mark.long
def test_its_result_is_saved_and_goes_on(tmp_path):
    own = simulate_diagram(*wired(arm()), duration=0.4, progress=False)
    folder = own.save(tmp_path / "run")

    summary = json.loads((folder / "summary.json").read_text())
    assert summary["final"]["joint_position"]["joint_2"] == pytest.approx(own["q.joint_2"][-1])
    assert len((folder / "signals.csv").read_text().splitlines()) == 42
    assert {"position.png", "torque.png"} <= {file.name for file in save_plots(own, tmp_path)}

    still = np.array([0.0, 1.0]), own.axes("q_ref")[[-1, -1]]
    hold = simulate(arm(), start=own.final_state, reference=still, duration=0.1, progress=False)

    np.testing.assert_array_equal(hold.axes("q")[0], own.axes("q")[-1])


def test_it_begins_where_its_context_says():
    diagram, ports = wired(arm())
    context = diagram.CreateDefaultContext()
    plant = ports.plant.plant
    own = plant.GetMyMutableContextFromRoot(context)
    plant.SetPositions(own, plant.GetModelInstanceByName("robot::irb120"), np.full(6, 0.2))

    result = simulate_diagram(diagram, ports, duration=0.1, context=context, progress=False)

    np.testing.assert_allclose(result.axes("q")[0], 0.2)
    assert abs(result["q.joint_1"][-1]) < 0.19


class Faulty(LeafSystem):
    """A sampled block that fails."""

    def __init__(self) -> None:
        super().__init__()
        self.DeclareDiscreteState(1)
        self.DeclarePeriodicDiscreteUpdateEvent(0.05, 0.0, self._update)

    def _update(self, context, state):
        if context.get_time() > 0.19:
            raise KeyError("lost")


def test_an_exception_inside_is_told_and_the_run_kept(tmp_path):
    result = simulate_diagram(*wired(arm(), shaky=Faulty()), duration=0.5, progress=False)

    assert (result.ending, result.stopped_by) == ("failed", "shaky")
    assert "block shaky failed at 0.2 s" in result.message
    assert "KeyError" in result.message
    assert result.save(tmp_path / "run", recording=False).is_dir()


def test_an_exception_in_a_block_of_an_inner_diagram_names_the_block():
    inner = DiagramBuilder()
    inner.AddNamedSystem("shaky", Faulty())

    result = simulate_diagram(*wired(arm(), box=inner.Build()), duration=0.5, progress=False)

    assert (result.ending, result.stopped_by) == ("failed", "box::shaky")
    assert "block box::shaky failed at 0.2 s" in result.message


def test_a_station_in_a_box():
    config = arm()
    builder = DiagramBuilder()
    box = builder.AddSystem(build_station(config))
    source = builder.AddSystem(ConstantVectorSource(np.full(6, 0.1)))
    builder.Connect(source.get_output_port(), box.GetInputPort("reference"))
    own = simulate_diagram(builder.Build(), box.ports, duration=0.5, progress=False)
    flat = np.full((2, 6), 0.1)

    ours = simulate(config, reference=([0.0, 1.0], flat), duration=0.5, progress=False)

    assert own.names == ours.names
    np.testing.assert_allclose(own.values, ours.values, atol=1e-9)


def test_cenic_needs_the_station_at_the_top():
    builder = DiagramBuilder()
    box = builder.AddSystem(build_station("humanoid_dynamic"))
    source = builder.AddSystem(ConstantVectorSource(np.zeros(18)))

    builder.Connect(source.get_output_port(), box.GetInputPort("reference"))

    with pytest.raises(SimrobError, match="cenic"):
        simulate_diagram(builder.Build(), box.ports, duration=0.1, progress=False)


def test_a_duration_that_cannot_be():
    with pytest.raises(SimrobError, match="duration"):
        simulate_diagram(*wired(arm()), duration=-1)


def test_the_forces_of_its_station_act():
    push = {"start": 0.2, "duration": 0.3, "force": [0, -40, 0]}
    overrides = {
        "reference": {"kind": "hold"},
        "forces": {"push": push},
        "monitors": {"fall": {"tilt_deg": 30}},
    }
    config = load_station("humanoid_dynamic", {**overrides, "duration": 3})
    builder = DiagramBuilder()
    ports = add_station(builder, config)
    (robot,) = ports.plant.robots.values()
    where = builder.AddNamedSystem("where", ConstantVectorSource(robot.initial))
    builder.Connect(where.get_output_port(), ports.inputs["reference"])

    inside, alone = (
        simulate_diagram(builder.Build(), ports, progress=False),
        simulate(config, progress=False),
    )

    assert inside.stopped_by == alone.stopped_by == "fall"
    assert inside.stop_time == pytest.approx(alone.stop_time, abs=2e-3)
    np.testing.assert_array_equal(inside["applied_force.push.y"][21:50], -40)


def test_a_run_of_its_saved_station_gives_the_same(tmp_path):
    """The saved station has the recorded reference, and says that it is the station alone."""
    config = arm()
    own = simulate_diagram(*wired(config), duration=1.2, progress=False)

    folder = own.save(tmp_path / "run", recording=False)

    text = (folder / "station.yaml").read_text()
    assert text.startswith("# This file is the station alone, without the diagram in which it ran.")
    recorded = np.loadtxt(folder / "reference.csv", delimiter=",", skiprows=1)
    np.testing.assert_array_equal(recorded[:, 1:], own.axes("q_ref"))

    again = simulate(load_station(folder / "station.yaml"), progress=False)
    np.testing.assert_allclose(again.axes("q"), own.axes("q"), atol=1e-9)


def test_a_saved_station_begins_in_the_state_of_the_context(tmp_path):
    diagram, ports = wired(arm())
    context = diagram.CreateDefaultContext()
    plant = ports.plant.plant
    own_context = plant.GetMyMutableContextFromRoot(context)
    plant.SetPositions(own_context, plant.GetModelInstanceByName("robot::irb120"), np.full(6, 0.2))
    own = simulate_diagram(diagram, ports, duration=0.3, context=context, progress=False)
    folder = own.save(tmp_path / "run", recording=False)

    again = simulate(load_station(folder / "station.yaml"), progress=False)

    np.testing.assert_allclose(again.axes("q"), own.axes("q"), atol=1e-9)


def test_a_result_of_simulate_has_no_such_remark(tmp_path):
    folder = simulate(arm(), duration=0.1, progress=False).save(tmp_path / "run", recording=False)
    assert "alone" not in (folder / "station.yaml").read_text()
