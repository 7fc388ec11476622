"""Stations as parts of diagrams: ports, realizations, kinematics, several robots, foreign URDFs."""

import shutil

import numpy as np
import pytest
import yaml
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantVectorSource

from simrob_drake import add_station, apply_solver, build_station, load_station, simulate
from simrob_drake.base.errors import SimrobError
from simrob_drake.base.files import models_root
from simrob_drake.base.frames import transform_from_pose, transform_from_xyz_quaternion
from simrob_drake.simulation.built import StationDiagrams
from simrob_drake.stations.closed import station_references
from simrob_drake.stations.resolve import resolve

REALIZATIONS = ("per_joint", "vector", "implicit")


def ports_of(station):
    inputs = {
        station.get_input_port(index).get_name() for index in range(station.num_input_ports())
    }
    outputs = {
        station.get_output_port(index).get_name() for index in range(station.num_output_ports())
    }
    return inputs, outputs


def test_the_ports_are_those_of_the_contract():
    inputs, outputs = ports_of(build_station(load_station("irb120_dynamic")))
    assert inputs == {"reference"}
    assert {
        "position",
        "velocity",
        "torque",
        "base_pose",
        "tcp_pose",
        "tcp_pose.gripper",
        "tcp_pose.load",
    } <= outputs


def test_listed_inputs_are_added():
    names = ["feedforward", "reference_velocity", "external_force"]
    station = build_station(load_station("irb120_dynamic", {"inputs": names}))

    assert ports_of(station)[0] == {"reference", *names}
    assert station.GetInputPort("external_force").size() == 3
    assert station.GetInputPort("feedforward").size() == 6


def test_ports_of_several_robots_carry_their_names():
    inputs, outputs = ports_of(build_station(load_station("two_irb120")))
    assert inputs == {"left.reference", "right.reference"}
    assert {
        "left.position",
        "right.torque",
        "left.tcp_pose",
        "right.tcp_pose.right_gripper",
    } <= outputs


def test_the_plant_stands_directly_in_the_builder():
    builder = DiagramBuilder()
    ports = add_station(builder, load_station("irb120_dynamic"))

    assert builder.HasSubsystemNamed("plant")
    assert builder.GetSubsystemByName("plant") is ports.plant.plant


def stepped_blocks(config):
    """Return the names of the blocks that a run of a station steps."""
    station = resolve(config)
    diagrams = StationDiagrams(station, station_references(station), {})
    return {system.get_name() for system in diagrams.diagram_at(0.0).diagram.GetSystems()}


def test_blocks_that_only_report_are_not_stepped():
    """Poses come from the recorded states; a source that nothing else drives needs no block behind it."""
    assert not {"poses", "state", "reference"} & stepped_blocks(load_station("irb120_dynamic"))
    assert {"reference_source", "plant"} <= stepped_blocks(load_station("irb120_dynamic"))
    assert not {"poses", "base_velocity"} & stepped_blocks(load_station("humanoid_dynamic"))


def test_a_loop_that_reads_a_pose_has_its_block():
    flow = {
        "kind": "signal_flow",
        "blocks": {"height": {"kind": "sum", "of": ["tcp.z"]}},
        "torque": {},
    }
    config = load_station("irb120_dynamic", {"controllers": {"law": flow}, "duration": 0.2})

    assert "poses" in stepped_blocks(config)

    result = simulate(config)
    np.testing.assert_array_equal(result["law.height"], result["tcp.z"])


def torque_at(realization, overrides=None, **inputs):
    """Return the torques of a station at its start for fixed inputs."""
    config = load_station("irb120_dynamic", {"servo.realization": realization, **(overrides or {})})
    station = build_station(config)
    context = station.CreateDefaultContext()
    for name, value in inputs.items():
        station.GetInputPort(name).FixValue(context, value)
    return station.GetOutputPort("torque").Eval(context)


@pytest.mark.parametrize("realization", REALIZATIONS)
def test_the_servo_law(realization):
    reference, velocity = np.linspace(-0.02, 0.03, 6), np.linspace(0.1, -0.2, 6)
    feedforward = np.linspace(1, 2, 6)
    overrides = {"inputs": ["feedforward", "reference_velocity"], "robot.initial_deg": 1.0}

    torque = torque_at(
        realization,
        overrides,
        reference=reference,
        reference_velocity=velocity,
        feedforward=feedforward,
    )

    expected = 1000 * (reference - np.deg2rad(1.0)) + 10 * velocity + feedforward
    np.testing.assert_allclose(torque, expected, rtol=1e-12)


@pytest.mark.parametrize("realization", REALIZATIONS)
def test_the_torque_saturates_at_each_joints_limit(realization):
    limits = [1.0, 2, 3, 4, 5, 6]
    torque = torque_at(
        realization, {"servo.torque_limit": limits}, reference=np.array([1.0, -1, 1, -1, 1, -1])
    )
    np.testing.assert_allclose(torque, np.array(limits) * [1, -1, 1, -1, 1, -1])


@pytest.mark.parametrize("realization", REALIZATIONS)
def test_an_integral_part_takes_the_sag_away(realization):
    overrides = {
        "servo.realization": realization,
        "servo.ki": 3000,
        "duration": 6,
        "reference.kind": "hold",
    }
    result = simulate(load_station("irb120_dynamic", {**overrides, "robot.initial_deg": 30}))
    np.testing.assert_allclose(result.axes("q")[-1], np.deg2rad(30), atol=1e-4)


def test_a_box_in_a_diagram_runs_with_every_scheme_but_cenic():
    def simulator_of(scheme):
        config = load_station("double_pendulum", {"solver.scheme": scheme})
        builder = DiagramBuilder()
        station = builder.AddSystem(build_station(config))
        source = builder.AddSystem(ConstantVectorSource(np.deg2rad([40.0, 30.0])))
        builder.Connect(source.get_output_port(), station.GetInputPort("reference"))
        return Simulator(builder.Build()), config

    simulator, config = simulator_of("radau3")
    apply_solver(simulator, config)
    simulator.AdvanceTo(0.1)
    simulator, config = simulator_of("cenic")
    with pytest.raises(SimrobError, match=r"cenic.*add_station\(\)"):
        apply_solver(simulator, config)


@pytest.mark.parametrize(
    ("port", "value", "felt"),
    [
        # Along the tool's axis, world x at zero. The tip lies at (0.592, 0, 0.630) there: 0.340 above joint 2 and
        # 0.070 above joint 3 (facts of the arm).
        ("external_force", [0.0, 0.0, 10.0], [0, 3.4, 0.7, 0, 0, 0]),
        ("external_torque", [0.0, 0.0, 2.0], [0, 0, 0, 2, 0, 2]),  # joints 4 and 6 turn about it
        ("external_torque", [3.0, 0.0, 0.0], [0, 3, 3, 0, 3, 0]),  # world y, as joints 2, 3 and 5
    ],
)
def test_an_external_force_is_felt_as_its_torque(port, value, felt):
    config = load_station("irb120_dynamic", {"inputs": [port], "gravity": 0.0, "servo.kd": 0})
    builder = DiagramBuilder()
    ports = add_station(builder, config)
    force = builder.AddSystem(ConstantVectorSource(value))
    zero = builder.AddSystem(ConstantVectorSource(np.zeros(6)))
    builder.Connect(force.get_output_port(), ports.inputs[port])
    builder.Connect(zero.get_output_port(), ports.inputs["reference"])
    diagram = builder.Build()
    context = diagram.CreateDefaultContext()
    plant = ports.plant.plant
    acceleration = diagram.EvalTimeDerivatives(context).get_generalized_velocity().CopyToVector()

    mass = plant.CalcMassMatrix(plant.GetMyContextFromRoot(context))

    np.testing.assert_allclose(mass @ acceleration, felt, atol=1e-9)


def test_a_kinematic_station_gives_the_torques_of_inverse_dynamics():
    station = build_station(load_station("irb120_kinematic"))
    context = station.CreateDefaultContext()
    rng = np.random.default_rng(1)
    q, v, a = rng.uniform(-1, 1, (3, 6))
    for name, value in (("reference", q), ("reference_velocity", v), ("reference_acceleration", a)):
        station.GetInputPort(name).FixValue(context, value)
    plant = station.ports.plant.plant
    own = plant.CreateDefaultContext()
    plant.SetPositions(own, q)
    plant.SetVelocities(own, v)

    expected = (
        plant.CalcMassMatrix(own) @ a
        + plant.CalcBiasTerm(own)
        - plant.CalcGravityGeneralizedForces(own)
    )

    np.testing.assert_allclose(station.GetOutputPort("torque").Eval(context), expected, atol=1e-10)
    np.testing.assert_array_equal(station.GetOutputPort("position").Eval(context), q)


def test_two_arms_move_as_each_would_alone():
    """Both runs are within 1e-3 rad of a converged one, the accuracy that the stations ship."""
    alone = {
        "pieces": {},
        "pieces.gripper.parent": "robot",
        "pieces.gripper.pose": [0, 0, 0, np.pi / 2, 0, 0],
        "reference.kind": "move",
        "reference.target_deg": 30,
    }

    both = simulate(load_station("two_irb120"))
    left = simulate(load_station("irb120_dynamic", alone))

    np.testing.assert_allclose(both.axes("q", "left"), left.axes("q"), atol=2e-3)
    np.testing.assert_allclose(both.axes("tau", "left")[-1], left.axes("tau")[-1], atol=0.01)
    assert np.rad2deg(both["right.q.joint_1"][-1]) == pytest.approx(-40, abs=0.01)
    np.testing.assert_allclose(both.pose("base", "left")[-1], [0, 0.45, 0, 1, 0, 0, 0], atol=1e-12)


def test_a_robots_base_moves_its_tool_along():
    base = [0.1, -0.2, 0.3, 0.4, 0.5, 0.6]
    moved, straight = (
        simulate(load_station("irb120_dynamic", o), duration=0.02)
        for o in ({"robot.base": base}, {})
    )

    expected = transform_from_pose(base) @ transform_from_xyz_quaternion(straight.pose("tcp")[0])

    assert expected.IsNearlyEqualTo(transform_from_xyz_quaternion(moved.pose("tcp")[0]), 1e-12)


def test_any_clean_urdf_by_path_gives_the_same_motion(tmp_path):
    folder = tmp_path / "mine"
    shutil.copytree(models_root() / "irb120", folder)
    (folder / "robot.yaml").unlink()
    overrides = {"pieces": {}, "robot": {"model": None, "urdf": str(folder / "irb120.urdf")}}
    mine = simulate(load_station("irb120_dynamic", overrides), duration=0.3)

    ours = simulate(load_station("irb120_dynamic", {"pieces": {}}), duration=0.3)

    np.testing.assert_array_equal(mine.axes("q"), ours.axes("q"))


def test_a_link_without_inertia_is_refused_for_dynamics_and_moves_kinematically(tmp_path):
    folder = tmp_path / "light"
    shutil.copytree(models_root() / "irb120", folder)
    text = (folder / "irb120.urdf").read_text()
    start = text.index("<inertial>", text.index('<link name="link_6"'))
    end = text.index("</inertial>", start) + len("</inertial>")

    (folder / "irb120.urdf").write_text(text[:start] + text[end:])

    robot = {"robot": {"model": None, "urdf": str(folder / "irb120.urdf")}, "pieces": {}}
    with pytest.raises(SimrobError, match="moving links link_6 have no inertia"):
        simulate(load_station("irb120_dynamic", robot))
    assert simulate(load_station("irb120_kinematic", robot), duration=0.1).ending == "completed"


def test_the_velocity_of_a_base_is_that_of_its_pose():
    station = build_station(
        load_station("humanoid_dynamic", {"solver": {"kind": "discrete", "time_step": 1e-3}})
    )
    context = station.CreateDefaultContext()
    plant = station.ports.plant.plant
    state = plant.GetMyMutableContextFromRoot(context)
    velocities = np.random.default_rng(0).normal(size=plant.num_velocities())
    plant.SetVelocities(state, velocities)
    root = station.ports.plant.robots["robot"].root
    expected = root.CalcSpatialVelocityInWorld(plant.GetMyContextFromRoot(context))

    told = station.GetOutputPort("base_velocity").Eval(context)

    assert told == pytest.approx(np.concatenate([expected.translational(), expected.rotational()]))


def test_a_force_at_the_tool_of_a_robot_without_tools_is_refused_and_one_beside_it_may_have_some(
    tmp_path,
):
    (tmp_path / "bare.urdf").write_text(
        '<robot name="bare"><link name="base"/><link name="arm"><inertial><mass value="1"/>'
        '<inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>'
        '<joint name="j" type="revolute">'
        '<parent link="base"/><child link="arm"/><axis xyz="0 1 0"/>'
        '<limit lower="-1" upper="1" effort="10" velocity="1"/></joint></robot>'
    )
    (tmp_path / "robot.yaml").write_text("urdf: bare.urdf\nbase: fixed\nroot: base\naxes: [j]\n")
    bare, file = {"model": "robot.yaml"}, tmp_path / "station.yaml"

    file.write_text(yaml.safe_dump({"robot": bare, "inputs": ["external_force"]}))

    with pytest.raises(SimrobError, match=r"external_force.*for a robot with a tool"):
        build_station(load_station(file))

    file.write_text(
        yaml.safe_dump(
            {"robots": {"a": bare, "b": {"model": "irb120"}}, "inputs": ["external_force"]}
        )
    )
    station = build_station(load_station(file))

    assert station.HasInputPort("b.external_force")
    assert not station.HasInputPort("a.external_force")
