"""The actuators, limits, friction and constraints of MuJoCo at the joints of a robot."""

import re
import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from simrob_drake.base.messages import message
from simrob_drake.importer.loops import LoopCoupling
from simrob_drake.importer.trees import HOME, KD, KP, add_note
from simrob_drake.robots.imports import ImportReport
from simrob_drake.robots.urdf import DRAKE, add_motor, format_number, name_of

_FREE, _BALL = 0, 1  # mjtJoint
_IN_JOINT, _IN_PARENT, _TENDON = 0, 1, 3  # mjtTrn
_OF_JOINT = 1  # mjtWrap
_FIXED, _NONE, _AFFINE = 0, 0, 1  # mjtGain; mjtBias twice
_CONNECT, _WELD, _COUPLED = 0, 1, 2  # mjtEq
_ANCHOR_NUMBERS = 3  # count of numbers of a point in eq_data
_SITE = 6  # mjtObj
_POLYNOMIAL_NUMBERS = 5  # count of coefficients in eq_data of an equality of two joints
_DIGITS = 9  # decimals of positions that are written [m]
_HOME = "home"


class UrdfJoint(NamedTuple):
    """A joint as a URDF has it: its element, the joint of MuJoCo that it stands for, and which of its freedoms."""

    element: ET.Element
    joint: int
    part: int = 0


@dataclass
class _Drive:
    effort: float = 0.0
    kp: float = 0.0
    kd: float = 0.0


@dataclass
class DriveWriter:
    """Writes what drives, holds and couples the joints of one robot, given which bodies are links of it."""

    robot: ET.Element
    model: Any
    joints: Sequence[UrdfJoint]
    bodies: Mapping[int, ET.Element]
    report: ImportReport
    _drives: dict[int, _Drive] = field(default_factory=dict, init=False)

    def write(self) -> None:
        """Write limits, friction, motors, couplings and closed loops, and propose home and gains."""
        for actuator in range(len(self.model.actuator_trntype)):
            self._read_actuator(actuator)
        for joint in self.joints:
            self._write_joint(joint)
        if not self._drives:
            listed = "', '".join(name_of(joint.element) for joint in self.joints)
            self.report.add(
                "defaulted",
                message("mujoco.joints_called", "joints '{names}'", names=listed),
                message("mujoco.motor_for_each", "no actuator drives them; a motor made for each"),
            )
        self._propose_home()
        self._write_constraints()
        targets = zip(self.model.actuator_trntype, self.model.actuator_trnid, strict=True)
        pulled = {int(target[0]) for kind, target in targets if kind == _TENDON}
        for tendon in set(range(len(self.model.tendon_num))) - pulled:
            text = message(
                "mujoco.tendons_not_simulated",
                "tendons are not simulated: what it held or coupled moves freely",
            )
            self.report.add(
                "lost",
                message(
                    "mujoco.tendon_called", "tendon '{name}'", name=self.model.tendon_name[tendon]
                ),
                text,
            )

    @cached_property
    def _followers(self) -> set[int]:
        """Indices of the joints that follow another joint by an active equality."""
        model = self.model
        equalities = zip(model.eq_type, model.eq_active0, model.eq_obj1id, strict=True)
        return {
            int(joint) for kind, is_active, joint in equalities if kind == _COUPLED and is_active
        }

    def _read_actuator(self, actuator: int) -> None:
        model, where = (
            self.model,
            message(
                "mujoco.actuator_called",
                "actuator '{name}'",
                name=self.model.actuator_name[actuator],
            ),
        )
        levers = self._levers(actuator)
        if not levers:
            self.report.add(
                "lost",
                where,
                message(
                    "mujoco.drives_no_joint", "drives no joint; only motors of joints are simulated"
                ),
            )
            return
        if model.actuator_trntype[actuator] == _TENDON:
            listed = ", ".join(str(model.jnt_name[joint]) for joint in levers)
            self.report.add(
                "approximated",
                where,
                message(
                    "mujoco.pulls_at_several",
                    "pulls at several joints by a tendon; each gets a motor: {joints}",
                    joints=listed,
                ),
            )
        plain = model.actuator_gaintype[actuator] == _FIXED and model.actuator_biastype[
            actuator
        ] in (_NONE, _AFFINE)
        if model.actuator_dyntype[actuator] or not plain:
            text = message(
                "mujoco.own_force_law",
                "has a force of its own law, as muscles and filters have; a motor with its largest force",
            )
            self.report.add("approximated", where, text)
        gain, bias = model.actuator_gainprm[actuator], model.actuator_biasprm[actuator]
        if plain and not model.actuator_dyntype[actuator] and not gain.any() and not bias.any():
            text = message(
                "mujoco.has_no_force", "its gain is 0, so that it has no force; it is no motor"
            )
            self.report.add("dropped", where, text)
            return
        for joint, lever in levers.items():
            drive = self._drives.setdefault(joint, _Drive())
            if model.actuator_forcelimited[actuator]:
                peak = float(np.abs(model.actuator_forcerange[actuator]).max())
            elif (
                model.actuator_ctrllimited[actuator]
                and plain
                and model.actuator_biastype[actuator] == _NONE
            ):
                peak = abs(gain[0]) * float(np.abs(model.actuator_ctrlrange[actuator]).max())
            else:
                peak = 0.0
            drive.effort = max(drive.effort, abs(lever) * peak)
            if plain and model.actuator_biastype[actuator] == _AFFINE:
                drive.kp += max(-bias[1], 0.0) * lever**2
                drive.kd += max(-bias[2], 0.0) * lever**2

    def _levers(self, actuator: int) -> dict[int, float]:
        """Return the joints that an actuator drives, each with the torque per force of the actuator."""
        model, gear = self.model, float(self.model.actuator_gear[actuator][0])
        kind, target = model.actuator_trntype[actuator], int(model.actuator_trnid[actuator][0])
        if kind in (_IN_JOINT, _IN_PARENT) and model.jnt_type[target] not in (_FREE, _BALL):
            return {target: gear}
        first = int(model.tendon_adr[target]) if kind == _TENDON else 0
        wraps = range(first, first + int(model.tendon_num[target])) if kind == _TENDON else ()
        pulled = [wrap for wrap in wraps if model.wrap_type[wrap] == _OF_JOINT]
        return {int(model.wrap_objid[wrap]): gear * float(model.wrap_prm[wrap]) for wrap in pulled}

    def _write_joint(self, joint: UrdfJoint) -> None:
        model, element, number = self.model, joint.element, joint.joint
        limit = ET.SubElement(element, "limit")
        if model.jnt_limited[number]:
            lower, upper = model.jnt_range[number].tolist()
            lower = -upper if model.jnt_type[number] == _BALL else lower
            limit.attrib |= {"lower": format_number(lower), "upper": format_number(upper)}
        drive = self._drives.get(number, _Drive())
        effort = drive.effort
        if model.jnt_actfrclimited[number]:
            own = float(np.abs(model.jnt_actfrcrange[number]).max())
            effort = min(effort, own) if effort else own
        if effort:
            limit.set("effort", format_number(effort))
        if drive.kp > 0:
            add_note(element, KP, drive.kp)
            add_note(element, KD, drive.kd)
        dof = model.jnt_dofadr[number] + joint.part
        friction = {"damping": model.dof_damping[dof], "friction": model.dof_frictionloss[dof]}
        ET.SubElement(
            element,
            "dynamics",
            {key: format_number(value) for key, value in friction.items() if value},
        )
        # In a file with actuators, joints without one are passive, unless an equality makes them follow other joints.
        if number in self._drives or number in self._followers or not self._drives:
            motor = add_motor(self.robot, name_of(element), drive=f"{name_of(element)}_drive")
            if model.dof_armature[dof] > 0:
                ET.SubElement(
                    motor, f"{DRAKE}rotor_inertia", value=format_number(model.dof_armature[dof])
                )
        elif model.dof_armature[dof] > 0:
            armature = message(
                "mujoco.armature_without_motor",
                "no actuator drives it, and an armature ({armature:g}) is simulated as the rotor of a motor only",
                armature=model.dof_armature[dof],
            )
            self.report.add(
                "lost",
                message("mujoco.joint_called", "joint '{name}'", name=name_of(element)),
                armature,
            )
        if model.jnt_stiffness[number] > 0:
            text = message(
                "mujoco.joint_spring",
                "a spring of {stiffness:g} per rad or m: springs at joints are not simulated",
                stiffness=model.jnt_stiffness[number],
            )
            self.report.add(
                "lost",
                message("mujoco.joint_called", "joint '{name}'", name=name_of(element)),
                text,
            )

    def _propose_home(self) -> None:
        """Propose the posture of the keyframe called home, or of the first, or else MuJoCo's own."""
        model = self.model
        names = [str(name) for name in model.key_name]
        key = names.index(_HOME) if _HOME in names else 0
        posture = model.key_qpos[key] if names else model.qpos0
        own = [joint for joint in self.joints if model.jnt_type[joint.joint] != _BALL]
        values = [float(posture[model.jnt_qposadr[joint.joint]]) for joint in own]
        if not any(values):
            return
        for joint, value in zip(own, values, strict=True):
            lower, upper = (
                model.jnt_range[joint.joint]
                if model.jnt_limited[joint.joint]
                else (-np.inf, np.inf)
            )
            add_note(joint.element, HOME, float(np.clip(value, lower, upper)))
        if names:
            self.report.add(
                "read",
                message("mujoco.keyframe_called", "keyframe '{name}'", name=names[key]),
                message("mujoco.posture_at_start", "is the posture at the start"),
            )

    def _write_constraints(self) -> None:
        """Write couplings of joints as a URDF does; closed loops are for the next stage to refuse or leave out."""
        model, first = self.model, {joint.joint: joint.element for joint in reversed(self.joints)}
        for index, kind in enumerate(model.eq_type):
            name = str(model.eq_name[index]) or message(
                "mujoco.equality", "equality {index}", index=index + 1
            )
            ends = [int(model.eq_obj1id[index]), int(model.eq_obj2id[index])]
            if model.eq_objtype[index] == _SITE:
                ends = [int(model.site_bodyid[site]) for site in ends]
            if not model.eq_active0[index]:
                self.report.add(
                    "dropped",
                    message("mujoco.constraint_called", "constraint '{name}'", name=name),
                    message("mujoco.not_active", "is not active"),
                )
                continue
            if kind in (_CONNECT, _WELD) and all(body in self.bodies for body in ends):
                between = "' and '".join(name_of(self.bodies[body]) for body in ends)
                loop = ET.SubElement(self.robot, "loop_joint", name=f"{name} of '{between}'")
                # A connection of sites has no anchors in the bodies, which a ball joint needs.
                if kind == _CONNECT and model.eq_objtype[index] != _SITE:
                    loop.append(self._ball_coupling(index, name, ends).element())
                continue
            if kind == _COUPLED and ends[0] in first:
                self._write_mimic(index, name, ends, first)
                continue
            self.report.add(
                "lost",
                message("mujoco.constraint_called", "constraint '{name}'", name=name),
                message("mujoco.not_simulated", "is not simulated"),
            )

    def _ball_coupling(self, index: int, name: str, ends: Sequence[int]) -> LoopCoupling:
        """Make the coupling that replaces a connection of two bodies: a ball joint.

        Args:
            index: index of the constraint in the model.
            name: name of the constraint.
            ends: indices of the two bodies in the model.
        """
        # MuJoCo gives the anchor in the frames of both bodies.
        anchor, other_anchor = np.asarray(self.model.eq_data[index][: 2 * _ANCHOR_NUMBERS]).reshape(
            2, _ANCHOR_NUMBERS
        )
        return LoopCoupling(
            name=re.sub(r"\W+", "_", name, flags=re.ASCII),  # a key of a station's file
            kind="ball",
            body=name_of(self.bodies[ends[0]]),
            other=name_of(self.bodies[ends[1]]),
            # the sum makes 0 of -0
            place=[round(number, _DIGITS) + 0.0 for number in anchor.tolist()],
            other_place=[round(number, _DIGITS) + 0.0 for number in other_anchor.tolist()],
        )

    def _write_mimic(
        self, index: int, name: str, ends: Sequence[int], elements: Mapping[int, ET.Element]
    ) -> None:
        """Write an equality of two joints as an element ``mimic`` of the first joint, which makes it follow the second.

        MuJoCo's equality is y - y0 = sum of c_k (x - x0)^k, with the position y of the first joint, the position x of
        the second, and their positions y0 and x0 in the model's zero posture. A ``mimic`` is linear, so only c_0 and
        the slope c_1 are written. Without a second joint, the first one is held at y0 + c_0: a multiplier of 0.

        Args:
            index: index of the constraint in the model.
            name: name of the constraint, for the report.
            ends: indices of the two joints in the model; the second is negative if there is none.
            elements: URDF elements of the joints, by their indices in the model.
        """
        model = self.model
        where = message("mujoco.constraint_called", "constraint '{name}'", name=name)
        follower = elements[ends[0]]
        if follower.find("mimic") is not None:
            problem = message(
                "mujoco.follows_another",
                "joint '{joint}' follows another one already: this coupling is not simulated",
                joint=name_of(follower),
            )
            self.report.add("lost", where, problem)
            return
        constant, slope, *higher = np.asarray(model.eq_data[index][:_POLYNOMIAL_NUMBERS]).tolist()
        follower_zero = float(model.qpos0[model.jnt_qposadr[ends[0]]])
        if ends[1] < 0:
            # A mimic must name a leader. With a multiplier of 0 it does not matter which: the joint names itself.
            position = format_number(follower_zero + constant)
            ET.SubElement(
                follower, "mimic", joint=name_of(follower), multiplier="0", offset=position
            )
            return
        leader = elements.get(ends[1])
        if leader is None:
            self.report.add(
                "lost",
                where,
                message(
                    "mujoco.other_joint_missing",
                    "its other joint is not there: it is not simulated",
                ),
            )
            return
        if any(higher):
            problem = message(
                "mujoco.follows_by_slope",
                "joint '{joint}' follows by its slope at zero, {slope:g}",
                joint=name_of(follower),
                slope=slope,
            )
            self.report.add(
                "lost",
                where,
                message(
                    "mujoco.higher_polynomial",
                    "a polynomial of higher degree; {problem}",
                    problem=problem,
                ),
            )
        # y = c_1 x + offset, with offset = y0 + c_0 - c_1 x0.
        leader_zero = float(model.qpos0[model.jnt_qposadr[ends[1]]])
        offset = follower_zero + constant - slope * leader_zero
        ET.SubElement(
            follower,
            "mimic",
            joint=name_of(leader),
            multiplier=format_number(slope),
            offset=format_number(offset),
        )
