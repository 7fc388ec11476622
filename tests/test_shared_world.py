"""Stations in a plant of the user's own: one alone, several in one world, and the errors of plants that do not suit."""

import pickle

import numpy as np
import pytest
from pydrake.geometry import Box
from pydrake.math import RigidTransform
from pydrake.multibody.plant import (
    AddMultibodyPlantSceneGraph,
    CoulombFriction,
    ExternallyAppliedSpatialForceMultiplexer,
    MultibodyPlant,
)
from pydrake.multibody.tree import PlanarJoint, SpatialInertia, UnitInertia
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantVectorSource

from simrob_drake import (
    PlacedStation,
    add_station,
    add_world,
    build_station,
    load_station,
    place_station,
    simulate,
    simulate_diagram,
)
from simrob_drake.base.errors import SimrobError

DISCRETE = {
    "solver": {"kind": "discrete", "time_step": 1e-3, "scheme": "lagged"},
    "servo.realization": "implicit",
}
WALL_STATION = {**DISCRETE, "contact": {"model": "point"}}


def hold(builder, ports, value=0.0):
    """Connect constant references to all robots of a station."""
    for name, port in ports.inputs.items():
        if name.endswith("reference"):
            source = builder.AddSystem(ConstantVectorSource(np.full(port.size(), value)))
            builder.Connect(source.get_output_port(), port)


def world_of(**stations):
    """Put stations into one plant, with references of zero. Returns the diagram, and the ports by name."""
    builder = DiagramBuilder()
    plant, scene_graph = add_world(builder, next(iter(stations.values())))
    placed = {
        name: place_station(plant, config, scene_graph=scene_graph, name=name)
        for name, config in stations.items()
    }
    plant.Finalize()
    ports = {name: each.wire(builder) for name, each in placed.items()}
    for own in ports.values():
        hold(builder, own)
    return builder.Build(), ports


def alone(config, duration):
    """Run a station by itself, with references of zero."""
    builder = DiagramBuilder()
    ports = add_station(builder, config)
    hold(builder, ports)
    return simulate_diagram(builder.Build(), ports, duration=duration, progress=False)


@pytest.mark.parametrize(
    ("station", "overrides"),
    [
        ("irb120_dynamic", {}),
        ("irb120_dynamic", DISCRETE),
        ("humanoid_dynamic", {}),
        ("box_on_floor", {}),
        ("double_pendulum", {}),
    ],
)
def test_a_station_in_a_plant_of_ones_own_moves_as_by_itself(station, overrides):
    config = load_station(station, overrides)
    expected = alone(config, 0.2)

    diagram, ports = world_of(**{"own": config})
    placed = simulate_diagram(diagram, ports["own"], duration=0.2, progress=False)
    assert placed.names == expected.names
    np.testing.assert_array_equal(placed.values, expected.values)
    assert placed.final_state.joints.keys() == expected.final_state.joints.keys()

    builder = DiagramBuilder()
    plant, scene_graph = add_world(builder, config)
    one_call = add_station(builder, config, plant=plant, scene_graph=scene_graph)
    assert plant.is_finalized()
    hold(builder, one_call)
    in_one_call = simulate_diagram(builder.Build(), one_call, duration=0.2, progress=False)
    np.testing.assert_array_equal(in_one_call.values, expected.values)


def test_an_arm_and_a_humanoid_share_a_world():
    arm = load_station("irb120_dynamic", {**WALL_STATION, "robot.base": [0, -1.5, 0, 0, 0, 0]})
    humanoid = load_station("humanoid_dynamic", {"solver": DISCRETE["solver"]})

    diagram, ports = world_of(man=humanoid, arm=arm)

    for name, config in (("man", humanoid), ("arm", arm)):
        together = simulate_diagram(diagram, ports[name], duration=0.2, progress=False)
        by_itself = alone(config, 0.2)
        assert together.names == by_itself.names
        # The solver of contacts stops at a tolerance that is relative to the momentum of all bodies together.
        np.testing.assert_allclose(together.values, by_itself.values, atol=1e-4)
        assert together.final_state.joints.keys() == by_itself.final_state.joints.keys()
        assert (
            simulate(config, start=together.final_state, duration=0.01, progress=False).ending
            == "completed"
        )


def test_stops_and_forces_of_two_stations_act_on_their_own_joints():
    """With a continuous scheme both stations feed the plant's only port of generalized forces."""
    first = load_station(
        "irb120_dynamic", {"servo.kp": 0, "servo.kd": 0.1, "robot.initial_deg": {"joint_3": 60}}
    )
    second = load_station("irb120_dynamic", {"robot.base": [0, 1.5, 0, 0, 0, 0]})
    diagram, ports = world_of(limp=first, stiff=second)
    result = simulate_diagram(diagram, ports["limp"], duration=0.6, progress=False)

    by_itself = alone(first, 0.6)

    # Joint 3 falls onto its upper stop of 70 degrees. The step length differs, since both arms share it.
    highest = np.rad2deg(result["q.joint_3"].max())
    assert highest == pytest.approx(np.rad2deg(by_itself["q.joint_3"].max()), abs=0.05)
    assert 69 < highest < 71
    np.testing.assert_allclose(result.axes("q")[-1], by_itself.axes("q")[-1], atol=5e-3)


@pytest.mark.parametrize("distance", [0.5, 2.0])
def test_two_arms_in_one_world_collide(distance):
    """The right arm turns towards the left one: within reach it is stopped by it, and pushes it away."""
    right = load_station("irb120_dynamic", WALL_STATION)
    left = load_station("irb120_dynamic", {**WALL_STATION, "robot.base": [0, distance, 0, 0, 0, 0]})
    builder = DiagramBuilder()
    plant, scene_graph = add_world(builder, right)
    placed = [
        place_station(plant, config, scene_graph=scene_graph, name=name)
        for name, config in (("right", right), ("left", left))
    ]
    plant.Finalize()
    ports = [each.wire(builder) for each in placed]
    for own, angle in zip(ports, (1.5, 0.0), strict=True):
        source = builder.AddSystem(ConstantVectorSource(angle * np.eye(6)[0]))
        builder.Connect(source.get_output_port(), own.inputs["reference"])
    diagram = builder.Build()

    results = [simulate_diagram(diagram, own, duration=0.5, progress=False) for own in ports]

    reached = results[0]["q.joint_1"][-1]
    moved = np.abs(results[1]["q.joint_1"]).max()
    if distance == 0.5:
        assert reached < 1.4
        assert moved > 0.01
    else:
        assert reached > 1.45
        assert moved < 5e-3


def test_contact_sensors_and_floor_are_those_of_the_world():
    """Two boxes on one floor: each is carried once, and each sensor measures its own box."""
    contact = {"model": "point", "stiffness": 1e5, "dissipation": 10.0}
    light = load_station("box_on_floor", {"contact": contact})
    heavy = load_station(
        "box_on_floor", {"contact": contact, "pieces.box.pose": [1, 0, 0.1, 0, 0, 0]}
    )

    diagram, ports = world_of(left=light, right=heavy)

    for own in ports.values():
        result = simulate_diagram(diagram, own, duration=0.5, progress=False)
        assert result["force.floor.z"][-1] == pytest.approx(2.0 * 9.80665, rel=1e-2)
    height = {name: ports[name].outputs["piece_pose.box"] for name in ports}
    assert set(height) == {"left", "right"}


def test_a_wall_of_ones_own_stops_the_arm():
    """What prefinalize adds belongs to the world: the arm turns against the wall and stays there."""
    config = load_station("irb120_dynamic", {**WALL_STATION, "pieces": {}})

    def add_wall(parser):
        plant = parser.plant()
        pose = RigidTransform([0.25, 0.25, 0.5])
        plant.RegisterCollisionGeometry(
            plant.world_body(), pose, Box(0.5, 0.02, 1.0), "wall", CoulombFriction(0.5, 0.5)
        )

    ends = {}
    for name, hook in (("free", None), ("wall", add_wall)):
        station = build_station(config, prefinalize=hook)
        builder = DiagramBuilder()
        box = builder.AddNamedSystem("box", station)
        turned = np.array([1.5, 1.2, 0, 0, 0, 0])
        source = builder.AddSystem(ConstantVectorSource(turned))
        builder.Connect(source.get_output_port(), box.GetInputPort("reference"))
        ends[name] = simulate_diagram(builder.Build(), box.ports, duration=0.6, progress=False)[
            "q.joint_1"
        ][-1]
    assert ends["free"] > 1.3
    assert ends["wall"] < 1.0


def test_hooks_are_called_in_order():
    calls = []
    station = build_station(
        load_station("irb120_dynamic"),
        parser_preload=lambda parser: calls.append(
            ("preload", parser.plant().num_model_instances())
        ),
        prefinalize=lambda parser: calls.append(
            ("prefinalize", parser.plant().num_model_instances())
        ),
        prebuild=lambda builder: calls.append(("prebuild", builder.HasSubsystemNamed("plant"))),
    )

    empty = MultibodyPlant(0.0).num_model_instances()

    assert calls == [("preload", empty), ("prefinalize", empty + 1), ("prebuild", True)]
    assert station.ports.plant.plant.is_finalized()


def test_a_body_of_ones_own_has_no_stops_of_the_station():
    """A slider of the user's own moves beyond its limits under a continuous scheme: it is none of the station's."""
    builder = DiagramBuilder()
    config = load_station("irb120_dynamic")
    plant, scene_graph = add_world(builder, config)
    inertia = SpatialInertia(1.0, np.zeros(3), UnitInertia.SolidBox(0.1, 0.1, 0.1))
    slider = plant.AddRigidBody("puck", plant.AddModelInstance("puck"), inertia)
    plant.AddJoint(PlanarJoint("slide", plant.world_frame(), slider.body_frame(), [0, 0, 0]))

    placed = place_station(plant, config, scene_graph=scene_graph)

    assert isinstance(placed, PlacedStation)
    assert list(placed.robots) == ["robot"]

    plant.Finalize()
    ports = placed.wire(builder)
    hold(builder, ports)

    joints = [joint.name() for joint in ports.plant.joints if joint.num_velocities()]

    assert joints == [f"joint_{number}" for number in range(1, 7)]

    result = simulate_diagram(builder.Build(), ports, duration=0.1, progress=False)
    expected = alone(config, 0.1)

    np.testing.assert_allclose(result.values, expected.values, atol=1e-6)


def test_forces_of_ones_own_are_kept():
    """A port that the user feeds is fed by both afterwards."""
    push = {
        "shove": {"kind": "push", "at": "tool0", "start": 0.0, "duration": 1.0, "force": [0, 0, 10]}
    }
    config = load_station("irb120_dynamic", {**DISCRETE, "pieces": {}, "forces": push})
    builder = DiagramBuilder()
    plant, scene_graph = add_world(builder, config)
    placed = place_station(plant, config, scene_graph=scene_graph)
    plant.Finalize()
    nothing = builder.AddSystem(ExternallyAppliedSpatialForceMultiplexer(0))
    builder.Connect(nothing.get_output_port(), plant.get_applied_spatial_force_input_port())
    ports = placed.wire(builder)
    hold(builder, ports)

    result = simulate_diagram(builder.Build(), ports, duration=0.1, progress=False)

    np.testing.assert_array_equal(result.values, alone(config, 0.1).values)


def test_a_result_is_pickled_as_that_of_the_station_alone():
    humanoid = load_station("humanoid_dynamic", {"solver": DISCRETE["solver"]})
    arm = load_station("irb120_dynamic", {**WALL_STATION, "robot.base": [0, -1.5, 0, 0, 0, 0]})
    diagram, ports = world_of(man=humanoid, arm=arm)

    result = simulate_diagram(diagram, ports["arm"], duration=0.1, progress=False)

    assert result.positions_at(result.times[-1:]).shape == (
        1,
        ports["arm"].plant.plant.num_positions(),
    )

    read = pickle.loads(pickle.dumps(result))
    np.testing.assert_allclose(read.positions_at(read.times), result.axes("q"), atol=1e-15)


@pytest.mark.long
def test_a_result_is_saved_with_a_recording(tmp_path):
    arm = load_station("irb120_dynamic", {"robot.base": [0, -1.5, 0, 0, 0, 0]})
    diagram, ports = world_of(other=load_station("irb120_dynamic"), arm=arm)

    result = simulate_diagram(diagram, ports["arm"], duration=0.1, progress=False)

    assert (result.save(tmp_path / "run") / "recording.html").stat().st_size > 10_000


def test_cenic_with_a_plant_of_another_name():
    config = load_station("humanoid_dynamic")
    builder = DiagramBuilder()
    plant, _ = add_world(builder, config)
    ports = add_station(builder, config, plant=plant)
    hold(builder, ports)

    plant.set_name("world")

    with pytest.raises(
        SimrobError,
        match=r"needs a single plant in the simulated diagram, named plant.*the diagram has: world",
    ):
        simulate_diagram(builder.Build(), ports, duration=0.1, progress=False)


class TestErrors:
    """Each error is one line that says what would be right."""

    config = load_station("irb120_dynamic")

    def world(self):
        builder = DiagramBuilder()
        return builder, *add_world(builder, self.config)

    def refused(self, match):
        return pytest.raises(SimrobError, match=match)

    def test_the_plant_is_finalized(self):
        builder, plant, scene_graph = self.world()
        plant.Finalize()
        with self.refused("the plant is finalized already.*call plant.Finalize\\(\\) after"):
            place_station(plant, self.config, scene_graph=scene_graph)

        with self.refused("the plant is finalized already"):
            add_station(builder, self.config, plant=plant)

    def test_the_plant_is_not_finalized(self):
        builder, plant, scene_graph = self.world()
        placed = place_station(plant, self.config, scene_graph=scene_graph)
        with self.refused("not finalized; call plant.Finalize\\(\\) before wire"):
            placed.wire(builder)

    def test_the_scene_graph_of_another_builder(self):
        _, plant, _ = self.world()
        _, _, other = self.world()
        with self.refused("not registered with this scene graph"):
            place_station(plant, self.config, scene_graph=other)

    def test_the_builder_of_another_plant(self):
        _, plant, scene_graph = self.world()
        placed = place_station(plant, self.config, scene_graph=scene_graph)
        plant.Finalize()
        with self.refused("MultibodyPlant is not in this builder"):
            placed.wire(DiagramBuilder())

        with self.refused("no scene graph of the plant"):
            add_station(DiagramBuilder(), self.config, plant=MultibodyPlant(0.0))

    def test_names_that_clash(self):
        builder, plant, scene_graph = self.world()
        place_station(plant, self.config, scene_graph=scene_graph, name="arm")
        with self.refused("already has a station named 'arm'.*name=\"arm_2\""):
            place_station(plant, self.config, scene_graph=scene_graph, name="arm")

        with self.refused("already has systems named plant, scene_graph"):
            add_world(builder, self.config)

    def test_wired_twice(self):
        builder, plant, scene_graph = self.world()
        placed = place_station(plant, self.config, scene_graph=scene_graph)
        plant.Finalize()
        placed.wire(builder)

        with self.refused("wired already"):
            placed.wire(builder)

    @pytest.mark.parametrize(
        ("overrides", "match"),
        [
            ({"gravity": 1.62}, r"gravity of the plant is .*set_gravity_vector\(\[0, 0, -1.62\]\)"),
            (DISCRETE, r"time step of the plant is 0 s.*time_step=0.001"),
            (
                {"contact": {"model": "hydroelastic"}},
                r"contact model of the plant is kPoint.*kHydroelastic",
            ),
            ({"mode": "kinematic", "servo": None, "solver": None}, "it is kinematic"),
        ],
    )
    def test_another_world(self, overrides, match):
        _, plant, scene_graph = self.world()
        name = "irb120_kinematic" if "mode" in overrides else "irb120_dynamic"
        other = load_station(name, {} if "mode" in overrides else overrides)

        with self.refused(match):
            place_station(plant, other, scene_graph=scene_graph)

    def test_another_solver(self):
        _, plant, scene_graph = self.world()
        place_station(plant, self.config, scene_graph=scene_graph)
        other = load_station("irb120_dynamic", {"solver.scheme": "runge_kutta3"})

        with self.refused("solver of irb120_dynamic differs from that of irb120_dynamic"):
            place_station(plant, other, scene_graph=scene_graph, name="other")

    def test_another_floor(self):
        _, plant, scene_graph = self.world()
        place_station(plant, self.config, scene_graph=scene_graph)
        other = load_station("irb120_dynamic", {"floor.incline_deg": 5})

        with self.refused("floor or contact of .* differs"):
            place_station(plant, other, scene_graph=scene_graph, name="other")

    def test_a_floor_of_ones_own(self):
        _, plant, scene_graph = self.world()
        plant.RegisterVisualGeometry(
            plant.world_body(), RigidTransform(), Box(1, 1, 0.1), "floor", np.ones(4)
        )
        with self.refused("already has a shape named floor"):
            place_station(plant, self.config, scene_graph=scene_graph)

    def test_drakes_defaults(self):
        """A plant as AddMultibodyPlantSceneGraph makes it has a gravity of 9.81; stations have 9.80665."""
        builder = DiagramBuilder()
        plant, scene_graph = AddMultibodyPlantSceneGraph(builder, 0.0)
        with self.refused(r"\[0, 0, -9.80665\]"):
            add_station(builder, self.config, plant=plant, scene_graph=scene_graph)

    def test_what_is_no_plant(self):
        with self.refused("plant is"):
            place_station("plant", self.config, scene_graph=None)
        with self.refused("scene_graph is"):
            place_station(MultibodyPlant(0.0), self.config, scene_graph=None)
