"""Give the shapes of a station's plant the surfaces of its configuration, and tell which ones its solver can hold."""

from collections.abc import Sequence
from itertools import combinations

import numpy as np
from pydrake.geometry import (
    AddCompliantHydroelasticProperties,
    Capsule,
    Cylinder,
    Ellipsoid,
    GeometryId,
    ProximityProperties,
    Role,
    RoleAssign,
    SceneGraph,
    SceneGraphInspector,
    Shape,
    Sphere,
)
from pydrake.multibody.plant import CoulombFriction, MultibodyPlant
from pydrake.multibody.tree import RigidBody
from pydrake.systems.framework import DiagramBuilder, OutputPort
from pydrake.systems.primitives import ConstantVectorSource, Saturation

from simrob_drake.blocks.block import fed, mapped, summed
from simrob_drake.errors import InvalidParameter
from simrob_drake.frames import Vector
from simrob_drake.parts.site import StationRobot
from simrob_drake.parts.targets import FLOOR, piece_of_shape
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.ports import StationPorts
from simrob_drake.stations.resolve import ResolvedStation
from simrob_drake.stations.solver_config import (
    ContactConfig,
    ContactMaterial,
    ContinuousSolver,
    DiscreteSolver,
    FixedSteps,
    SolverConfig,
)

_MOST_FACES = 20_000  # of round shapes, about: 33 000 of one ball take Drake 3 s, 131 000 take 12 s and 0.2 GB
_FINEST_STEP = 1e-5  # s
_STABLE = 2.5  # h ω of a third-order Runge-Kutta scheme on an undamped spring is below 1.7, on a damped one 2.5
_STEPS_A_CONTACT = 10
_SAP_FACTOR = 3.3
_SAP_RELAXATION = 0.1  # s, Drake's default

MODULUS = 1e7  # hydroelastic modulus [Pa] where none is given: stiff rubber


def needs_shapes(config: StationConfig) -> bool:
    """Tell whether a station's plant needs collision shapes: for contact, or for the distances of a kinematic one."""
    measured = any(sensor.kind == "distance" for sensor in config.sensors.values())
    return config.contact is not None or (config.mode == "kinematic" and measured)


def apply_materials(plant: MultibodyPlant, scene_graph: SceneGraph, station: ResolvedStation) -> None:
    """Write stiffness, dissipation, friction and modulus into the shapes of a plant.

    The plant is not finalized yet: a shape whose surface is written anew loses its collision filters, and finalizing
    makes those between neighbours. Raises InvalidParameter: a resolution that is too fine.
    """
    config, contact = station.config, station.config.contact
    if contact is None:
        return
    plant.set_stiction_tolerance(contact.stiction_speed)
    source = plant.get_source_id()
    assert source is not None  # add_plant registers the plant
    inspector = scene_graph.model_inspector()
    shapes = inspector.GetAllGeometryIds(Role.kProximity)
    if contact.model != "point":
        _check_resolution(contact.resolution, [inspector.GetShape(shape) for shape in shapes])
    for shape in shapes:
        piece = piece_of_shape(station, inspector, shape)
        own, material = config.pieces[piece].contact if piece else None, _material(config, contact, piece)
        if inspector.GetName(shape).startswith(f"{FLOOR}."):  # what is soft of a terrain says so itself
            material = material.model_copy(update={"hydroelastic_modulus": None})
        properties = ProximityProperties(inspector.GetProximityProperties(shape))
        if own is not None and own.model == "point" and contact.model == "hydroelastic":
            expected = "hydroelastic_with_fallback, as a piece meets others at points"
            raise InvalidParameter("contact.model", contact.model, expected)
        _write(properties, material, contact, at_points=own is not None and own.model == "point")
        scene_graph.AssignRole(source, shape, properties, RoleAssign.kReplace)


def _check_resolution(resolution: float, shapes: Sequence[Shape]) -> None:
    """Check that edges of a length [m] do not divide round shapes into more faces than a computer can hold.

    Drake divides the surfaces of balls, ellipsoids and capsules, and the rims of cylinders; others it leaves whole.
    """
    surfaces = rims = 0.0
    for shape in shapes:
        if isinstance(shape, Cylinder):
            rims += 2 * np.pi * shape.radius()
        elif isinstance(shape, (Sphere, Capsule)):
            length = shape.length() if isinstance(shape, Capsule) else 0.0
            surfaces += 2 * np.pi * shape.radius() * (2 * shape.radius() + length)
        elif isinstance(shape, Ellipsoid):
            surfaces += 4 * np.pi * max(shape.a(), shape.b(), shape.c()) ** 2
    finest = np.sqrt(surfaces / _MOST_FACES) + rims / _MOST_FACES
    if resolution < finest:
        expected = f"{finest:.2g} m or more: finer ones give the shapes of this station too many faces"
        raise InvalidParameter("contact.resolution", f"{resolution:g} m", expected)


def check_stiffnesses(plant: MultibodyPlant, scene_graph: SceneGraph, station: ResolvedStation) -> None:
    """Check that a solver can hold a station's contacts; raises InvalidParameter: with the largest stiffness it can."""
    config = station.config
    if config.contact is None or config.mode == "kinematic":
        return
    inspector = scene_graph.model_inspector()
    for shape in inspector.GetAllGeometryIds(Role.kProximity):
        body = plant.GetBodyFromFrameId(inspector.GetFrameId(shape))
        stiffness = _material(config, config.contact, piece_of_shape(station, inspector, shape)).stiffness
        if stiffness is not None and not plant.IsAnchored(body):
            _check_stiffness(config.solver, body, stiffness)


def pairs_without_surface(plant: MultibodyPlant, inspector: SceneGraphInspector) -> list[str]:
    """Return the pairs of bodies that cannot meet in a hydroelastic surface, since both are rigid."""
    rigid = [shape for shape in inspector.GetAllGeometryIds(Role.kProximity) if _is_rigid(inspector, shape)]
    pairs = set()
    for first, second in combinations(rigid, 2):
        bodies = [plant.GetBodyFromFrameId(inspector.GetFrameId(shape)) for shape in (first, second)]
        if not (inspector.CollisionFiltered(first, second) or all(plant.IsAnchored(body) for body in bodies)):
            pairs.add(" and ".join(sorted(body.scoped_name().get_full() for body in bodies)))
    return sorted(pairs)


def _is_rigid(inspector: SceneGraphInspector, shape: GeometryId) -> bool:
    properties = inspector.GetProximityProperties(shape)
    hydroelastic = properties.HasGroup("hydroelastic") and properties.HasProperty("hydroelastic", "compliance_type")
    return hydroelastic and not properties.HasProperty("hydroelastic", "hydroelastic_modulus")


def _material(config: StationConfig, contact: ContactConfig, piece: str | None) -> ContactMaterial:
    """Return the station's figures, those of the piece in their place."""
    own = config.pieces[piece].contact if piece else None
    stated = {} if own is None else own.model_dump(exclude_none=True, exclude={"model"})
    shared = contact.model_dump(include=set(ContactMaterial.model_fields), exclude_none=True)
    return ContactMaterial.model_validate({**shared, **stated})


def _write(
    properties: ProximityProperties, material: ContactMaterial, contact: ContactConfig, *, at_points: bool
) -> None:
    if material.stiffness is not None:
        properties.UpdateProperty("material", "point_contact_stiffness", 2 * material.stiffness)
    if material.dissipation is not None:
        properties.UpdateProperty("material", "hunt_crossley_dissipation", material.dissipation)
    if material.friction is not None:
        friction = CoulombFriction(material.friction.static, material.friction.dynamic)
        properties.UpdateProperty("material", "coulomb_friction", friction)
    known = properties.HasGroup("hydroelastic") and properties.HasProperty("hydroelastic", "compliance_type")
    if contact.model == "point" or at_points:
        return
    if not known:
        AddCompliantHydroelasticProperties(contact.resolution, material.hydroelastic_modulus or MODULUS, properties)
    elif material.hydroelastic_modulus is not None and properties.HasProperty("hydroelastic", "hydroelastic_modulus"):
        properties.UpdateProperty("hydroelastic", "hydroelastic_modulus", material.hydroelastic_modulus)


def largest_stiffness(solver: SolverConfig, mass: float) -> float:
    r"""Return the stiffest contact [N/m] of a body of ``mass`` [kg] that a solver can hold; inf if any.

    * Error-controlled schemes follow any spring with steps that are short enough, :math:`h = 2.5 \sqrt{m/k}` for
      explicit ones at rest. Steps shorter than 10 µs are not worth waiting for, so :math:`k \le m\,(2.5/h)^2`.
    * Schemes of fixed steps need ten of them for a contact, which lasts :math:`\pi\sqrt{m/k}`.
    * ``sap`` never lets a contact be stiffer than :math:`k = 4\pi^2 m / (3.3\,h\,(h + 0.1\,\mathrm{s}))`, whatever it
      is told (measured within 5 % on a ball at rest, for steps of 1 and 5 ms): it would soften a stiffer one silently.
    * ``lagged``, ``similar``, ``cenic`` and MuJoCo treat the spring implicitly and hold any.
    """
    if isinstance(solver, DiscreteSolver):
        step = solver.time_step
        softened = 4 * np.pi**2 * mass / (_SAP_FACTOR * step * (step + _SAP_RELAXATION))
        return float(softened) if solver.scheme == "sap" else np.inf
    if not isinstance(solver, ContinuousSolver) or solver.scheme == "cenic":
        return np.inf
    if solver.fixed_steps:
        return float(mass * (np.pi / (_STEPS_A_CONTACT * solver.max_step)) ** 2)
    return mass * (_STABLE / _FINEST_STEP) ** 2


def _check_stiffness(solver: SolverConfig, body: RigidBody, stiffness: float) -> None:
    largest = largest_stiffness(solver, body.default_mass())
    if stiffness > largest:
        step = f"steps of {solver.time_step:g} s" if isinstance(solver, FixedSteps) else solver.kind
        allowed = f"at most {largest:.3g} N/m for {body.name()} ({body.default_mass():.3g} kg) with the solver"
        raise InvalidParameter("contact.stiffness", stiffness, f"{allowed} {solver.scheme}, {step}")


def wire_friction(builder: DiagramBuilder, ports: StationPorts) -> None:
    """Let the actuators that stand for friction want their joints to rest; under ``cenic`` add blocks in their place.

    Actuators of ``cenic`` hold one torque a joint, the motor's. It linearises other forces at the start of a step h,
    and friction that turns a joint's motion around within a step would do so for ever: there v_s is at least c h / M,
    M being the inertia that the axis feels alone.
    """
    config, plant = ports.config, ports.plant.plant
    for robot in ports.plant.robots.values():
        friction = robot.model.friction
        if not friction.any() or ports.plant.engine is not None:  # which has friction of its own
            continue
        if isinstance(config.solver, ContinuousSolver) and config.solver.scheme == "cenic":
            speed = np.maximum(
                robot.model.drives.friction_speed, friction * config.solver.max_step / robot.free_inertias()
            )
            sliding = _sliding(builder, ports, robot, speed)
            spread = -robot.axis_map.velocity_matrix.T
            ports.generalized_forces.append(mapped(builder, f"{robot.prefix}friction.force", spread, sliding))
        elif config.servo_of(robot.name).realization != "implicit":
            rest = plant.get_desired_state_input_port(robot.instance)
            builder.Connect(fed(builder, f"{robot.prefix}rest", ConstantVectorSource(np.zeros(rest.size()))), rest)
            ports.draw_nothing(f"{robot.prefix}rest")


def with_friction(
    builder: DiagramBuilder,
    ports: StationPorts,
    robot: StationRobot,
    torque: OutputPort,
    *,
    axes: Sequence[int] | None = None,
) -> OutputPort:
    """Add the torques that overcome Coulomb friction to the torques of a robot's motors.

    Args:
        builder: builder of the station's diagram, to which blocks are added.
        ports: ports of the station; its plant's state drives the friction.
        robot: the robot.
        torque: output port with torques (n,) [N·m or N], which lack friction.
        axes: indices of the axes whose torques lack friction; None stands for all axes.

    Returns:
        output port with the sum, shape (n,) [N·m or N]; the given port if none of these axes has friction.
    """
    count = len(robot.axes)
    is_added = np.ones(count)
    if axes is not None:
        is_added = np.zeros(count)
        is_added[list(axes)] = 1.0
    if not (is_added * robot.model.friction).any():
        return torque
    speeds = np.full(count, robot.model.drives.friction_speed)
    friction = _sliding(builder, ports, robot, speeds)
    if not is_added.all():
        # A diagonal matrix of ones and zeros drops the friction of the other axes.
        friction = mapped(builder, f"{robot.prefix}friction.counted", np.diag(is_added), friction)
    return summed(builder, f"{robot.prefix}friction.torque", torque, friction)


def _sliding(builder: DiagramBuilder, ports: StationPorts, robot: StationRobot, speed: Vector) -> OutputPort:
    """Add a block for the Coulomb friction of a robot's axes: c sat(v / v_s), of the plant's state.

    Here c are the friction torques of the robot's model, v the speeds of its axes, and sat limits to -1 and 1.

    Args:
        builder: builder of the station's diagram.
        ports: ports of the station.
        robot: the robot.
        speed: speeds v_s above which friction is constant, shape (n,) [rad/s or m/s].

    Returns:
        output port with torques in the direction of the motion, shape (n,) [N·m or N].
    """
    name = f"{robot.prefix}friction"
    friction = robot.model.friction
    ports.draw(name, "force", f"Friction\nof {robot.model.name}", robot)
    # The lower half of the state matrix gives the speeds of the axes.
    speeds_of_state = robot.axis_map.state_matrix[len(friction) :]
    slope = (friction / speed)[:, np.newaxis] * speeds_of_state
    unlimited = mapped(builder, f"{name}.slope", slope, ports.state)
    return fed(builder, name, Saturation(-friction, friction), unlimited)
