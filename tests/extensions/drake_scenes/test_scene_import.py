"""Scenes of Drake as stations: the same mechanics as in plain Drake, servos of their drivers, and runs."""

from pathlib import Path

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator

from simrob_drake import build_station, load_station, simulate
from simrob_drake.base.errors import InvalidConfig
from simrob_drake.cli.app import run_command
from simrob_drake.stations.config import StationConfig
from tests.extensions.drake_scenes.samples import (
    SCENES,
    OwnPlant,
    PlainPlant,
    body_values,
    joint_values,
)

STATIONS = ["irb120_dynamic", "double_pendulum", "two_arms", "humanoid_dynamic", "box_on_floor"]
FILES = [
    "table_top.dmd.yaml",
    "arm_and_gripper.dmd.yaml",
    "pendulum.dmd.yaml",
    "stiffness.scenario.yaml",
]


def imported(file: Path, folder: Path, *options: str) -> StationConfig:
    """Import a scene with the command, and load the station that it writes."""
    assert run_command(["import", str(file), "--out", str(folder), *options]) == 0
    return load_station(folder / f"{file.name.partition('.')[0]}.yaml")


def directives_of(file: Path, folder: Path) -> Path:
    """Write the directives of a scene alone, which is what Drake's own parser loads."""
    text = file.read_text()
    target = folder / "directives.dmd.yaml"
    target.write_text(text[: text.index("plant_config:")] if "plant_config:" in text else text)
    return target


@pytest.mark.parametrize("name", FILES)
def test_a_scene_has_the_mechanics_of_plain_drake(name: str, tmp_path: Path) -> None:
    """The station has fewer bodies, since welded ones are one. Mass matrix and gravity torques stay the same."""
    own = OwnPlant(load_station(SCENES / name)).plant
    plain = PlainPlant(directives_of(SCENES / name, tmp_path), SCENES).plant
    own_joints, plain_joints = joint_values(own), joint_values(plain)
    assert own_joints.keys() == plain_joints.keys()
    values = {}
    for key, plant in (("own", own), ("plain", plain)):
        context = plant.CreateDefaultContext()
        order = [plant.GetJointByName(joint).velocity_start() for joint in plain_joints]
        # Velocities of free bodies come in the order of the bodies, six each, in both plants.
        order += [index for index in range(plant.num_velocities()) if index not in order]
        mass = plant.CalcMassMatrix(context)[np.ix_(order, order)]
        values[key] = mass, plant.CalcGravityGeneralizedForces(context)[order]
    free = slice(len(plain_joints), None)
    joints = slice(0, len(plain_joints))
    mass_error = values["own"][0][joints, joints] - values["plain"][0][joints, joints]
    assert abs(mass_error).max(initial=0.0) < 1e-12
    gravity_error = values["own"][1][joints] - values["plain"][1][joints]
    assert abs(gravity_error).max(initial=0.0) < 1e-12
    # The weight of the free pieces; their frames may be posed otherwise, so only the sums are compared.
    assert np.trace(values["own"][0][free, free]) == pytest.approx(
        np.trace(values["plain"][0][free, free]), abs=1e-12
    )
    for joint, expected in plain_joints.items():
        position_limits_and_start = [0, 1, 4, 5]
        assert own_joints[joint][position_limits_and_start] == pytest.approx(
            expected[position_limits_and_start], abs=1e-12
        )


def test_welds_and_free_bodies_are_where_drake_has_them(tmp_path: Path) -> None:
    own = body_values(OwnPlant(load_station(SCENES / "table_top.dmd.yaml")).plant)
    plain = body_values(PlainPlant(SCENES / "table_top.dmd.yaml", SCENES).plant)
    pose = slice(37, 53)
    assert own["table", "table"][pose] == pytest.approx(plain["table", "top"][pose], abs=1e-12)
    assert own["brick", "brick"][pose] == pytest.approx(plain["brick", "wood"][pose], abs=1e-12)
    assert own["second_brick", "second_brick"][pose] == pytest.approx(
        plain["second_brick", "wood"][pose], abs=1e-12
    )
    # Two bodies that are welded are one piece, of both masses.
    assert own["brick", "brick"][0] == plain["brick", "wood"][0] + plain["brick", "lead"][0]


def test_a_pendulum_without_a_motor_moves_as_in_plain_drake() -> None:
    result = simulate(load_station(SCENES / "pendulum.dmd.yaml", {"duration": 1.0}), progress=False)
    plain = PlainPlant(SCENES / "pendulum.dmd.yaml", SCENES)
    diagram = plain.builder.Build()
    simulator = Simulator(diagram)
    simulator.AdvanceTo(1.0)
    context = plain.plant.GetMyContextFromRoot(simulator.get_context())
    expected = plain.plant.GetJointByName("swing").get_angle(context)
    assert expected < -0.2  # it has swung to the other side
    assert result["q.swing"][-1] == pytest.approx(expected, abs=1e-9)
    assert not result["tau.swing"].any()


def test_a_stiffness_driver_is_a_servo_with_gravity_torque() -> None:
    config = load_station(SCENES / "stiffness.scenario.yaml")
    servo = config.robots["arm"].servo
    assert servo is not None
    assert (servo.law, servo.feedforward) == ("pid", "gravity")
    assert servo.kp == {"turn": 400.0, "lift": 600.0, "left_slide": 7200.0, "right_slide": 7200.0}
    assert servo.kd == {"turn": 20.0, "lift": 30.0, "left_slide": 5.0, "right_slide": 5.0}
    assert config.solver.model_dump() == {"kind": "discrete", "time_step": 0.001, "scheme": "sap"}
    assert (config.duration, config.gravity) == (1.0, 9.81)
    result = simulate(config, progress=False)
    # With its weight compensated, the arm stays where it starts.
    assert result["q.lift"][-1] == pytest.approx(0.3, abs=1e-3)
    camera = config.sensors["overview"].model_dump()
    assert (camera["frame"], camera["width"], camera["height"]) == ("world", 160, 120)
    assert camera["opening_deg"] == pytest.approx(45.0)
    assert camera["pose"][:3] == (0.0, 0.0, 1.5)


def test_drivers_with_inverse_dynamics_are_computed_torque(tmp_path: Path) -> None:
    config = imported(SCENES / "drivers.scenarios.yaml", tmp_path / "out", "--scenario", "Iiwa")
    servo = config.robots["arm"].servo
    assert servo is not None
    assert isinstance(servo.kp, dict)
    assert isinstance(servo.kd, dict)
    assert servo.law == "computed_torque"
    assert (servo.kp["turn"], servo.kp["lift"]) == (100.0, 225.0)
    assert (servo.kd["turn"], servo.kd["lift"]) == (20.0, 30.0)  # 2 √kp: critically damped
    # A finger of 50 g: 7200 N/m for 0.05 kg.
    assert servo.kp["left_slide"] == pytest.approx(7200 / 0.05)


def test_without_force_an_arm_falls(tmp_path: Path) -> None:
    config = imported(SCENES / "drivers.scenarios.yaml", tmp_path / "out", "--scenario", "Falling")
    result = simulate(config, duration=0.5, progress=False)
    assert not result["tau.lift"].any()
    assert result["q.lift"][-1] < 0.3 - 0.5


def test_a_model_without_driver_is_passive_in_a_scenario(tmp_path: Path) -> None:
    config = imported(SCENES / "drivers.scenarios.yaml", tmp_path / "out", "--scenario", "Held")
    result = simulate(config, duration=0.5, progress=False)
    assert not result["tau.left_slide"].any()
    assert result["tau.lift"][-1] > 1.0  # the weight of boom and gripper
    assert result["q.lift"][-1] == pytest.approx(0.3, abs=0.02)


def test_check_takes_a_scene(capsys: pytest.CaptureFixture[str]) -> None:
    assert run_command(["check", str(SCENES / "stiffness.scenario.yaml")]) == 0
    words = " ".join(capsys.readouterr().out.split())
    assert "robots arm" in words
    assert "the models arm, gripper are one robot" in words


@pytest.mark.long
@pytest.mark.parametrize("name", FILES)
def test_commands_take_a_scene(name: str, tmp_path: Path) -> None:
    arguments = ["--duration", "0.05", "--out", str(tmp_path / "run"), "--no-recording"]
    assert run_command(["run", str(SCENES / name), *arguments]) == 0
    assert (tmp_path / "run" / "signals.csv").is_file()
    # The saved station runs again by itself, with its own copies of robots and pieces.
    again = [
        "run",
        str(tmp_path / "run" / "station.yaml"),
        "--out",
        str(tmp_path / "again"),
        *arguments[:2],
    ]
    assert run_command(again) == 0


def test_an_imported_folder_can_be_moved(tmp_path: Path) -> None:
    imported(SCENES / "stiffness.scenario.yaml", tmp_path / "first")
    (tmp_path / "first").rename(tmp_path / "second")
    moved = load_station(tmp_path / "second" / "stiffness.yaml")
    assert list(moved.robots) == ["arm"]
    assert moved.free_pieces == ["brick"]


@pytest.mark.parametrize("station", STATIONS)
def test_a_station_comes_back(station: str, tmp_path: Path) -> None:
    file = tmp_path / "scene.dmd.yaml"
    assert run_command(["export", station, "--dmd", str(file)]) == 0
    before = OwnPlant(load_station(station)).plant
    after = OwnPlant(load_station(file)).plant
    first, second = body_values(before), body_values(after)
    second.pop(("floor", "floor"), None)  # the floor's picture, a piece
    assert first.keys() == second.keys()
    assert max(abs(first[key] - second[key]).max() for key in first) < 1e-12
    joints, same_joints = joint_values(before), joint_values(after)
    assert joints.keys() == same_joints.keys()
    for name, values in joints.items():
        assert values == pytest.approx(same_joints[name], abs=1e-12)


def test_a_station_that_comes_back_runs_alike(tmp_path: Path) -> None:
    """With the torque against gravity, which the driver of the scenario adds, both stations are the same."""
    changes = {
        "reference": {"kind": "hold"},
        "servo.feedforward": "gravity",
        "servo.realization": "implicit",
        "solver": {"kind": "discrete", "time_step": 1e-3, "scheme": "sap"},
        "robot.initial_deg": {"joint_2": 20, "joint_3": -10},
        "gravity": 9.81,
        "duration": 0.3,
    }
    config = load_station("irb120_dynamic", changes)
    from simrob_drake.extensions.drake_scenes.exporting import save_scenario

    file = tmp_path / "scene.yaml"
    save_scenario(config, file, force=False)
    first = simulate(config, progress=False)
    second = simulate(load_station(file), progress=False)
    for joint in ("joint_2", "joint_3", "joint_5"):
        assert second[f"q.{joint}"] == pytest.approx(first[f"q.{joint}"], abs=1e-9)
        assert second[f"tau.{joint}"] == pytest.approx(first[f"tau.{joint}"], abs=1e-6)


class TestAddDirectives:
    """The key ``add_directives`` of a station."""

    def test_a_station_gets_robots_and_pieces(self, tmp_path: Path) -> None:
        station = tmp_path / "station.yaml"
        station.write_text(
            f"packages: {{simrob_scenes: {SCENES}}}\n"
            "add_directives: [package://simrob_scenes/arm_and_gripper.dmd.yaml, "
            "package://simrob_scenes/table_top.dmd.yaml]\n"
            "robots: {arm: {servo: {kp: 900, kd: 40}}}\n"
            "pieces: {post: {box: [0.1, 0.1, 1], parent: world}}\n"
            "contact: {}\nsolver: {kind: discrete}\nduration: 0.1\n"
        )
        config = load_station(station, mesh_path=[SCENES])
        assert list(config.robots) == ["arm"]
        assert {*config.pieces} == {"table", "brick", "second_brick", "post"}
        servo = config.robots["arm"].servo
        assert servo is not None
        assert servo.kp == 900
        assert simulate(config, progress=False).ending == "completed"

    def test_of_several_scenarios_one_is_named(self, tmp_path: Path) -> None:
        station = tmp_path / "station.yaml"
        station.write_text(
            f"add_directives: ['{SCENES / 'drivers.scenarios.yaml'}#Falling']\nsolver: {{kind: discrete}}\n"
        )
        config = load_station(station, mesh_path=[SCENES])
        assert list(config.robots) == ["arm"]

    def test_two_files_with_a_model_of_one_name(self, tmp_path: Path) -> None:
        station = tmp_path / "station.yaml"
        file = SCENES / "pendulum.dmd.yaml"
        station.write_text(f"add_directives: [{file}, {file}]\n")
        with pytest.raises(InvalidConfig, match="add_directives: two files have a model pendulum"):
            load_station(station, mesh_path=[SCENES])

    def test_a_file_beyond_the_border_is_refused(self, tmp_path: Path) -> None:
        station = tmp_path / "station.yaml"
        station.write_text(f"add_directives: [{SCENES / 'pendulum.dmd.yaml'}]\n")
        with pytest.raises(InvalidConfig, match="is outside the allowed folders"):
            load_station(station)


class TestPackages:
    """Paths that begin with ``package://``."""

    URDF = "package://my_arm/models/arm.urdf"

    def test_a_named_package_holds_the_urdf(self, tmp_path: Path) -> None:
        station = tmp_path / "station.yaml"
        station.write_text(
            f"packages: {{my_arm: {SCENES}}}\nrobot: {{urdf: '{self.URDF}'}}\nmode: kinematic\n"
        )
        config = load_station(station, mesh_path=[SCENES])
        assert config.robots["robot"].urdf == SCENES / "models" / "arm.urdf"

    def test_an_override_names_the_package(self, tmp_path: Path) -> None:
        station = tmp_path / "station.yaml"
        station.write_text(f"robot: {{urdf: '{self.URDF}'}}\nmode: kinematic\n")
        config = load_station(station, {"packages.my_arm": str(SCENES)}, mesh_path=[SCENES])
        assert config.robots["robot"].urdf == SCENES / "models" / "arm.urdf"

    def test_ros_package_path_is_searched(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        station = tmp_path / "station.yaml"
        uri = self.URDF.replace("my_arm", "simrob_scenes")
        station.write_text(f"robot: {{urdf: '{uri}'}}\nmode: kinematic\n")
        monkeypatch.setenv("ROS_PACKAGE_PATH", str(SCENES.parent))
        config = load_station(station)
        assert config.robots["robot"].urdf == SCENES / "models" / "arm.urdf"

    def test_an_unknown_package_is_named(self, tmp_path: Path) -> None:
        station = tmp_path / "station.yaml"
        station.write_text(f"robot: {{urdf: '{self.URDF}'}}\nmode: kinematic\n")
        with pytest.raises(
            InvalidConfig, match=r"robot\.urdf: package://my_arm.* names the package my_arm"
        ):
            load_station(station)

    def test_meshes_of_a_named_package(self, tmp_path: Path) -> None:
        """The folder of a package need not have its name, nor a manifest."""
        meshes = tmp_path / "elsewhere" / "anything"
        meshes.mkdir(parents=True)
        cube = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"
        (meshes / "part.obj").write_text(cube)
        own = tmp_path / "own"
        own.mkdir()
        text = (SCENES / "models" / "arm.urdf").read_text()
        box = '<box size="0.4 0.05 0.05"/>'
        (own / "arm.urdf").write_text(
            text.replace(box, '<mesh filename="package://parts/part.obj"/>')
        )
        station = own / "station.yaml"
        station.write_text(
            "packages: {parts: ../elsewhere/anything}\nrobot: {urdf: arm.urdf}\nmode: kinematic\n"
        )
        config = load_station(station, mesh_path=[tmp_path / "elsewhere"])
        own_plant = OwnPlant(config)
        meshes_of_plant = [
            shape
            for shape in own_plant.station.scene_graph.model_inspector().GetAllGeometryIds()
            if "Mesh"
            in type(own_plant.station.scene_graph.model_inspector().GetShape(shape)).__name__
        ]
        assert meshes_of_plant


def test_a_piece_of_a_scene_is_as_stiff_as_its_shape(tmp_path: Path) -> None:
    """The surface that the station's plant gives a ball has the stiffness and friction of the ball's own file."""
    (tmp_path / "ball.urdf").write_text(
        '<robot name="ball"><link name="ball"><inertial><mass value="1"/>'
        '<inertia ixx="1e-3" iyy="1e-3" izz="1e-3" ixy="0" ixz="0" iyz="0"/></inertial>'
        '<collision><geometry><sphere radius="0.05"/></geometry><drake:proximity_properties>'
        '<drake:point_contact_stiffness value="30000"/><drake:mu_static value="0.6"/><drake:mu_dynamic value="0.5"/>'
        "</drake:proximity_properties></collision></link></robot>"
    )
    (tmp_path / "package.xml").write_text('<package format="2"><name>own</name></package>')
    scene = tmp_path / "ball.dmd.yaml"
    scene.write_text("directives:\n- add_model: {name: ball, file: package://own/ball.urdf}\n")

    station = build_station(load_station(scene))

    inspector = station.ports.plant.scene_graph.model_inspector()
    body = station.ports.plant.free_pieces["ball"]
    shapes = station.ports.plant.shapes_of_body(body)
    properties = [inspector.GetProximityProperties(shape) for shape in shapes]
    stiffness = [each.GetProperty("material", "point_contact_stiffness") for each in properties]
    friction = [each.GetProperty("material", "coulomb_friction") for each in properties]
    assert stiffness == [pytest.approx(30000.0)]
    assert (friction[0].static_friction(), friction[0].dynamic_friction()) == (0.6, 0.5)
