"""Force, distance and torque sensors alone, against what the contacts and shapes must give."""

from itertools import product

import numpy as np
import pytest
from pydrake.geometry import (
    AddCompliantHydroelasticProperties,
    AddContactMaterial,
    AddRigidHydroelasticProperties,
    Box,
    Capsule,
    Cylinder,
    Ellipsoid,
    HalfSpace,
    ProximityProperties,
    Sphere,
)
from pydrake.math import RigidTransform, RollPitchYaw, RotationMatrix
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph, ContactModel, CoulombFriction
from pydrake.multibody.tree import FixedOffsetFrame, RotationalInertia, SpatialInertia
from pydrake.systems.framework import DiagramBuilder

from simrob_drake import load_station, simulate
from simrob_drake.base.errors import InvalidParameter
from simrob_drake.blocks.contacts import ContactReader, Contacts, DistanceSensor, ForceSensor
from simrob_drake.blocks.momentum_observer import MomentumObserver
from simrob_drake.robots.axis_map import AxisMap
from simrob_drake.robots.outlines import lowest_points

STIFFNESS = 2000.0  # N/m, of a contact
DEPTH = 0.003  # m, of the cube's corner balls in the floor
CORNERS = np.array([[x, y, -0.1] for x in (-0.1, 0.1) for y in (-0.1, 0.1)])  # m
RADIUS = 0.01  # m
BODY_IN_WORLD = RigidTransform(np.array([0.3, -0.2, 0.1 + RADIUS - DEPTH]))


def surface(*, stiffness=2 * STIFFNESS, modulus=None, rigid=False):
    properties = ProximityProperties()
    AddContactMaterial(
        dissipation=0.0,
        point_stiffness=stiffness,
        friction=CoulombFriction(0.5, 0.5),
        properties=properties,
    )
    if rigid:
        AddRigidHydroelasticProperties(1.0, properties)
    elif modulus:
        AddCompliantHydroelasticProperties(0.1, modulus, properties)
    return properties


class Bench:
    """A body on the floor with a sensor; nothing is stepped."""

    def __init__(self, *, model=ContactModel.kPoint):
        self.builder = DiagramBuilder()
        self.plant, self.scene_graph = AddMultibodyPlantSceneGraph(self.builder, 0.0)
        self.plant.set_contact_model(model)
        inertia = SpatialInertia.MakeFromCentralInertia(
            1.0, np.zeros(3), RotationalInertia(0.01, 0.01, 0.01)
        )
        self.body = self.plant.AddRigidBody("body", inertia)
        floor = self.plant.world_body(), RigidTransform(), HalfSpace(), "floor", surface(rigid=True)
        self.floor = self.plant.RegisterCollisionGeometry(*floor)
        self.shapes = []

    def add(self, shape, place, **material):
        geometry = (
            self.body,
            RigidTransform(place),
            shape,
            f"shape_{len(self.shapes)}",
            surface(**material),
        )
        self.shapes.append(self.plant.RegisterCollisionGeometry(*geometry))

    def wrench(self, *, body, velocity=(0, 0, 0, 0, 0, 0), pose=BODY_IN_WORLD, **options):
        """Finalize, put the body in its place and return what a sensor tells: f, m."""
        self.plant.Finalize()
        if "frame" in options:
            options["frame"] = self.plant.GetFrameByName(options["frame"])
        sensor = self.builder.AddSystem(ForceSensor(plant=self.plant, body=body, **options))
        reader = self.builder.AddSystem(ContactReader())
        self.builder.Connect(self.plant.get_contact_results_output_port(), reader.get_input_port())
        self.builder.Connect(reader.get_output_port(), sensor.GetInputPort("contacts"))
        self.builder.Connect(
            self.plant.get_body_poses_output_port(), sensor.GetInputPort("body_poses")
        )
        diagram = self.builder.Build()
        context = diagram.CreateDefaultContext()
        own = self.plant.GetMyMutableContextFromRoot(context)
        self.plant.SetFreeBodyPose(own, self.body, pose)
        self.plant.SetVelocities(own, np.array(velocity, dtype=float))
        self.contacts = Contacts.of(self.plant.get_contact_results_output_port().Eval(own))
        return np.split(sensor.get_output_port().Eval(sensor.GetMyContextFromRoot(context)), 2)


@pytest.fixture
def cube():
    bench = Bench()
    for corner in CORNERS:
        bench.add(Sphere(RADIUS), corner)
    return bench


def test_the_forces_of_all_contacts_add_up(cube):
    force, moment = cube.wrench(body=cube.shapes)

    each = STIFFNESS * DEPTH
    np.testing.assert_allclose(force, [0, 0, 4 * each], atol=1e-9)
    np.testing.assert_allclose(moment, np.cross(BODY_IN_WORLD.translation(), force), atol=1e-9)


def test_a_part_feels_its_part_about_the_origin_of_its_frame(cube):
    force, moment = cube.wrench(body=cube.shapes[:1], frame="body")
    np.testing.assert_allclose(force, [0, 0, STIFFNESS * DEPTH], atol=1e-9)
    np.testing.assert_allclose(moment, np.cross(CORNERS[0], force), atol=1e-9)


def test_the_axes_are_those_of_the_frame(cube):
    turned = RigidTransform(RotationMatrix.MakeXRotation(np.pi / 2), np.array([0.1, 0.1, -0.1]))
    cube.plant.AddFrame(FixedOffsetFrame("hand", cube.body.body_frame(), turned))

    force, moment = cube.wrench(body=[cube.shapes[3]], frame="hand")

    # the world's z is the hand's y
    np.testing.assert_allclose(force, [0, STIFFNESS * DEPTH, 0], atol=1e-9)
    # its line goes through the hand's origin
    np.testing.assert_allclose(moment, np.zeros(3), atol=1e-9)


def test_action_is_reaction(cube):
    force, _ = cube.wrench(body=[cube.floor], other=cube.shapes[:2])
    np.testing.assert_allclose(force, [0, 0, -2 * STIFFNESS * DEPTH], atol=1e-9)


def test_normals_of_points_and_surfaces_push_the_first_shape_away_from_the_second(cube):
    block = Bench(model=ContactModel.kHydroelastic)
    block.add(Box(0.2, 0.2, 0.2), np.zeros(3), modulus=1e5)
    for bench, pose in (
        (cube, BODY_IN_WORLD),
        (block, RigidTransform(np.array([0.0, 0.0, 0.1 - DEPTH]))),
    ):
        bench.wrench(body=bench.shapes, pose=pose)

        # Upward if the first shape is the body's, downward if it is the floor.
        signs = bench.contacts.force_signs(bench.shapes)
        upward = signs[:, np.newaxis] * [0.0, 0.0, 1.0]
        np.testing.assert_allclose(bench.contacts.normals, upward, atol=1e-9)
        assert ((bench.contacts.forces * bench.contacts.normals).sum(axis=1) > 0.0).all()


def test_several_sensors_read_the_contacts_once(monkeypatch):
    read = []
    of = Contacts.of
    monkeypatch.setattr(Contacts, "of", lambda results: read.append(None) or of(results))
    sensors = {
        name: {"kind": "force", "body": "ball", "other": "floor"}
        for name in ("first", "second", "third")
    }

    result = simulate(load_station("bouncing_ball", {"sensors": sensors}), duration=0.3)

    assert len(read) == len(result.times)
    assert result.vector("force.first").max() > 0
    np.testing.assert_array_equal(result.vector("force.first"), result.vector("force.third"))


def test_what_is_asked_of_another_body_is_left_out(cube):
    force, _ = cube.wrench(body=cube.shapes[:2], other=cube.shapes[2:])
    np.testing.assert_array_equal(force, np.zeros(3))


@pytest.mark.parametrize(("normal_only", "across"), [(False, -0.5), (True, 0.0)])
def test_friction_is_part_of_it_unless_it_is_left_out(cube, normal_only, across):
    sliding = np.array([0, 0, 0, 0.2, 0, 0])  # m/s along x
    force, _ = cube.wrench(body=cube.shapes, velocity=sliding, normal_only=normal_only)
    np.testing.assert_allclose(force / (4 * STIFFNESS * DEPTH), [across, 0, 1], atol=1e-3)


@pytest.mark.parametrize("normal_only", [False, True])
def test_a_surface_is_felt_as_its_pressure_adds_up(normal_only):
    """A cube's pressure grows from its faces to its middle; over a cut at the depth x it sums up to a frustum."""
    bench = Bench(model=ContactModel.kHydroelastic)
    bench.add(Box(0.2, 0.2, 0.2), np.zeros(3), modulus=1e5)
    pose = RigidTransform(np.array([0.0, 0.0, 0.1 - DEPTH]))

    force, moment = bench.wrench(body=bench.shapes, pose=pose, normal_only=normal_only)

    # integral of (0.2 - 2 s)² from 0 to x
    frustum = 0.04 * DEPTH - 0.4 * DEPTH**2 + 4 / 3 * DEPTH**3
    np.testing.assert_allclose(force, [0, 0, 1e5 / 0.1 * frustum], rtol=1e-3, atol=1e-6)
    np.testing.assert_allclose(moment, np.zeros(3), atol=1e-6)


TILTED = RigidTransform(RollPitchYaw(0.7, -0.4, 1.1), np.array([0.2, 0.1, 0.5]))
NO_CORNERS = np.zeros((0, 3))
SHAPES = [
    Sphere(0.1),
    Box(0.1, 0.2, 0.3),
    Cylinder(0.1, 0.3),
    Capsule(0.1, 0.3),
    Ellipsoid(0.1, 0.2, 0.3),
]


def surface_points(shape):
    """Points all over a round shape, a degree apart, or the corners of a box, shape (m, 3) [m]."""
    polar_angles = np.linspace(0, np.pi, 181)
    azimuths = np.linspace(0, 2 * np.pi, 361)
    polar, azimuth = np.array(np.meshgrid(polar_angles, azimuths)).reshape(2, -1)
    around = np.column_stack([np.cos(azimuth), np.sin(azimuth)])
    on_unit_sphere = np.column_stack([np.sin(polar)[:, np.newaxis] * around, np.cos(polar)])
    match shape:
        case Sphere():
            return on_unit_sphere * shape.radius()
        case Ellipsoid():
            return on_unit_sphere * [shape.a(), shape.b(), shape.c()]
        case Capsule():
            # Two halves of a sphere, moved apart along z.
            sides = np.sign(on_unit_sphere[:, 2:])
            return on_unit_sphere * shape.radius() + sides * [0, 0, shape.length() / 2]
        case Cylinder():
            # The lowest point of a cylinder is on one of its rims.
            half_length = np.full(len(around), shape.length() / 2)
            rims = [
                np.column_stack([around * shape.radius(), side * half_length]) for side in (-1, 1)
            ]
            return np.vstack(rims)
        case _:
            return np.array([*product((-0.5, 0.5), repeat=3)]) * shape.size()


@pytest.mark.parametrize("shape", SHAPES, ids=lambda shape: type(shape).__name__)
def test_the_distance_to_the_floor_is_that_of_the_lowest_point(shape):
    """The lowest point of a tilted shape is as low as the lowest of many points of its surface."""
    points = surface_points(shape)
    corners = points if isinstance(shape, Box) else NO_CORNERS

    height = lowest_points(shape, TILTED, corners)[:, 2].min()

    assert height == pytest.approx((TILTED @ points.T)[2].min(), abs=1e-4)


def test_the_lowest_point_of_a_tilted_cylinder_is_exact():
    """The lowest point is r |u_xy| + l / 2 |u_z| below the centre, with the vertical u in the cylinder's frame."""
    radius = 0.1
    length = 0.3
    up = TILTED.rotation().matrix()[2]

    height = lowest_points(Cylinder(radius, length), TILTED, NO_CORNERS)[:, 2].min()

    exact = TILTED.translation()[2] - radius * np.hypot(up[0], up[1]) - length / 2 * abs(up[2])
    assert height == pytest.approx(exact, abs=1e-15)


def test_a_distance_is_measured_between_bodies_and_to_the_floor():
    bench = Bench()
    bench.add(Sphere(RADIUS), np.zeros(3))
    bench.add(Box(0.02, 0.02, 0.02), np.array([0.0, 0.0, 0.2]))
    post = (
        bench.plant.world_body(),
        RigidTransform(np.array([1.0, 0.0, 0.5])),
        Box(0.2, 0.2, 1.0),
        "post",
        surface(),
    )
    post = bench.plant.RegisterCollisionGeometry(*post)
    bench.plant.Finalize()
    inspector = bench.scene_graph.model_inspector()
    sensors = [
        bench.builder.AddSystem(DistanceSensor(body=body, other=[other], inspector=inspector))
        for body, other in ((bench.shapes, bench.floor), (bench.shapes[:1], post))
    ]
    for sensor in sensors:
        bench.builder.Connect(bench.scene_graph.get_query_output_port(), sensor.get_input_port())
    diagram = bench.builder.Build()
    context = diagram.CreateDefaultContext()
    pose = RigidTransform(np.array([0.5, 0.0, 0.3]))
    bench.plant.SetFreeBodyPose(bench.plant.GetMyMutableContextFromRoot(context), bench.body, pose)

    floor, gap = (
        sensor.get_output_port().Eval(sensor.GetMyContextFromRoot(context))[0] for sensor in sensors
    )

    assert floor == pytest.approx(0.3 - RADIUS)
    assert gap == pytest.approx(1.0 - 0.1 - 0.5 - RADIUS)


def test_shapes_of_one_body_have_no_distance():
    bench = Bench()
    for place in (np.zeros(3), np.array([0.5, 0, 0])):
        bench.add(Sphere(RADIUS), place)

    bench.plant.Finalize()

    with pytest.raises(
        InvalidParameter, match=r"collisions of .* are filtered out; name two other bodies"
    ):
        DistanceSensor(
            body=bench.shapes[:1],
            other=bench.shapes[1:],
            inspector=bench.scene_graph.model_inspector(),
        )


class TestMomentumObserver:
    def observer(self, add_pendulum, **options):
        builder = DiagramBuilder()
        plant = add_pendulum(builder)
        plant.Finalize()
        figures = {"gain": 20.0, "period": 0.005, **options}
        axes = AxisMap.of_joints(plant, [plant.GetJointByName("hinge")])
        return builder, MomentumObserver(plant=plant, axes=axes, **figures)

    def test_an_unknown_torque_is_found_with_the_lag_of_its_gain(self, add_pendulum):
        """A point of 1 kg on a rod of 0.5 m: I q'' = tau + x - m g l sin q, with x = 0.3 N·m from outside."""
        servo_torque = 0.7
        external_torque = 0.3
        length = 0.5
        inertia = length**2  # of 1 kg [kg m²]
        gain = 20.0
        period = 0.005
        steps_per_sample = 50
        step = period / steps_per_sample
        _builder, observer = self.observer(add_pendulum, gain=gain, period=period)

        memory = np.full(3, np.inf)  # no sample was taken yet
        angle = 0.4
        speed = -1.0
        estimates = []
        for _ in range(60):
            memory = observer.next_state(memory, np.array([angle, speed]), np.array([servo_torque]))
            estimates.append(memory[0])
            for _ in range(steps_per_sample):
                weight = 9.80665 * length * np.sin(angle)
                acceleration = (servo_torque + external_torque - weight) / inertia
                angle += step * (speed + step / 2 * acceleration)
                speed += step * acceleration

        expected = external_torque * (1 - np.exp(-gain * period * np.arange(60)))
        np.testing.assert_allclose(estimates, expected, atol=2e-3)

    @pytest.mark.parametrize("key", ["gain", "period"])
    def test_its_figures_are_positive(self, add_pendulum, key):
        with pytest.raises(InvalidParameter, match=f"^{key} is 0"):
            self.observer(add_pendulum, **{key: 0.0})
