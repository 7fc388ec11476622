"""Robots for stations: folders of ``models/`` with a ``robot.yaml``, any other such file, or any clean URDF.

A robot has n axes. An axis is a joint of the robot's URDF with a sense: it is positive in the direction of the joint or
against it. Users write positions in degrees, or in metres for prismatic axes. Properties of a robot are in SI units.
A follower is an axis that follows another one, its leader, by a ``mimic`` joint of the URDF.
"""

from collections.abc import Mapping, Sequence
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, Literal
from xml.etree.ElementTree import Element

import numpy as np
from pydantic import BeforeValidator, Field, PrivateAttr, model_validator

from simrob_drake.base.arguments import as_path
from simrob_drake.base.errors import InvalidParameter, UnknownName, Unsuitable, one_of
from simrob_drake.base.file_cache import file_state
from simrob_drake.base.files import ROBOT_FILE, model_file, robot_files
from simrob_drake.base.frames import Flags, Vector
from simrob_drake.base.messages import message
from simrob_drake.base.sections import (
    FileName,
    Number,
    Positive,
    Strict,
    default_of,
    is_file_name,
    validate_section,
)
from simrob_drake.base.yaml_files import read_yaml
from simrob_drake.robots.axis import Axis, axes_by_name
from simrob_drake.robots.axis_map import (
    PRISMATIC,
    REVOLUTE,
    AxisUnit,
    AxisValues,
    PositiveAxisValues,
)
from simrob_drake.robots.bodies import links_without_inertia, tool_links
from simrob_drake.robots.coupled_axes import Firmness, firmness_of_values
from simrob_drake.robots.dh import DhTable, described_by_table, dh_robot
from simrob_drake.robots.feet import Feet
from simrob_drake.robots.fingers import FingerHand, Gripper, fingers_of
from simrob_drake.robots.followers import MimicFollower, followers_among, with_followers
from simrob_drake.robots.limits import AxisLimits, middles
from simrob_drake.robots.motors import Drives, Gains, set_drives
from simrob_drake.robots.urdf import (
    DRAKE,
    add_motor,
    child_of,
    driven_joints,
    format_number,
    joint_limits,
    joint_value,
    movable_joints,
    name_of,
    remove_motors,
    root_link,
    transmissions_of,
)
from simrob_drake.robots.urdf_check import check_urdf, checked_urdf

PASSIVE = "servo.passive"
"""Key of the axes without a motor in a station and in a ``robot.yaml``, for messages."""
LIMIT = "servo.torque_limit"
"""Key of the largest torques in a station and in a ``robot.yaml``, for messages."""


class RobotModel(Strict):
    """A robot as its ``robot.yaml`` describes it.

    The order of ``axes`` is the order of every vector of this robot, and each axis is positive in the sense that
    its ``sign`` gives to the URDF's joint. A table of Denavit-Hartenberg parameters replaces the URDF, and determines
    root, axes and tools.
    """

    name: FileName
    """Name of the robot; that of its folder or its file unless given."""
    folder: Path
    """Folder of the robot's file. All file names in it are relative to this folder."""
    description: str = ""
    """Description of the robot in one line."""
    source: str = ""
    """Source of the values, and which of them are estimates."""
    urdf: str | None = None
    """File of the robot's URDF. A robot with a table `dh` has none."""
    dh: DhTable | None = None
    """Table of Denavit-Hartenberg parameters, in place of a URDF. It determines root, axes and tools."""
    base: Literal["fixed", "floating"] = "fixed"
    """Whether the root link is fixed to the world, as that of an arm, or moves freely."""
    root: str
    """The root link of the URDF."""
    axes: Annotated[
        dict[str, Axis],
        BeforeValidator(axes_by_name, json_schema_input_type=dict[str, Axis] | list[str]),
        Field(min_length=1),
    ]
    """Axes by name, in the order of every vector; a plain list if all axes have the names of their joints."""
    tools: dict[str, str] = Field(default_factory=dict)
    """Links or frames of the URDF that can carry a tool, by the tool's name; the first is the usual one."""
    home_deg: AxisValues = 0.0
    """Positions of the axes at the start of a station without `initial_deg` [deg, or m of a prismatic axis]. An axis
    whose range excludes 0 is in the middle of its range unless a mapping, a list or a number other than 0 gives its
    position."""
    drives: Drives = default_of(Drives)
    """Motors, gears and friction of the axes, which a station may change."""
    acceleration_deg: PositiveAxisValues | None = None
    """Largest acceleration of the axes [deg/s², or m/s² of a prismatic axis]; `drake:acceleration` of the URDF's limits
    unless given. Without either, acceleration has no limit."""
    jerk_deg: PositiveAxisValues | None = None
    """Largest jerk of the axes [deg/s³, or m/s³ of a prismatic axis], for moves with `profile: jerk_limited`."""
    payload: Positive | None = None
    """Largest mass that the robot is rated to carry, in addition to its own links [kg]."""
    tcp_speed: Positive | None = None
    """Largest rated speed of the tool centre point [m/s]."""
    postures: dict[str, dict[str, Number]] = Field(default_factory=dict)
    """Named postures for programs: positions of axes [deg, or m of a prismatic axis]. Axes that a posture does not name
    keep their positions."""
    servo: Gains = default_of(Gains)
    """Gains of the servos, which a station may change."""
    feet: Feet | None = None
    """Contact shapes of the robot's feet."""
    gripper: Gripper | None = None
    """Fingers of the robot. Those of a URDF without a `robot.yaml` are found by themselves."""
    loops: dict[str, dict[str, Any]] = Field(default_factory=dict)
    """Couplings that close kinematic loops, as under `couplings` of a station. The robot's first station gets them."""
    _file: Path | None = PrivateAttr(default=None)

    @model_validator(mode="before")
    @classmethod
    def _add_keys_of_table(cls, content: Any) -> Any:
        """Add the keys that a table of Denavit-Hartenberg parameters determines, if the content has a table."""
        if isinstance(content, dict) and isinstance(content.get("dh"), dict):
            return described_by_table(content)
        return content

    @model_validator(mode="after")
    def _check_source(self) -> "RobotModel":
        """Check that the robot has a URDF or a table, not both, and that the URDF is in the robot's folder.

        Raises:
            ValueError: one of these does not hold; pydantic reports the error with the key.
        """
        if (self.urdf is None) == (self.dh is None):
            raise ValueError(
                message("robots.urdf_or_dh", "a robot has either a urdf or a dh table")
            )
        # A robot's folder has to be complete: it can then be copied, and its file cannot name other files of a disk.
        # Paths are resolved, since "../" and links would lead out of the folder otherwise.
        if self.urdf is not None and not self.urdf_path.resolve().is_relative_to(
            self.folder.resolve()
        ):
            raise ValueError(
                message(
                    "robots.urdf_outside_folder",
                    "the urdf {urdf} is outside the robot's folder; copy it into that folder",
                    urdf=self.urdf,
                )
            )
        return self

    def __repr__(self) -> str:
        return (
            f"<RobotModel {self.name}: {len(self.axes)} axes, {self.base} base; {self.description}>"
        )

    __str__ = __repr__

    @property
    def urdf_path(self) -> Path:
        """Path of the URDF file, or of the ``robot.yaml`` if this has a table in place of a URDF."""
        return self.folder / self.urdf if self.urdf is not None else self.description_file

    @property
    def description_file(self) -> Path:
        """The YAML file that describes the robot. A robot of a URDF alone may have no such file."""
        return self._file or self.folder / ROBOT_FILE

    @cached_property
    def element(self) -> Element:
        """The checked ``robot`` element of the URDF, or of the table, with values of this description.

        These are the passive axes, and the rotor inertia, gear ratio, damping and friction of the drives. The file is
        read when the element is first used.

        Raises:
            InvalidModel: the file is damaged, or the table describes an impossible robot.
            InvalidParameter: the key ``root`` does not name the root link, or a list of values has the wrong length.
            UnknownName: a value is given for, or ``servo.passive`` names, an axis that the robot does not have.
            Unsuitable: an axis gets a motor whose largest torque is not given.
        """
        # A table can describe an impossible robot as well as a file can, so that it has the same checks.
        if self.dh is None:
            root = checked_urdf(self.urdf_path)
        else:
            root = dh_robot(self.name, self.dh)
            check_urdf(root, self.urdf_path)
        # The root also follows from the URDF. A key that differs belongs to another version of the file.
        if self.root != root_link(root):
            raise InvalidParameter(
                "root",
                self.root,
                message(
                    "robots.root_link_of",
                    "{link}, the root link of {file}",
                    link=root_link(root),
                    file=self.urdf_path,
                ),
            )
        # Motors first, since rotor inertia and gear ratio are written into the actuators of motors.
        self._apply_passive_axes(root)
        # Values of the description take the place of those in the URDF.
        joints = [axis.joint for axis in self.axes.values()]
        for key in ("rotor_inertia", "gear_ratio", "damping", "friction"):
            values = getattr(self.drives, key)
            if values is not None:
                set_drives(root, key, self._by_joint(joints, values, f"drives.{key}"))
        return root

    def _apply_passive_axes(self, root: Element) -> None:
        """Remove the motors of the axes under ``servo.passive`` from the URDF, and give all other axes a motor.

        Axes that have a motor keep it with its effort limit; ``servo.torque_limit`` counts for new motors only. Nothing
        changes if the description has no key ``servo.passive``.

        Args:
            root: the ``robot`` element. It is changed.

        Raises:
            InvalidParameter: ``servo.torque_limit`` is a list of the wrong length.
            UnknownName: a key names an axis that the robot does not have.
            Unsuitable: an axis gets a motor whose largest torque is not given.
        """
        if self.servo.passive is None:
            return
        joints = [axis.joint for axis in self.axes.values()]
        passive = {joints[self.axis_index(axis, PASSIVE)] for axis in self.servo.passive}
        remove_motors(root, passive)
        # NaN means an axis without a value.
        torque_limits = {} if self.servo.torque_limit is None else self.servo.torque_limit
        limits = self.axis_vector(torque_limits, LIMIT, np.nan)
        # The joints that have kept their motors, which need no new one.
        driven = driven_joints(root)
        elements = {name_of(joint): joint for joint in root.iterfind("joint")}
        for axis, joint, limit in zip(self.axes, joints, limits.tolist(), strict=True):
            if joint in passive or joint in driven:
                continue
            # Also true for NaN. Drake makes no actuator of a motor without a positive effort.
            if not limit > 0:
                raise Unsuitable(
                    LIMIT,
                    message(
                        "robots.motor_without_limit",
                        "{key} leaves out {axis}, so that {axis} has a motor",
                        key=PASSIVE,
                        axis=axis,
                    ),
                    message(
                        "robots.give_its_limit",
                        "give {axis} a torque limit [N·m or N] as well",
                        axis=axis,
                    ),
                )
            child_of(elements[joint], "limit").set("effort", format_number(limit))
            # The URDF has a transmission already if the joint is passive only by its effort of 0.
            if joint not in transmissions_of(root):
                add_motor(root, joint, drive=f"{joint}_drive")

    def with_passive_axes(
        self, passive: list[str], torque_limits: Mapping[str, float]
    ) -> "RobotModel":
        """Copy the robot with other passive axes.

        Args:
            passive: names of the axes without a motor. All other axes have one.
            torque_limits: largest torque or force of motors, by the name of the axis [N·m or N]. Axes whose joints have
                a motor in the URDF need none.
        """
        servo = self.servo.model_copy(
            update={"passive": passive, "torque_limit": dict(torque_limits)}
        )
        return self.model_copy(update={"servo": servo})

    def _by_joint(self, joints: list[str], values: AxisValues, key: str) -> dict[str, float]:
        """Spread the values of a key over the joints, by name. Joints of axes without a value are left out.

        Args:
            joints: names of the joints of the axes, in the order of the axes.
            values: values as a user gives them: one number, a list, or a mapping by axis.
            key: key of the values, for error messages.
        """
        # NaN means an axis without a value.
        vector = self.axis_vector(values, key, np.nan)
        return {
            joint: value
            for joint, value in zip(joints, vector.tolist(), strict=True)
            if np.isfinite(value)
        }

    def with_drives(self, drives: Drives) -> "RobotModel":
        """Copy the robot with changed drives: the keys that ``drives`` sets replace its own.

        A mapping by axis changes only the values of the axes that it names.

        Raises:
            InvalidParameter: a list has the wrong length.
            UnknownName: a mapping names an axis that the robot does not have.
        """
        # Keys with their defaults are not changes: they must not replace the values of the robot.
        changes = drives.model_dump(exclude_unset=True)
        for key, values in changes.items():
            own = getattr(self.drives, key)
            # One number or a list gives every axis a value, and replaces the own values as it is.
            if not isinstance(values, dict) or own is None:
                continue
            # The own values, spread over the axes, with those of the mapping in their place. NaN means no value.
            where = f"drives.{key}"
            before = self.axis_vector(own, where, np.nan)
            vector = self.axis_vector(values, where, before)
            by_axis = dict(zip(self.axes, vector.tolist(), strict=True))
            changes[key] = {axis: value for axis, value in by_axis.items() if np.isfinite(value)}
        return self.model_copy(update={"drives": self.drives.model_copy(update=changes)})

    @property
    def links(self) -> list[str]:
        """The names of the links of the URDF."""
        return [name_of(link) for link in self.element.iterfind("link")]

    @property
    def is_arm(self) -> bool:
        """Whether the robot is an arm: a robot with a fixed base, without feet, and with a tool."""
        return self.base == "fixed" and self.feet is None and bool(self.tools)

    @property
    def links_without_inertia(self) -> list[str]:
        """Names of the links that move and have no mass, not even with the links that are fixed to them.

        A robot with such links can move in a kinematic station only.
        """
        return links_without_inertia(self.element, floating=self.base == "floating")

    @cached_property
    def joints(self) -> list[Element]:
        """The ``joint`` elements of the axes, in order.

        Raises:
            UnknownName: an axis names a joint that the URDF does not have.
        """
        # The error names the moving joints only: an axis on a fixed joint would be no use.
        known = {name_of(joint): joint for joint in self.element.iterfind("joint")}
        unknown = next((axis.joint for axis in self.axes.values() if axis.joint not in known), None)
        if unknown is not None:
            raise UnknownName(message("base.joint", "joint"), unknown, movable_joints(self.element))
        return [known[axis.joint] for axis in self.axes.values()]

    @property
    def signs(self) -> Vector:
        """Sign of each axis, shape (n,): 1.0 if it is positive in the direction of its joint, -1.0 if against it."""
        return np.array([float(axis.sign) for axis in self.axes.values()])

    @cached_property
    def axis_limits(self) -> tuple[Vector, Vector]:
        """Lower and upper limits of the axes, each of shape (n,) [rad or m]."""
        # Shape (n, 2), one row for each axis.
        of_joints = np.array([joint_limits(joint) for joint in self.joints])
        # An axis against its joint has the limits -upper and -lower; sorting puts the lower one first.
        lower, upper = np.sort(of_joints * self.signs[:, np.newaxis], axis=1).T
        return lower, upper

    @cached_property
    def limits(self) -> AxisLimits:
        """The limits of the axes with their names, for checks of positions."""
        lower, upper = self.axis_limits
        revolute = ~np.array(self.prismatic, dtype=bool)
        return AxisLimits(names=tuple(self.axes), lower=lower, upper=upper, revolute=revolute)

    @cached_property
    def passive(self) -> Flags:
        """Whether each axis is passive, shape (n,): it has no motor, and moves freely."""
        driven = driven_joints(self.element)
        return np.array([name_of(joint) not in driven for joint in self.joints], dtype=bool)

    @property
    def passive_axes(self) -> list[str]:
        """Names of the axes without a motor."""
        return [
            axis
            for axis, is_passive in zip(self.axes, self.passive.tolist(), strict=True)
            if is_passive
        ]

    @property
    def efforts(self) -> Vector:
        """Largest effort of every axis' motor in the URDF, shape (n,) [N·m or N]. It is 0 for a passive axis."""
        # A URDF may state an effort for a joint that no transmission drives.
        limits = np.array([joint_value(joint, "effort") for joint in self.joints])
        return np.where(self.passive, 0.0, limits)

    @property
    def friction(self) -> Vector:
        """Coulomb friction of every axis, shape (n,) [N·m or N]."""
        return np.array([joint_value(joint, "friction", "dynamics") for joint in self.joints])

    @property
    def play(self) -> Vector:
        """Backlash of every axis: the motion of its link while its motor stands still, shape (n,) [rad or m].

        It is 0 for a passive axis, which has no motor and no gear.

        Raises:
            InvalidParameter: ``drives.backlash_deg`` is a list of the wrong length.
            UnknownName: ``drives.backlash_deg`` names an axis that the robot does not have.
        """
        # The key has the user's units. Without the key, no axis has play.
        play = self.user_units * self.axis_vector(
            self.drives.backlash_deg or 0.0, "drives.backlash_deg"
        )
        return np.where(self.passive, 0.0, play)

    @cached_property
    def speed_limits(self) -> Vector:
        """Largest speed of every axis by the URDF, shape (n,) [rad/s or m/s].

        It is infinite if the URDF has none, and for passive axes, whose speed no motor limits.
        """
        # A value that is missing is read as 0. A velocity of 0, with which nothing could move, counts as missing, too.
        limits = np.array([joint_value(joint, "velocity") or np.inf for joint in self.joints])
        return np.where(self.passive, np.inf, limits)

    @property
    def accelerations(self) -> Vector:
        """Largest acceleration of every axis, shape (n,) [rad/s² or m/s²]; infinite if no file gives one.

        The key ``acceleration_deg`` of the robot's file replaces ``drake:acceleration`` of a joint's ``<limit>``.

        Raises:
            InvalidParameter: ``acceleration_deg`` is a list of the wrong length.
            UnknownName: ``acceleration_deg`` names an axis that the robot does not have.
        """
        # A value that is missing is read as 0, and an acceleration of 0 counts as missing, too.
        own = np.array(
            [joint_value(joint, f"{DRAKE}acceleration") or np.inf for joint in self.joints]
        )
        if self.acceleration_deg is None:
            return own
        # A mapping may name some axes only. The others keep the limits of the URDF, here in the user's units.
        return self.user_units * self.axis_vector(
            self.acceleration_deg, "acceleration_deg", own / self.user_units
        )

    @cached_property
    def prismatic(self) -> tuple[bool, ...]:
        """Whether each axis is prismatic. Its values in keys ``..._deg`` are then metres, and its torques forces."""
        return tuple(joint.get("type") == "prismatic" for joint in self.joints)

    @property
    def units(self) -> list[AxisUnit]:
        """The units of every axis."""
        return [PRISMATIC if prismatic else REVOLUTE for prismatic in self.prismatic]

    @property
    def user_units(self) -> Vector:
        """Size of the user's unit of each axis in SI, shape (n,): pi/180 for degrees, 1 for metres."""
        return np.array([unit.size for unit in self.units])

    @property
    def jerks(self) -> Vector:
        """Largest jerk of every axis, shape (n,) [rad/s³ or m/s³]; infinite if the description gives none."""
        return self.user_units * self.axis_vector(self.jerk_deg or {}, "jerk_deg", np.inf)

    @cached_property
    def followers(self) -> dict[str, MimicFollower]:
        """The axes that follow another axis, by name, as ``mimic`` joints of the URDF demand."""
        return followers_among(self.axes, self.joints)

    def with_followers(self, positions: Vector) -> Vector:
        """Move followers to where their leaders take them. Without followers, ``positions`` itself is returned.

        Args:
            positions: positions of the axes, shape (..., n) [rad or m].
        """
        return with_followers(list(self.axes), self.followers, positions)

    @cached_property
    def excludes_zero(self) -> Flags:
        """Whether zero is outside the range of each axis by more than the tolerance for rounding, shape (n,)."""
        return self.limits.excess(np.zeros(len(self.axes))) > 0.0

    @property
    def home(self) -> Vector:
        """The home posture, shape (n,) [rad or m], in which followers are where their leaders take them.

        An axis that ``home_deg`` leaves out, as a mapping can, is at zero or, if its range excludes zero, in the middle
        of its range. The same holds for all axes if ``home_deg`` is the number 0; another number is the position of all
        axes. Values in a mapping or a list count as they are, those of followers excepted.

        Raises:
            InvalidParameter: ``home_deg`` is a list of the wrong length.
            UnknownName: ``home_deg`` names an axis that the robot does not have.
        """
        defaults = middles(self.limits, self.user_units)
        values = self.axis_vector(self.home_deg, "home_deg", defaults)
        is_one_number = not isinstance(self.home_deg, Mapping | Sequence)
        if is_one_number:
            # One number 0, which is also the default, is meant for the axes that can be at zero. A position of 0 in a
            # mapping or a list is kept, so that a check can report it.
            is_unreachable = self.excludes_zero & (values == 0.0)
            values = np.where(is_unreachable, defaults, values)
        return self.with_followers(self.user_units * values)

    def posture(self, name: str, others: Vector) -> Vector:
        """Look up a named posture, such as ``home``.

        Args:
            name: name of the posture.
            others: positions of the axes that the posture leaves out, shape (n,) [rad or m]. The usual ``home`` leaves
                out no axis.

        Returns:
            the posture, shape (n,) [rad or m], in which followers are where their leaders take them.

        Raises:
            UnknownName: there is no such posture, or it names an axis that the robot does not have.
        """
        known = {"home": self.home_deg, **self.postures}
        one_of(message("base.posture_of", "posture of {name}", name=self.name), name, known)
        # A file may name a posture `home` itself, which then counts. Otherwise it is the posture of `home_deg`.
        if name not in self.postures:
            return self.home
        position = self.axis_vector(
            self.postures[name], f"postures.{name}", others / self.user_units
        )
        return self.with_followers(self.user_units * position)

    @cached_property
    def fingers(self) -> dict[int, tuple[float, float]]:
        """Closed and open position of each finger [rad or m], by the index of its axis. It is empty without fingers.

        Raises:
            UnknownName: the gripper names an axis that the robot does not have.
        """
        if self.gripper is None:
            return {}
        fingers = {}
        for axis, (closed, opened) in self.gripper.axes.items():
            index = self.axis_index(axis, "gripper.axes")
            unit = self.user_units[index]
            fingers[index] = (closed * unit, opened * unit)
        return fingers

    @property
    def unit_names(self) -> list[str]:
        """Name of the user's unit of every axis: ``deg`` or ``m``."""
        return [unit.name for unit in self.units]

    @property
    def effort_units(self) -> list[str]:
        """The unit of every axis' effort: ``N·m`` or ``N``."""
        return [unit.effort for unit in self.units]

    def bounds(self, degrees: float, metres: float) -> Vector:
        """Assign a bound to each axis: degrees if it is revolute, metres if prismatic. Returns SI units, shape (n,)."""
        return np.where(self.prismatic, metres, np.deg2rad(degrees))

    def axis_vector(self, values: AxisValues, name: str, default: float | Vector = 0.0) -> Vector:
        """Spread a user's values over the n axes.

        Args:
            values: one number for all axes, a list with a number for each axis, or a mapping by axis.
            name: key under which the values are written, for error messages.
            default: value, or values (n,), of axes that a mapping leaves out.

        Returns:
            one value for each axis, shape (n,), in the unit of ``values``.

        Raises:
            InvalidParameter: a list has the wrong length.
            UnknownName: a mapping has a key that is no axis.
        """
        count = len(self.axes)
        if isinstance(values, Mapping):
            vector = np.full(count, default, dtype=float)
            for key, value in values.items():
                vector[self.axis_index(key, name)] = value
            return vector
        # A number becomes a vector without dimensions, which is spread over all axes below.
        vector = np.asarray(values, dtype=float)
        if vector.ndim == 1 and vector.size != count:
            raise InvalidParameter(
                name,
                values,
                message(
                    "robots.number_for_each_axis",
                    "one number, or {count} numbers, one for each axis of {name}",
                    count=count,
                    name=self.name,
                ),
            )
        # A copy, since a broadcast array is read-only.
        return np.broadcast_to(vector, (count,)).copy()

    def firmness(self, values: AxisValues | None) -> list[Firmness]:
        """Find how firmly a user's values give the position of each of the n axes; see :class:`Firmness`.

        Args:
            values: the values that the user writes under one key; None if there are none.
        """
        return firmness_of_values(values, len(self.axes), self.axis_index)

    def axis_index(self, axis: str, where: str = "") -> int:
        """Find the index of an axis by its name or an alias.

        Args:
            axis: the name or alias.
            where: key under which a user has written it, for the message of an error; empty if there is none.

        Raises:
            UnknownName: there is no such axis.
        """
        for index, (name, entry) in enumerate(self.axes.items()):
            if axis == name or axis in entry.aliases:
                return index
        kind = message("base.axis_of", "axis of {name}", name=self.name)
        if where:
            kind += message("robots.under_section", " (under {where})", where=where)
        # Suggestions for a misspelt name include the aliases.
        aliases = [alias for entry in self.axes.values() for alias in entry.aliases]
        raise UnknownName(kind, axis, [*self.axes, *aliases])


def robot_names() -> list[str]:
    """List the names of the robots that come with the package and with extensions."""
    return list(robot_files())


def load_robot(name: str) -> RobotModel:
    """Load a robot of the package, or of an extension, by its name.

    Raises:
        UnknownName: there is no such robot.
        InvalidConfig: its ``robot.yaml`` has a wrong entry.
    """
    # The list of all robots takes longer, since extensions are searched for it. Only the error needs the list.
    file = model_file("robots", name) if isinstance(name, str) else None
    if file is None:
        file = robot_files()[one_of(message("base.robot", "robot"), name, robot_names())]
    return load_robot_file(file)


def load_robot_file(file: Path | str) -> RobotModel:
    """Load the robot that a YAML file describes.

    Unless the file has a key ``name``, a ``robot.yaml`` gives the robot the name of its folder (if that has a name, as
    the root of the file system has none), and any other file its own name.

    Raises:
        InvalidConfig: the file has a wrong entry.
        InvalidParameter: ``file`` is no path, or has characters that cannot be printed.
    """
    file = as_path(file, "file").resolve()
    name = file.parent.name if file.name == ROBOT_FILE and file.parent.name else file.stem
    # A key `name` of the file comes last and replaces the name that is given here.
    robot = validate_section(
        RobotModel, {"name": name, "folder": file.parent, **read_yaml(file)}, file
    )
    robot._file = file
    return robot


def load_robot_from_urdf(path: Path | str) -> RobotModel:
    """Load the robot of a clean URDF.

    If the URDF's folder has a ``robot.yaml`` that names this URDF, that file describes the robot. Otherwise its moving
    joints are its axes. In the home posture of such a robot, fingers are open, and joints that cannot be at zero are in
    the middle of their ranges.

    Raises:
        InvalidModel: the file cannot be read or has a defect.
        InvalidParameter: the robot has no joint that moves; or ``path`` is no path, or has characters that cannot be
            printed.
        InvalidConfig: the ``robot.yaml`` has a wrong entry.
    """
    path = as_path(path, "path")
    described = described_robot(path)
    if described is not None:
        return described
    root = checked_urdf(path)
    if not movable_joints(root):
        raise InvalidParameter(
            "robot.urdf",
            str(path),
            message("robots.robot_that_moves", "a robot with at least one joint that moves"),
        )
    # A robot's name becomes part of file names, and a URDF may have any text as a name.
    names = [name for name in (root.get("name", ""), path.stem) if is_file_name(name)]
    hand = fingers_of(root)
    robot = RobotModel(
        name=names[0] if names else "robot",
        folder=path.resolve().parent,
        urdf=path.name,
        root=root_link(root),
        axes={joint: Axis(joint=joint) for joint in movable_joints(root)},
        tools={tool: tool for tool in tool_links(root, "" if hand is None else hand.palm)},
    )
    # Units of the axes are needed for the gripper, and the gripper for the home posture, so the robot grows in steps.
    if hand is not None:
        robot = robot.model_copy(update={"gripper": _gripper(robot, hand)})
    return robot.model_copy(update={"home_deg": _home_of_urdf(robot)})


def _gripper(robot: RobotModel, hand: FingerHand) -> Gripper:
    """Convert the fingers of a hand from rad or m to the user's units, as in a ``robot.yaml``.

    Args:
        robot: a robot of a URDF alone, whose axes have the names of their joints.
        hand: its fingers, by the name of the joint.
    """
    unit_sizes = dict(zip(robot.axes, robot.user_units.tolist(), strict=True))
    axes = {}
    for axis, finger in hand.fingers.items():
        axes[axis] = (finger.closed / unit_sizes[axis], finger.opened / unit_sizes[axis])
    return Gripper(axes=axes)


def _home_of_urdf(robot: RobotModel) -> AxisValues:
    """Choose the home posture of a robot whose file has none, in the user's units.

    Fingers are open. All other axes are at zero or, if their range excludes zero, in the middle of it; but followers
    are where their leaders take them. Axes at zero are left out of the mapping. If all axes are at zero, the result is
    the number 0.
    """
    opened = {}
    if robot.gripper is not None:
        opened = {axis: opened_at for axis, (_, opened_at) in robot.gripper.axes.items()}
    # The property `home` fills in the middles of ranges, and the positions of followers.
    home = robot.model_copy(update={"home_deg": opened}).home / robot.user_units
    # Six digits keep a station's file readable.
    values = {
        axis: float(f"{value:.6g}")
        for axis, value in zip(robot.axes, home.tolist(), strict=True)
        if value
    }
    return values or 0.0


def described_robot(path: Path) -> RobotModel | None:
    """Load the robot of the ``robot.yaml`` in the folder of a URDF.

    Returns None if the folder has no such file, or if the file names another URDF.

    Args:
        path: the URDF.

    Raises:
        InvalidConfig: the ``robot.yaml`` has a wrong entry.
    """
    file = path.parent / ROBOT_FILE
    if file_state(file) is None:
        return None
    # The folder may have several URDFs, and its description is that of one of them. Resolved paths compare the files
    # and not the ways to write their names.
    described = load_robot_file(file)
    is_of_this_urdf = described.urdf_path.resolve() == path.resolve()
    return described if is_of_this_urdf else None
