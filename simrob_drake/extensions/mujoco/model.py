r"""A station as a MuJoCo model, made from its own plant: robots, pieces, floor, contacts, servos, forces, sensors.

How hard things touch: Drake's figures of contact, joint stops and dry friction in those of MuJoCo.

MuJoCo has no springs. It gives a contact pressed in by x the force

.. math:: f = \frac{k\,x + b\,\dot x - a}{R}, \qquad R = \frac{1 - d}{d}\,w

where a is the acceleration that results along it, w the inverse mass that it takes for the pair (``invweight0`` of
the two bodies), d the impedance (``solimp``, here the same at any depth) and ``solref`` = (-k d, -b d). At rest that is
a spring: with :math:`k d = K (1 - d)\, w` it is K, whatever d is. What d adds is inertia, :math:`1/R`: the contact
swings with :math:`\omega^2 = K w (1 - d)`, as on a body heavier by d / (1 - d). So d should be small. The integrator
``discrete`` looks at x and its rate at the end of a step and takes any; the others look at its start and need
:math:`\omega h \le 1/2` for a step h, so

.. math:: 1 - d = \min\Bigl(1 - d_0,\; \frac{1}{4 h^2 K w}\Bigr).

``discrete`` takes for w what the pair feels in the posture while the servos hold, and R accordingly,

.. math:: R = \frac{(1 - d)\, w}{d + h\, b\, d + h^2 k\, d}:

so w is read off R where the station begins, and the stiffness is right there.

Damping is a ratio :math:`\zeta` of the critical one, :math:`b d = 2 \zeta \omega`. Hunt and Crossley's
law :math:`f = k x (1 + D \dot x)` of Drake has none, but takes, to first order in D, as much of an impact of a mass
1/w at speed v under its weight as that with

.. math:: \zeta = \tfrac12 D A \omega \Bigl(\sin\varphi + \frac{4 \cos^3\varphi}{3 (\pi + 2 \varphi + \sin 2 \varphi)}
    \Bigr), \qquad A \omega = \sqrt{v^2 + g^2/\omega^2}, \quad \tan\varphi = \frac{g}{v \omega}, \quad \omega^2 = K w:

while :math:`x = A (\sin\theta + \sin\varphi)` is positive, :math:`\int k x D \dot x^2 dt` is what the one takes and
:math:`2 \zeta \sqrt{k/w} \int \dot x^2 dt` the other. Without weight it is :math:`\zeta = 2 D v / (3 \pi)`; at rest
the law's own slope at the depth g/ω². A ratio above 1 counts as 1: nothing bounces.

Friction creeps in MuJoCo, too: it is :math:`b_t v / R_t` up to Coulomb's limit, with :math:`R_t` = R/``impratio``.
Here :math:`b_t d = d / h` and ``impratio`` = 1/d, so that a load f slides with about f w h: what it gains within a
step.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Literal

import mujoco
import numpy as np
from pydrake.geometry import DefaultProximityProperties, GeometryId, ProximityProperties
from pydrake.multibody.plant import CalcContactFrictionFromSurfaceProperties, CoulombFriction

from simrob_drake.base.errors import InvalidParameter
from simrob_drake.base.messages import message
from simrob_drake.extensions.mujoco.coordinates import Coordinates, Names
from simrob_drake.extensions.mujoco.drives import (
    OutputSensors,
    add_force,
    add_motors,
    add_sensors,
    add_servos,
)
from simrob_drake.extensions.mujoco.tree import add_gears, add_shapes, add_tree, touching_pairs
from simrob_drake.parts.forces import place_of
from simrob_drake.parts.station_plant import StationPlant
from simrob_drake.stations.dynamic import stops_of
from simrob_drake.stations.resolve import ResolvedStation

LEAST_IMPEDANCE = 1e-4
"""d_0: MuJoCo knows no smaller one; a contact has then a ten-thousandth of the inertia of what touches."""
LARGEST_IMPEDANCE = 0.9999
FOOT_SPEED = 0.1  # at which feet and tools come down, and so the v of damping where nothing falls from higher [m/s]
_STEPS_A_SWING = 2.0
_TINY = 1e-12


@dataclass(frozen=True)
class TouchingPair:
    """What two surfaces are together: stiffness [N/m], Hunt and Crossley's D [s/m], coefficient of friction."""

    stiffness: float
    dissipation: float
    friction: float


@dataclass(frozen=True)
class Softness:
    """MuJoCo's figures of a constraint: ``solref`` and the impedance of ``solimp``."""

    solref: tuple[float, float]
    impedance: float

    @property
    def solimp(self) -> list[float]:
        """The same impedance at any depth."""
        return [self.impedance, self.impedance, 1e-3, 0.5, 2.0]


def softness(stiffness: float, ratio: float, inverse_mass: float, step: float) -> Softness:
    """Return the figures of a spring K [N/m] damped by a ratio, for what has an inverse mass [1/kg].

    The step [s] is that of an integrator that looks at its start, and 0 for ``discrete``.
    """
    free = min(
        1 - LEAST_IMPEDANCE, 1 / max((_STEPS_A_SWING * step) ** 2 * stiffness * inverse_mass, _TINY)
    )
    impedance = float(np.clip(1 - free, LEAST_IMPEDANCE, LARGEST_IMPEDANCE))
    swing = stiffness * inverse_mass * (1 - impedance)
    return Softness((-swing, -2 * min(ratio, 1.0) * np.sqrt(swing)), impedance)


def inverse_mass(regularization: float, found: Softness, step: float) -> float:
    """Return the w that ``discrete`` takes [1/kg], of the R that it makes of a constraint's figures."""
    stiffness, damping = (-figure for figure in found.solref)
    part = found.impedance + step * damping + step**2 * stiffness
    return regularization * part / (1 - found.impedance)


def dry_friction(slope: float, inverse_inertia: float, step: float) -> Softness:
    """Return the figures of friction that grows with speed by a slope c / v_s [N·m·s/rad] until it reaches c.

    It is the law above without a spring, so b d = slope (1 - d) w; and it must not turn a speed around in a step:
    b d h is at most 1.
    """
    free = min(1 - LEAST_IMPEDANCE, 1 / max(slope * inverse_inertia * step, _TINY))
    impedance = max(1 - free, LEAST_IMPEDANCE)
    return Softness(
        (0.0, -slope * inverse_inertia * (1 - impedance)), min(impedance, LARGEST_IMPEDANCE)
    )


def ratio(surface: TouchingPair, inverse_mass: float, speed: float, gravity: float) -> float:
    """Return the damping ratio for Hunt and Crossley's D of a surface, as derived above.

    Something of an ``inverse_mass`` [1/kg] falls on it with a speed [m/s], positive, by a gravity [m/s²].
    """
    swing = np.sqrt(surface.stiffness * inverse_mass)
    angle = np.arctan2(gravity, speed * swing)
    part = np.sin(angle) + 4 * np.cos(angle) ** 3 / (3 * (np.pi + 2 * angle + np.sin(2 * angle)))
    return float(surface.dissipation * np.hypot(speed, gravity / swing) * part / 2)


def surfaces(station: StationPlant) -> list[tuple[GeometryId, GeometryId, TouchingPair]]:
    """Return the pairs of shapes that may touch, with what they are together in Drake."""
    inspector = station.scene_graph.model_inspector()
    usual = station.scene_graph.get_config().default_proximity_properties
    found = []
    for pair in touching_pairs(station):
        own = [inspector.GetProximityProperties(shape) for shape in pair]
        (k1, d1), (k2, d2) = (_stiffness_and_damping(properties, usual) for properties in own)
        rubs = [
            p.GetPropertyOrDefault("material", "coulomb_friction", CoulombFriction(1.0, 1.0))
            for p in own
        ]
        friction = CalcContactFrictionFromSurfaceProperties(*rubs).dynamic_friction()
        found.append(
            (*pair, TouchingPair(k1 * k2 / (k1 + k2), (k2 * d1 + k1 * d2) / (k1 + k2), friction))
        )
    return found


def _stiffness_and_damping(
    properties: ProximityProperties, usual: DefaultProximityProperties
) -> tuple[float, float]:
    own = properties.GetPropertyOrDefault
    stiffness: float = own("material", "point_contact_stiffness", usual.point_stiffness)
    dissipation: float = own(
        "material", "hunt_crossley_dissipation", usual.hunt_crossley_dissipation
    )
    return stiffness, dissipation


mujoco.set_mju_user_warning(lambda _: None)  # runs that go astray are told by their results

STEP = 2e-3  # length of MuJoCo's steps unless given [s]
_FAR = 10.0  # m
_STICK = 1.0  # how much harder friction is than the mass of what slides: more takes MuJoCo's solver twice as long


@dataclass(frozen=True)
class MujocoModel:
    """A station in MuJoCo."""

    spec: mujoco.MjSpec  # of the model, with the figures for its step
    model: mujoco.MjModel  # compiled
    # how the model's sensors give outputs of the station, by their names
    outputs: Mapping[str, OutputSensors]
    shapes: Mapping[str, GeometryId]  # of the plant, by the names of the model's geoms


Driver = Literal["controls", "diagram", "motion"]


def mujoco_model(
    station: ResolvedStation,
    plant: StationPlant,
    *,
    step: float = STEP,
    integrator: str | None = None,
    seen: bool = False,
    driver: Driver = "controls",
) -> MujocoModel:
    """Return a station as a MuJoCo model, of steps of a length [s], that stands where the station begins.

    Its integrator is ``discrete`` unless given, which treats servos and contacts in one implicit solve, and
    ``implicitfast`` where there are no servos, which takes nothing from what swings. ``seen`` adds the pictures of all
    bodies. The ``driver`` is what moves it: the model's own controls, servos and forces, with sensors to tell; a
    diagram, where the model has servos without limits alone; or a given motion, for inverse dynamics. Raises
    InvalidParameter: something that MJCF cannot say.
    """
    spec, names = mujoco.MjSpec(), Names(plant.plant)
    spec.modelname = station.config.name
    spec.compiler.degree = False
    _set_options(spec, plant, step, integrator or ("discrete" if plant.robots else "implicitfast"))
    add_tree(spec, plant, names)
    if driver != "motion":
        add_gears(spec, station, plant, names)
    shapes, outputs = add_shapes(spec, plant, names, seen=seen), dict[str, OutputSensors]()
    pairs = [] if driver == "motion" else surfaces(plant)
    _add_pairs(spec, shapes, pairs)
    if driver == "controls":
        for robot in plant.robots.values():
            add_servos(spec, robot, names)
        for name, force in station.config.forces.items():
            frame, point = place_of(plant, force.place_name(f"forces.{name}", station))
            add_force(spec, frame, point, name=f"force.{name}", names=names)
    elif driver == "diagram":
        add_motors(spec, plant.plant, names)
    if driver != "diagram":
        outputs = add_sensors(
            spec, station, plant, names, shapes, moved_by_torque=driver == "controls"
        )
    model = _compiled(spec)
    if driver != "motion":
        _soften(spec, model, station, plant, names, [surface for _, _, surface in pairs])
        model = spec.compile()
    return MujocoModel(spec, model, outputs, {name: shape for shape, name in shapes.items()})


def _compiled(spec: mujoco.MjSpec) -> mujoco.MjModel:
    try:
        return spec.compile()
    except ValueError as problem:
        why = " ".join(str(problem).split())
        raise InvalidParameter(
            "station",
            spec.modelname,
            message("mujoco.acceptable_model", "one that MuJoCo takes, which says: {why}", why=why),
        ) from problem


def _set_options(spec: mujoco.MjSpec, plant: StationPlant, step: float, integrator: str) -> None:
    option = spec.option
    option.gravity = plant.plant.gravity_field().gravity_vector()
    option.timestep = step
    option.integrator = getattr(mujoco.mjtIntegrator, f"mjINT_{integrator.upper()}")
    option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    # of walkers a quarter quicker, of arms as quick
    option.jacobian = mujoco.mjtJacobian.mjJAC_SPARSE
    off = mujoco.mjtDisableBit  # runs that go astray stay so, and contacts are as stiff as they are
    option.disableflags = sum(
        map(int, (off.mjDSBL_AUTORESET, off.mjDSBL_ISLAND, off.mjDSBL_REFSAFE))
    )


def _add_pairs(
    spec: mujoco.MjSpec,
    shapes: Mapping[GeometryId, str],
    pairs: list[tuple[GeometryId, GeometryId, TouchingPair]],
) -> None:
    for first, second, surface in pairs:
        rubs = surface.friction > 0
        spec.add_pair(
            geomname1=shapes[first],
            geomname2=shapes[second],
            condim=3 if rubs else 1,
            friction=[max(surface.friction, 1e-5)] * 2 + [0, 0, 0],
        )


def _soften(
    spec: mujoco.MjSpec,
    model: mujoco.MjModel,
    station: ResolvedStation,
    plant: StationPlant,
    names: Names,
    pairs: list[TouchingPair],
) -> None:
    """Give contacts, joint stops and dry friction their figures, which need the inertias of the compiled model."""
    step, data = spec.option.timestep, mujoco.MjData(model)
    ahead = 0.0 if spec.option.integrator == mujoco.mjtIntegrator.mjINT_DISCRETE else step
    mujoco.mj_kinematics(model, data)
    softnesses = list[Softness]()
    for pair, surface in zip(spec.pairs, pairs, strict=True):
        geoms = model.geom(pair.geomname1).id, model.geom(pair.geomname2).id
        weight = _inverse_mass(model, geoms)
        speed = max(FOOT_SPEED, _falling_speed(model, data, geoms))
        damping = ratio(surface, weight, speed, float(np.linalg.norm(model.opt.gravity)))
        softnesses.append(softness(surface.stiffness, damping, weight, ahead))
        pair.solref, pair.solimp = softnesses[-1].solref, softnesses[-1].solimp
        pair.solreffriction = [0.0, -softnesses[-1].impedance / step]
    spec.option.impratio = _STICK / min((found.impedance for found in softnesses), default=1.0)
    _soften_joints(spec, model, station, plant, names, ahead)
    if ahead == 0.0:
        _weigh_again(spec, plant, names, softnesses)


def _soften_joints(
    spec: mujoco.MjSpec,
    model: mujoco.MjModel,
    station: ResolvedStation,
    plant: StationPlant,
    names: Names,
    step: float,
) -> None:
    for robot in plant.robots.values():
        for joint, most in zip(robot.joints, robot.model.friction, strict=True):
            if most > 0:
                own, slope = (
                    spec.joint(names.joint(joint)),
                    most / robot.model.drives.friction_speed,
                )
                found = dry_friction(slope, _inverse_inertia(model, own.name), step)
                own.solref_friction, own.solimp_friction, own.frictionloss = (
                    found.solref,
                    found.solimp,
                    most,
                )
    stops = stops_of(station.config, plant)
    for joint in map(plant.plant.get_joint, plant.plant.GetJointIndices()):
        if joint.num_velocities() == 1:
            own = spec.joint(names.joint(joint))
            weight, (stiffness, damping) = (
                _inverse_inertia(model, own.name),
                stops[:, joint.velocity_start()].tolist(),
            )
            found = softness(stiffness, damping / 2 * np.sqrt(weight / stiffness), weight, step)
            own.solref_limit, own.solimp_limit = found.solref, found.solimp


def _weigh_again(
    spec: mujoco.MjSpec, plant: StationPlant, names: Names, softnesses: list[Softness]
) -> None:
    """Correct contacts by the inverse masses that ``discrete`` takes where the station begins."""
    model = spec.compile()
    model.pair_margin[:] = _FAR  # so that all touch
    data, context = mujoco.MjData(model), plant.plant.CreateDefaultContext()
    Coordinates.of(plant.plant, model, names).put(
        data, plant.plant.GetPositionsAndVelocities(context)
    )
    mujoco.mj_kinematics(model, data)
    mujoco.mj_transmission(model, data)
    servos = model.actuator_trntype == int(mujoco.mjtTrn.mjTRN_JOINT)  # the other ones are forces
    data.ctrl[servos] = data.actuator_length[servos]  # at their limits servos would not hold
    mujoco.mj_forward(model, data)
    # the model has them in another order
    found = {
        frozenset(model.geom(name).id for name in (pair.geomname1, pair.geomname2)): (pair, own)
        for pair, own in zip(spec.pairs, softnesses, strict=True)
    }
    for contact in data.contact:
        pair, own = found[frozenset(contact.geom.tolist())]
        if contact.efc_address >= 0:
            felt = inverse_mass(float(data.efc_R[contact.efc_address]), own, model.opt.timestep)
            pair.solref = np.array(own.solref) * felt / _inverse_mass(model, contact.geom)


def _inverse_mass(model: mujoco.MjModel, geoms: Iterable[int]) -> float:
    """Return the inverse mass that MuJoCo takes for the bodies of two shapes, in the posture of zero [1/kg]."""
    return float(sum(model.body_invweight0[model.geom_bodyid[geom], 0] for geom in geoms))


def _inverse_inertia(model: mujoco.MjModel, joint: str) -> float:
    return float(model.dof_invweight0[model.joint(joint).dofadr[0]])


def _falling_speed(model: mujoco.MjModel, data: mujoco.MjData, geoms: tuple[int, int]) -> float:
    """Return the speed of what falls freely through the gap between two shapes at the start; 0 for links of robots."""
    free = [model.body_dofnum[model.body_rootid[model.geom_bodyid[geom]]] == 6 for geom in geoms]
    if not any(free):
        return 0.0
    gap = mujoco.mj_geomDistance(model, data, *geoms, 100.0, None)
    return float(np.sqrt(2 * np.linalg.norm(model.opt.gravity) * max(gap, 0.0)))
