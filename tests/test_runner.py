"""A station that is built once and run often: each run is that of `simulate`, and leaves the others alone."""

import json
import random
import subprocess
import sys

import numpy as np
import pytest
from pydrake.systems.framework import LeafSystem

from simrob_drake import load_station, simulate
from simrob_drake.base.errors import SimrobError
from simrob_drake.simulation import Runner, Ticks, simulate_diagram
from simrob_drake.stations.closed import closed_station
from simrob_drake.stations.resolve import resolve

DISCRETE = {
    "pieces": {},
    "floor": None,
    "servo.realization": "implicit",
    "solver": {"kind": "discrete", "time_step": 1e-3},
}
SINE = {"reference": {"kind": "sine", "amplitude_deg": 5, "frequency": 1}}
STATIONS = {
    "arm": ("irb120_dynamic", {}),
    "humanoid": ("humanoid_dynamic", {}),
    "kinematic": ("irb120_kinematic", {}),
    "discrete": ("irb120_dynamic", DISCRETE),
    "sine": ("irb120_dynamic", {**DISCRETE, **SINE}),
}


def station(name):
    model, overrides = STATIONS[name]
    return load_station(model, {**overrides, "duration": 0.2})


def asked(config):
    """Return what runs of a station can be asked, in some order: references, durations, starts and pushes."""
    count = len(next(iter(Runner(config)._station.robots.values())).axes)
    times = np.array([0.0, 0.05, 0.15])
    bent = np.outer([0, 0.02, 0.01], np.ones(count))
    start = simulate(config, duration=0.03, progress=False).final_state
    cases = [
        {},
        {"duration": 0.11},
        {"reference": (times, bent)},
        {"reference": (times, -bent), "duration": 0.07},
        {"start": start},
        {"start": start, "reference": np.column_stack([times, start.references["robot"] + bent])},
    ]
    if config.mode == "dynamic":
        push = {"start": 0.05, "duration": 0.02, "force": [0, 4, 0]}
        cases += [
            {"pushes": {"shove": push}},
            {"pushes": {"shove": {**push, "force": [1, 0, 2], "start": 0.0}}},
        ]
        cases += [{"pushes": {"shove": push, "other": {**push, "start": 0.06}}, "duration": 0.1}]
    return cases


LONG = {"sine": pytest.mark.long, "humanoid": pytest.mark.long}
"""Whose signals and steps another test of this file compares as well."""


def simulated(config, pushes=None, **case):
    forces = (
        {} if pushes is None else {name: {"kind": "push", **push} for name, push in pushes.items()}
    )
    model, overrides = next(
        each for each in STATIONS.values() if each[0] == config.name and _same(each, config)
    )
    given = load_station(
        model, {**overrides, "duration": 0.2, **({"forces": forces} if forces else {})}
    )
    return simulate(given, progress=False, **case)


def _same(entry, config):
    model, overrides = entry
    return load_station(model, {**overrides, "duration": 0.2}) == config


def assert_equal(one, other):
    """Check that two runs are the same to the last bit."""
    assert one.names == other.names
    np.testing.assert_array_equal(one.values, other.values)
    np.testing.assert_array_equal(one.step_times, other.step_times)
    assert (one.ending, one.message) == (other.ending, other.message)
    assert one.final_state.to_json() == other.final_state.to_json()


@pytest.mark.long
@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=LONG.get(name, [])) for name in STATIONS]
)
def test_every_run_is_that_of_simulate_in_any_order(name):
    config = station(name)
    cases = asked(config)
    expected = [simulated(config, **case) for case in cases]
    runner = Runner(config)
    order = [*range(len(cases)), *random.Random(1).sample(range(len(cases)), len(cases))]

    results = [(place, runner.run(**cases[place])) for place in order]

    for place, result in results:
        assert_equal(result, expected[place])


def test_a_sine_gives_way_to_other_references_and_comes_back():
    config = station("sine")
    runner = Runner(config)

    other = (np.array([0.0, 0.1]), np.outer([0, 0.1], np.ones(6)))
    for reference in (None, other, None, other):
        assert_equal(
            runner.run(reference=reference), simulate(config, reference=reference, progress=False)
        )


def test_a_result_keeps_telling_of_its_own_run():
    """What is evaluated late is that of its run, though the diagrams have played others since."""
    config = load_station("humanoid_dynamic", {"duration": 0.2})
    runner = Runner(config)
    bent = (np.array([0.0, 0.2]), np.outer([0, 0.05], np.ones(18)))
    early = runner.run(reference=bent, pushes={"shove": {"start": 0.05, "force": [0, 9, 0]}})
    looked = np.array([0.013, 0.06, 0.171])

    def told(result):
        forces = [
            [contacts.point_pair_contact_info(pair).contact_force() for pair in range(count)]
            for contacts in result.contacts_at(looked)
            if (count := contacts.num_point_pair_contacts())
        ]
        return result.positions_at(looked), forces

    positions, forces = told(early)
    values = early.values.copy()
    for _ in range(2):
        runner.run(duration=0.3)
        runner.run(pushes={"shove": {"start": 0.0, "force": [30, 0, 0]}})
    again, forces_again = told(early)
    np.testing.assert_array_equal(again, positions)
    assert len(forces) == 3
    for before, after in zip(forces, forces_again, strict=True):
        np.testing.assert_array_equal(before, after)
    np.testing.assert_array_equal(early.values, values)
    assert np.abs(runner.run().positions_at(looked) - positions).max() > 1e-3


def test_runs_that_go_on_are_one_run():
    config = station("discrete")
    runner = Runner(config)
    reference = (np.array([0.0, 0.4]), np.outer([0, 0.4], np.ones(6)))
    whole = runner.run(reference=reference, duration=0.2)
    first = runner.run(reference=reference, duration=0.1)
    rest = (np.array([0.0, 0.3]), np.outer([0.1, 0.4], np.ones(6)))

    second = runner.run(reference=rest, duration=0.1, start=first.final_state)

    np.testing.assert_allclose(second.axes("q")[1:], whole.axes("q")[11:], atol=1e-13)


MEASURE = """
import gc, json, resource, sys
from pydrake.systems.framework import Diagram
from simrob_drake import load_station
from simrob_drake.simulation import Runner

def peak():  # of the memory of this process [MB]
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / (1e6 if sys.platform == "darwin" else 1e3)

runner = Runner(load_station(sys.argv[1], {"duration": 0.05}))
push = {"shove": {"start": 0.01, "duration": 0.02, "force": [1, 0, 0]}}
runs = [{}, {"pushes": push}]
for number in range(20):
    result = runner.run(**runs[number % 2])
before = peak()
alive = sum(isinstance(each, Diagram) for each in gc.get_objects())
for number in range(100):
    result = runner.run(**runs[number % 2])
more = sum(isinstance(each, Diagram) for each in gc.get_objects()) - alive
print(json.dumps({"grown": peak() - before, "more": more}))
"""


@pytest.mark.long
@pytest.mark.parametrize("name", ["irb120_dynamic", "humanoid_dynamic"])
def test_a_hundred_runs_need_no_more_memory(name):
    done = subprocess.run(
        [sys.executable, "-c", MEASURE, name], check=True, capture_output=True, text=True
    )

    found = json.loads(done.stdout)
    assert found["more"] <= 0
    assert found["grown"] < 100 * 0.1  # MB


class TestPushesUnderCenic:
    """A run is cut at the edges of its pushes, and no force port is wired in between."""

    @pytest.mark.parametrize("fixed", [False, True])
    def test_the_motion_is_that_with_the_force_wired_all_the_time(self, fixed):
        solver = {"solver.error_control": False, "solver.max_step": 0.01} if fixed else {}
        push = {"kind": "push", "start": 0.2, "duration": 0.1, "force": [5, 3, 0]}
        config = load_station(
            "humanoid_dynamic", {"forces": {"shove": push}, "duration": 0.6, **solver}
        )
        cut = simulate(config, progress=False)
        closed = closed_station(resolve(config), monitors=False)

        wired = simulate_diagram(closed.diagram, closed.ports, progress=False)

        assert np.ptp(cut["base.x"]) > 5e-4
        np.testing.assert_allclose(cut.axes("q"), wired.axes("q"), atol=1e-6)
        # to which cenic solves for velocities
        np.testing.assert_allclose(cut.axes("v"), wired.axes("v"), atol=1e-5)
        np.testing.assert_allclose(cut.pose("base"), wired.pose("base"), atol=1e-6)
        np.testing.assert_array_equal(cut["applied_force.shove.x"], wired["applied_force.shove.x"])

    @pytest.mark.parametrize(
        "solver",
        [
            {"kind": "continuous", "scheme": "cenic", "max_step": 0.1, "error_control": False},
            {"kind": "continuous", "scheme": "cenic", "max_step": 0.02, "accuracy": 1e-3},
            {"kind": "discrete", "time_step": 1e-3},
        ],
        ids=["cenic, fixed steps", "cenic", "discrete"],
    )
    def test_a_free_body_takes_the_whole_impulse(self, solver):
        """Momentum is force times duration, wherever the edges lie between the steps of 0.1 s."""
        force = np.array([2.0, -3.0, 1.0])
        push = {
            "kind": "push",
            "at": "ball",
            "start": 0.13,
            "duration": 0.1,
            "force": force.tolist(),
        }
        alone = {"gravity": 0, "floor": None, "contact": None, "sensors": {}, "monitors": {}}
        config = load_station(
            "bouncing_ball", {**alone, "solver": solver, "forces": {"push": push}, "duration": 0.3}
        )
        result = simulate(config, progress=False)

        mass = result.plant.plant.CalcTotalMass(result.plant.plant.CreateDefaultContext())

        np.testing.assert_allclose(
            mass * result.piece_velocity("ball")[-1, :3], force * 0.1, rtol=1e-9
        )
        assert np.abs(result.piece_velocity("ball")[result.times < 0.13 - 1e-9]).max() == 0

    @pytest.mark.parametrize("scheme", ["cenic", "sap"])
    def test_a_robot_in_flight_takes_it_as_a_whole(self, scheme):
        """The servos' torques are inner ones; what is off is the tolerance to which these schemes solve for them."""
        force = np.array([2e-3, -3e-3, 1e-3])  # so small that it does not turn
        discrete = {"kind": "discrete", "time_step": 1e-3}
        solver = (
            discrete
            if scheme == "sap"
            else {"kind": "continuous", "scheme": "cenic", "max_step": 0.01}
        )
        push = {"kind": "push", "start": 0.1, "duration": 0.1, "force": force.tolist()}
        flight = {
            "gravity": 0,
            "floor": None,
            "contact": None,
            "monitors": {},
            "robot.base": [0, 0, 1, 0, 0, 0],
        }
        config = load_station(
            "humanoid_dynamic", {**flight, "solver": solver, "forces": {"push": push}}
        )
        result = simulate(config, duration=0.3, progress=False)
        plant = result.plant.plant
        context = plant.CreateDefaultContext()
        positions, velocities = result.final_state.of_plant(result.plant)
        plant.SetPositions(context, positions)
        plant.SetVelocities(context, velocities)

        momentum = plant.CalcSpatialMomentumInWorldAboutPoint(context, np.zeros(3)).translational()

        np.testing.assert_allclose(momentum, force * 0.1, rtol=1e-3)


class Told(LeafSystem):
    """Tell twice the positions of the arm's joints."""

    def __init__(self) -> None:
        super().__init__()
        self._position = self.DeclareVectorInputPort("position", 6)
        self.DeclareVectorOutputPort("twice", 6, self._calc)

    def _calc(self, context, output):
        output.SetFromVector(2 * self._position.Eval(context))


class TestBadInput:
    def test_a_push_that_cannot_be(self):
        runner = Runner(station("arm"))

        with pytest.raises(SimrobError, match="pushes: shove"):
            runner.run(pushes={"shove": {"force": [1, 2]}})
        with pytest.raises(SimrobError, match="pushes: shove"):
            runner.run(pushes={"shove": 3})
        with pytest.raises(SimrobError, match=r"forces\.shove\.at.*'tol'"):
            runner.run(pushes={"shove": {"at": "tol", "force": [1, 2, 3]}})
        with pytest.raises(SimrobError, match="kinematic"):
            Runner(station("kinematic")).run(pushes={"shove": {"force": [1, 2, 3]}})

    def test_blocks_of_ones_own_stand_in_one_diagram(self):
        runner = Runner(station("discrete"), blocks={"told": Told()})
        first = runner.run()

        assert_equal(runner.run(), first)
        np.testing.assert_array_equal(first["told.twice.joint_2"], 2 * first["q.joint_2"])
        with pytest.raises(SimrobError, match="a block can be in one diagram only"):
            runner.run(pushes={"shove": {"force": [1, 2, 3]}})

    def test_a_run_that_is_refused_spoils_no_other(self):
        config = station("discrete")
        runner = Runner(config)

        before = runner.run()

        for wrong in (
            {"duration": -1},
            {"reference": np.zeros((3, 3))},
            {"reference": ([0, 1], np.full((2, 6), 9.0))},
        ):
            with pytest.raises(SimrobError):
                runner.run(**wrong)
        assert_equal(runner.run(), before)

    def test_a_run_that_diverges_spoils_no_other(self):
        wild = {"servo.torque_limit": 1e12, "monitors": {}}
        wild["solver"] = {"kind": "continuous", "scheme": "explicit_euler", "max_step": 0.01}
        runner = Runner(load_station("irb120_dynamic", wild))
        jump = (np.array([0.0, 0.01, 1.0]), np.outer([0, 1, 1], np.ones(6)))

        first, second = (runner.run(reference=jump, duration=0.5) for _ in range(2))

        assert first.ending == "diverged"
        assert_equal(first, second)


def test_pushes_are_those_of_the_run_for_which_a_diagram_is_first_needed():
    """Without the sensor, which only reports, a diagram is stepped that is built when something pushes."""
    push = {"kind": "push", "start": 0.15, "force": [9, 0, 0]}
    config = load_station(
        "roid1_dynamic", {"duration": 0.1, "sensors.imu": {"kind": "imu"}, "forces.push": push}
    )
    runner = Runner(config)
    runner.run()

    other = {"push": {"start": 0.02, "force": [0, 5, 0]}}

    assert np.array_equal(runner.run(pushes=other).values, Runner(config).run(pushes=other).values)


def test_repeated_steps_are_counted_over_the_whole_run_although_the_solver_starts_anew() -> None:
    """The solver repeats most steps at the start of the move, which is before the tick in the middle."""
    runner = Runner(load_station("irb120_dynamic"))

    first_half = runner.run(duration=0.3)
    whole = runner.run(duration=0.6, ticks=Ticks(0.3))

    assert first_half.shortened > whole.shortened / 2
    assert whole.shortened > first_half.shortened


def test_a_tick_at_an_edge_has_exactly_its_time():
    """Two stops that differ by rounding only would have a step of 1e-13 s between them."""
    edge = 0.2 + 1e-13

    assert Ticks(0.1).times(0.3, [0.05, edge]) == [0.1, edge, 0.3]
    assert Ticks(0.1).times(0.3, []) == [0.1, 0.2, 0.3]


def test_the_end_of_a_run_at_an_edge_has_exactly_its_time():
    edge = 0.3 - 1e-13

    assert Ticks(0.1).times(0.3, [edge]) == [0.1, 0.2, edge]
