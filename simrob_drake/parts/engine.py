"""Engines: what moves a station, and what it can do.

A station moves along its reference (``mode: kinematic``), or forces move it (``mode: dynamic``). In the second case
its section ``solver`` names an integrator of Drake, a discrete solver of Drake, or an engine of an extension. Other
modules compare no name of a mode, a scheme or a solver: they read a property of :class:`Engine`.
"""

from dataclasses import dataclass
from typing import Any, Protocol

from pydrake.multibody.tree import ModelInstanceIndex
from pydrake.systems.framework import Context, InputPort, OutputPort

from simrob_drake.base.frames import Vector


@dataclass(frozen=True, kw_only=True)
class Engine:
    """Properties of the engine that moves a station. The defaults are those of Drake's implicit integrators.

    Attributes:
        name: name for messages, such as ``radau3``; empty for a kinematic station.
        moves_by_forces: whether forces and torques move the station, so that it has servos, contact forces, inertias
            and free bodies. Otherwise the reference moves it, and torques are computed from the motion.
        time_step: length of the steps if all states are discrete [s]; 0 if time is continuous.
        has_fixed_steps: whether all steps have the same length.
        is_explicit: whether forces are evaluated at the start of a step, so that stiff ones limit its length.
        needs_plant_as_direct_child: whether Drake's plant must be a direct child of the root diagram.
        steps_drakes_plant: whether Drake's plant is stepped. Otherwise a block of the engine takes its place.
        holds_joint_limits: whether joints stop at their limits without springs in the diagram.
        holds_stiff_springs: whether a spring that is as stiff as a constraint leaves the steps long.
        constrains_gears: whether gears between axes are constraints.
        constrains_bodies: whether ball joints, welds, hinges and rods are constraints.
        constrains_many_axes: whether gears of more than two axes are held.
        constrains_in_plant: whether Drake's plant itself holds the constraints that are added to it.
        holds_inputs_over_steps: whether a step sees references and feedforward only as they are at its start.
        limits_torques_in_actuators: whether torques of servo blocks are limited by the plant's actuators.
        puts_friction_in_actuators: whether dry friction of joints is an actuator of Drake's plant.
        has_friction_of_joints: whether the engine computes dry friction of joints itself.
        actuator_torques_lack_friction: whether torques that the plant reports for its actuators lack dry friction.
        allows_dampers_of_motors: whether a motor's torque-speed line can be a damper of the joint.
        reports_forces_of_joints: whether reaction forces of joints can be measured.
        reports_friction_of_contacts: whether contact results contain correct friction forces.
        takes_any_contact_stiffness: whether contact springs may have any stiffness.
        softens_contacts: whether a contact is silently softened if it is stiff for the step.
        has_contact_dissipation: whether Hunt and Crossley's dissipation of contacts acts.
        has_static_friction: whether the coefficient of static friction acts; otherwise only the dynamic one does.
        has_realistic_grip: whether the friction of fingers holds as much as in reality.
        has_surface_contact: whether hydroelastic contact is possible.
        has_prescribed_joints: whether some joints can follow a given motion while forces move the others.
        has_forces_of_couplings: whether soft springs between bodies can be added to the plant.
        touches_at_several_points: whether the engine finds several contact points for two flat shapes.
        reports_torques_of_last_step: whether torques of servos inside of the actuators are those of the last step.
    """

    name: str
    moves_by_forces: bool = True
    time_step: float = 0.0
    has_fixed_steps: bool = False
    is_explicit: bool = False
    needs_plant_as_direct_child: bool = False
    steps_drakes_plant: bool = True
    holds_joint_limits: bool = False
    holds_stiff_springs: bool = False
    constrains_gears: bool = False
    constrains_bodies: bool = False
    constrains_many_axes: bool = True
    constrains_in_plant: bool = False
    holds_inputs_over_steps: bool = False
    limits_torques_in_actuators: bool = False
    puts_friction_in_actuators: bool = True
    has_friction_of_joints: bool = False
    actuator_torques_lack_friction: bool = False
    allows_dampers_of_motors: bool = True
    reports_forces_of_joints: bool = True
    reports_friction_of_contacts: bool = True
    takes_any_contact_stiffness: bool = False
    softens_contacts: bool = False
    has_contact_dissipation: bool = True
    has_static_friction: bool = True
    has_realistic_grip: bool = True
    has_surface_contact: bool = True
    has_prescribed_joints: bool = True
    has_forces_of_couplings: bool = True
    touches_at_several_points: bool = False
    reports_torques_of_last_step: bool = False

    @property
    def has_discrete_states(self) -> bool:
        """Whether all states of the plant are discrete: they change only at multiples of `time_step`."""
        # Drake's plant has the time step 0 if its time is continuous, too.
        return self.time_step > 0


KINEMATIC = Engine(name="", moves_by_forces=False)
"""Engine of a kinematic station: the reference moves the robots, and inverse dynamics gives the torques."""


class PlantBlock(Protocol):
    """A Drake system in place of Drake's plant in the diagram of a station, with the same ports and names.

    n is the number of positions of the plant (nq) plus that of its velocities (nv). The state of the block is that of
    the plant in Drake's order, so that recorded states are read in the same way.
    """

    outputs: dict[str, int]
    """Index of the discrete state that an output port hands on, by the port's name."""

    def get_name(self) -> str:
        """Name of the system, which is ``plant``."""

    def get_state_output_port(self) -> OutputPort:
        """Port of positions, then velocities, shape (n,)."""

    def get_body_poses_output_port(self) -> OutputPort:
        """Port of the poses of all bodies in the world, a list of RigidTransform by the index of the body."""

    def get_contact_results_output_port(self) -> OutputPort:
        """Port of the contacts, a :class:`simrob_drake.blocks.contacts.Contacts`."""

    def get_actuation_input_port(self, instance: ModelInstanceIndex) -> InputPort:
        """Port of the torques of a robot's m motors [N·m or N], shape (m,)."""

    def get_desired_state_input_port(self, instance: ModelInstanceIndex) -> InputPort:
        """Port of desired positions, then velocities, of a robot's m motors, shape (2 m,)."""

    def get_net_actuation_output_port(self, instance: ModelInstanceIndex) -> OutputPort:
        """Port of the torques that a robot's m motors gave [N·m or N], shape (m,)."""

    def get_applied_spatial_force_input_port(self) -> InputPort:
        """Port of a list of ExternallyAppliedSpatialForce."""

    def get_applied_generalized_force_input_port(self) -> InputPort:
        """Port of forces that act on the velocities of the plant, shape (nv,)."""

    def GetPositions(self, context: Context) -> Vector:
        """Positions (nq,) in a context of the block."""

    def GetVelocities(self, context: Context) -> Vector:
        """Velocities (nv,) in a context of the block."""

    def SetPositions(self, context: Context, q: Vector) -> None:
        """Set the positions (nq,) in a context of the block."""

    def SetVelocities(self, context: Context, v: Vector) -> None:
        """Set the velocities (nv,) in a context of the block."""

    def GetMyContextFromRoot(self, root: Context) -> Context:
        """Context of the block in the context of the whole diagram."""

    def GetMyMutableContextFromRoot(self, root: Context) -> Context:
        """Context of the block, which may be changed, in the context of the whole diagram."""


def missing_methods(block: Any) -> list[str]:
    """Names of the methods and the attribute of :class:`PlantBlock` that an object lacks. Empty if it has all."""
    # `outputs` is only annotated in the class, so it is not among its names, and is added below.
    required = [name for name in vars(PlantBlock) if not name.startswith("_")]
    return [name for name in (*required, "outputs") if not hasattr(block, name)]
