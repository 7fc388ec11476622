"""A station with the ports of manipulation's MakeHardwareStation, and code as in its notebooks."""

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

from simrob_drake import build_hardware_station, load_station, simulate
from simrob_drake.base.errors import SimrobError

PORTS = (
    "position_commanded",
    "position_measured",
    "velocity_estimated",
    "state_estimated",
    "torque_commanded",
    "torque_measured",
)


@pytest.fixture(scope="module")
def config():
    """A station with one arm of six axes and a gripper, as discrete as manipulation's, called iiwa."""
    return load_station(
        "two_irb120", {"solver": {"kind": "discrete"}, "servo.realization": "implicit"}
    )


def gripper_station():
    return load_station(
        "irb120_gripper",
        {"pieces": {}, "monitors": {}, "reference": {"kind": "hold"}, "program": None},
    )


def test_ports_have_the_names_and_sizes_of_manipulation(config):
    station = build_hardware_station(config)

    for robot in ("left", "right"):
        sizes = {port: station.GetOutputPort(f"{robot}.{port}").size() for port in PORTS}
        assert sizes == {**dict.fromkeys(PORTS, 6), "state_estimated": 12}
        assert station.GetInputPort(f"{robot}.position").size() == 6
        assert station.GetInputPort(f"{robot}.torque").size() == 6
    for name in ("state", "body_poses", "contact_results", "query_object", "left_state"):
        assert station.HasOutputPort(name)
    assert station.HasInputPort("applied_spatial_force")
    assert station.get_name() == "station"

    plant = station.GetSubsystemByName("plant")
    assert plant.num_positions(plant.GetModelInstanceByName("left")) == 6


def test_positions_are_commanded_and_measured():
    """A posture that is set is measured, and feedforward is added to the torques."""
    station = build_hardware_station("two_irb120")
    context = station.CreateDefaultContext()
    plant = station.GetSubsystemByName("plant")
    plant_context = plant.GetMyContextFromRoot(context)
    posture = np.array([-0.5, 0.1, 0.2, -0.3, 0.4, 0.5])

    plant.SetPositions(plant_context, plant.GetModelInstanceByName("left"), posture)

    np.testing.assert_allclose(
        station.GetOutputPort("left.position_measured").Eval(context), posture
    )
    np.testing.assert_allclose(
        station.GetOutputPort("left.state_estimated").Eval(context), [*posture, *np.zeros(6)]
    )

    station.GetInputPort("left.position").FixValue(context, posture)
    np.testing.assert_allclose(
        station.GetOutputPort("left.position_commanded").Eval(context), posture
    )

    torques = []
    for feedforward in (np.zeros(6), np.linspace(0.1, 0.6, 6)):
        station.GetInputPort("left.torque").FixValue(context, feedforward)
        torques.append(station.GetOutputPort("left.torque_commanded").Eval(context))

    np.testing.assert_allclose(torques[1] - torques[0], np.linspace(0.1, 0.6, 6), atol=1e-12)


def test_it_moves_as_the_station(config):
    target = np.full(6, 0.2)
    builder = DiagramBuilder()
    station = builder.AddSystem(build_hardware_station(config))
    diagram = builder.Build()
    simulator = Simulator(diagram)
    context = station.GetMyMutableContextFromRoot(simulator.get_mutable_context())
    for robot in ("left", "right"):
        station.GetInputPort(f"{robot}.position").FixValue(context, target)
    simulator.AdvanceTo(0.2)
    table = ([0.0, 1.0], np.tile(target, (2, 1)))
    expected = simulate(
        config, reference={"left": table, "right": table}, duration=0.2, progress=False
    )

    measured = station.GetOutputPort("left.position_measured").Eval(context)

    np.testing.assert_allclose(measured, expected.axes("q", "left")[-1], atol=1e-12)


def test_a_gripper_opens_by_one_number():
    station = build_hardware_station(gripper_station(), grippers={"robot": "wsg"})
    simulator = Simulator(station)
    context = simulator.get_mutable_context()
    arm = np.array([0, 0, 0, 0, np.deg2rad(90), 0])

    station.GetInputPort("robot.position").FixValue(context, arm)

    for opening in (0.04, 0.01):
        station.GetInputPort("wsg.position").FixValue(context, [opening])
        simulator.AdvanceTo(context.get_time() + 0.5)
        width, speed = station.GetOutputPort("wsg.state_measured").Eval(context)
        assert width == pytest.approx(opening, abs=1e-3)
        assert speed == pytest.approx(0.0, abs=1e-3)
    assert station.GetOutputPort("wsg.force_measured").size() == 1
    assert station.GetOutputPort("robot.position_measured").size() == 6


def test_hooks_are_those_of_manipulation(config):
    called = []
    build_hardware_station(
        config,
        parser_preload=lambda parser: called.append(parser.plant().num_bodies()),
        prefinalize=lambda parser: called.append(parser.plant().HasModelInstanceNamed("left")),
        prebuild=lambda builder: called.append(builder.HasSubsystemNamed("plant")),
    )
    assert called == [1, True, True]


def test_a_kinematic_station_has_no_such_view():
    with pytest.raises(SimrobError, match="kinematic"):
        build_hardware_station("irb120_kinematic")
