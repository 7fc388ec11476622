"""The robots that a station can name: folders of ``models/`` with a ``robot.yaml``, such a file, or any clean URDF."""

from collections.abc import Mapping, Sequence
from functools import cached_property
from os.path import isfile
from pathlib import Path
from typing import Annotated, Any, Literal
from xml.etree.ElementTree import Element

import numpy as np
from pydantic import BeforeValidator, Field, PrivateAttr, model_validator

from simrob_drake.arguments import as_path
from simrob_drake.errors import InvalidParameter, UnknownName, one_of
from simrob_drake.files import ROBOT_FILE, robot_files
from simrob_drake.frames import Vector
from simrob_drake.robots.axis import Axis, axes_by_name
from simrob_drake.robots.axis_map import PRISMATIC, REVOLUTE, AxisUnit, AxisValues, PositiveAxisValues
from simrob_drake.robots.bodies import Gripper, fingers_of, links_without_inertia, tool_links
from simrob_drake.robots.coupled_axes import Asked, asked_by
from simrob_drake.robots.dh import DhTable, described_by_table, dh_robot
from simrob_drake.robots.feet import Feet
from simrob_drake.robots.followers import MimicFollower, followers_among, with_followers
from simrob_drake.robots.limits import AxisLimits, Flags, middles
from simrob_drake.robots.motors import Drives, Gains, set_drives
from simrob_drake.robots.urdf import DRAKE, joint_figure, joint_limits, movable_joints, name_of, root_link
from simrob_drake.robots.urdf_check import check_urdf, checked_urdf
from simrob_drake.sections import FileName, Number, Positive, Strict, default_of, is_file_name, validated
from simrob_drake.yaml_files import read_yaml


class RobotModel(Strict):
    """A robot as its ``robot.yaml`` describes it.

    The order of ``axes`` is the order of every vector of this robot, and each axis is positive in the sense that
    its ``sign`` gives to the URDF's joint. A table of Denavit-Hartenberg parameters stands for a URDF, and tells root,
    axes and tools.
    """

    name: FileName
    """What it is called; as its folder or its file unless given."""
    folder: Path
    """Where its file lies, which all its file names start from."""
    description: str = ""
    """What it is, in one line."""
    source: str = ""
    """Where its figures are from, and which are estimates."""
    urdf: str | None = None
    """Its URDF; a table takes its place."""
    dh: DhTable | None = None
    """Its table of Denavit-Hartenberg parameters, in place of a URDF; it tells root, axes and tools, too."""
    base: Literal["fixed", "floating"] = "fixed"
    """Whether its root link is fixed to the world, as an arm's is, or moves freely."""
    root: str
    """The root link of the URDF."""
    axes: Annotated[
        dict[str, Axis],
        BeforeValidator(axes_by_name, json_schema_input_type=dict[str, Axis] | list[str]),
        Field(min_length=1),
    ]
    """Its axes by name, in the order of every vector; a plain list where they are called as their joints."""
    tools: dict[str, str] = Field(default_factory=dict)
    """Links or frames of the URDF that can carry a tool, by the tool's name; the first is the usual one."""
    home_deg: AxisValues = 0.0
    """Where its axes are at the start of a station that does not say `initial_deg` [deg, or m of a prismatic axis]. An
    axis whose range excludes 0 is in the middle of it unless a mapping or a list says where."""
    drives: Drives = default_of(Drives)
    """Its motors, gears and friction, which a station may change."""
    acceleration_deg: PositiveAxisValues | None = None
    """Largest acceleration of its axes [deg/s², or m/s² of a prismatic axis]; `drake:acceleration` of the URDF's limits
    unless given, and without these none."""
    jerk_deg: PositiveAxisValues | None = None
    """Largest jerk of its axes [deg/s³, or m/s³ of a prismatic axis], for moves with `profile: jerk_limited`."""
    payload: Positive | None = None
    """Largest mass that it is rated to carry, beside its own links [kg]."""
    tcp_speed: Positive | None = None
    """Largest speed that its tool centre point is rated for [m/s]."""
    postures: dict[str, dict[str, Number]] = Field(default_factory=dict)
    """Named postures, for programs: where axes are [deg, or m of a prismatic axis]; the others stay where they are."""
    servo: Gains = default_of(Gains)
    """Gains of its servos, which a station may change."""
    feet: Feet | None = None
    """What it stands on."""
    gripper: Gripper | None = None
    """Its fingers; found in a URDF that stands alone."""
    loops: dict[str, dict[str, Any]] = Field(default_factory=dict)
    """Couplings that close loops of its tree, as under `couplings` of a station; a first station has them."""
    _file: Path | None = PrivateAttr(default=None)

    @model_validator(mode="before")
    @classmethod
    def _of_table(cls, content: Any) -> Any:
        return (
            described_by_table(content)
            if isinstance(content, dict) and isinstance(content.get("dh"), dict)
            else content
        )

    @model_validator(mode="after")
    def _one_origin(self) -> "RobotModel":
        if (self.urdf is None) == (self.dh is None):
            raise ValueError("a robot has either a urdf or a dh table")
        if self.urdf is not None and not self.urdf_path.resolve().is_relative_to(self.folder.resolve()):
            raise ValueError(f"the urdf {self.urdf} lies outside of the robot's folder; copy it there")
        return self

    def __repr__(self) -> str:
        return f"<RobotModel {self.name}: {len(self.axes)} axes, {self.base} base; {self.description}>"

    __str__ = __repr__

    @property
    def urdf_path(self) -> Path:
        """The URDF file, or the description where that holds a table."""
        return self.folder / self.urdf if self.urdf is not None else self.description_file

    @property
    def description_file(self) -> Path:
        """The YAML file that describes the robot; it need not exist for a robot of a URDF alone."""
        return self._file or self.folder / ROBOT_FILE

    @cached_property
    def element(self) -> Element:
        """The checked ``robot`` element; raises InvalidModel: a damaged file; InvalidParameter: another root."""
        if self.dh is None:
            root = checked_urdf(self.urdf_path)
        else:
            check_urdf(root := dh_robot(self.name, self.dh), self.urdf_path)
        if self.root != root_link(root):
            raise InvalidParameter("root", self.root, f"{root_link(root)}, the root link of {self.urdf_path}")
        joints = [axis.joint for axis in self.axes.values()]
        for key in ("rotor_inertia", "gear_ratio", "damping", "friction"):
            if (values := getattr(self.drives, key)) is not None:
                set_drives(root, key, self._by_joint(joints, values, f"drives.{key}"))
        return root

    def _by_joint(self, joints: list[str], values: AxisValues, key: str) -> dict[str, float]:
        """Return values by joint, of those axes for which they are given."""
        vector = self.axis_vector(values, key, np.nan)
        return {joint: value for joint, value in zip(joints, vector.tolist(), strict=True) if np.isfinite(value)}

    def with_drives(self, drives: Drives) -> "RobotModel":
        """Return the robot with other figures of its drives, as far as they are given."""
        changes = drives.model_dump(exclude_unset=True)
        for key, values in changes.items():
            own = getattr(self.drives, key)
            if isinstance(values, dict) and own is not None:
                before = self.axis_vector(own, f"drives.{key}", np.nan)
                vector = self.axis_vector(values, f"drives.{key}", before)
                changes[key] = {
                    axis: value for axis, value in zip(self.axes, vector.tolist(), strict=True) if np.isfinite(value)
                }
        return self.model_copy(update={"drives": self.drives.model_copy(update=changes)})

    @property
    def links(self) -> list[str]:
        """The names of the links of the URDF."""
        return [name_of(link) for link in self.element.iterfind("link")]

    @property
    def links_without_inertia(self) -> list[str]:
        """Moving links that have no inertia, which only a kinematic station can take."""
        return links_without_inertia(self.element, floating=self.base == "floating")

    @cached_property
    def joints(self) -> list[Element]:
        """The ``joint`` elements of the axes, in order; raises UnknownName: an axis without a joint in the URDF."""
        known = {name_of(joint): joint for joint in self.element.iterfind("joint")}
        unknown = next((axis.joint for axis in self.axes.values() if axis.joint not in known), None)
        if unknown is not None:
            raise UnknownName("joint", unknown, movable_joints(self.element))
        return [known[axis.joint] for axis in self.axes.values()]

    @property
    def signs(self) -> Vector:
        """The senses of the axes against their joints, 1.0 or -1.0, shape (n,)."""
        return np.array([float(axis.sign) for axis in self.axes.values()])

    @cached_property
    def axis_limits(self) -> tuple[Vector, Vector]:
        """Lower and upper limit of every axis [rad or m], each of shape (n,), in the sense of the axes."""
        pairs = np.array([joint_limits(joint) for joint in self.joints])
        lower, upper = np.sort(pairs * self.signs[:, np.newaxis], axis=1).T
        return lower, upper

    @cached_property
    def limits(self) -> AxisLimits:
        """The ranges of the axes, in their senses, for checks of positions."""
        lower, upper = self.axis_limits
        revolute = ~np.array(self.prismatic, dtype=bool)
        return AxisLimits(names=tuple(self.axes), lower=lower, upper=upper, revolute=revolute)

    @property
    def efforts(self) -> Vector:
        """Largest effort of every axis' motor in the URDF, shape (n,) [N·m or N]."""
        return np.array([joint_figure(joint, "effort") for joint in self.joints])

    @property
    def friction(self) -> Vector:
        """Coulomb friction of every axis, shape (n,) [N·m or N]."""
        return np.array([joint_figure(joint, "friction", "dynamics") for joint in self.joints])

    @property
    def play(self) -> Vector:
        """How far every axis' link is free against its motor, shape (n,) [rad or m]."""
        return self.user_units * self.axis_vector(self.drives.backlash_deg or 0.0, "drives.backlash_deg")

    @cached_property
    def speed_limits(self) -> Vector:
        """Largest speed of every axis in the URDF, shape (n,) [rad/s or m/s]; infinite where none is told."""
        return np.array([joint_figure(joint, "velocity") or np.inf for joint in self.joints])

    @property
    def accelerations(self) -> Vector:
        """Largest acceleration of every axis, shape (n,) [rad/s² or m/s²]; infinite where none is told."""
        own = np.array([joint_figure(joint, f"{DRAKE}acceleration") or np.inf for joint in self.joints])
        if self.acceleration_deg is None:
            return own
        return self.user_units * self.axis_vector(self.acceleration_deg, "acceleration_deg", own / self.user_units)

    @cached_property
    def prismatic(self) -> tuple[bool, ...]:
        """Whether each axis is prismatic, not revolute; keys in ``..._deg`` hold metres, and its torques are forces."""
        return tuple(joint.get("type") == "prismatic" for joint in self.joints)

    @property
    def units(self) -> list[AxisUnit]:
        """The units of every axis."""
        return [PRISMATIC if prismatic else REVOLUTE for prismatic in self.prismatic]

    @property
    def user_units(self) -> Vector:
        """What one unit of a user's figures is in SI, shape (n,): rad per degree, or 1 m of a prismatic axis."""
        return np.array([unit.size for unit in self.units])

    @property
    def jerks(self) -> Vector:
        """Largest jerk of every axis, shape (n,) [rad/s³ or m/s³]; infinite where none is told."""
        return self.user_units * self.axis_vector(self.jerk_deg or {}, "jerk_deg", np.inf)

    @cached_property
    def followers(self) -> dict[str, MimicFollower]:
        """The axes that follow another axis (``mimic``), by name, in the senses of the axes [rad or m]."""
        return followers_among({name: (axis.joint, axis.sign) for name, axis in self.axes.items()}, self.joints)

    def with_followers(self, positions: Vector) -> Vector:
        """Positions (..., n) [rad or m] with each follower where its leader takes it."""
        return with_followers(list(self.axes), self.followers, positions)

    @cached_property
    def excludes_zero(self) -> Flags:
        """Whether zero is outside the range of each axis, shape (n,)."""
        return self.limits.excess(np.zeros(len(self.axes))) > 0.0

    @property
    def home(self) -> Vector:
        """The home posture, shape (n,) [rad or m], in which followers are where their leaders take them.

        An axis whose range excludes zero, and for which ``home_deg`` has no value of its own, is in the middle of it.
        """
        midway = middles(self.limits, self.user_units)
        values = self.axis_vector(self.home_deg, "home_deg", midway)
        if not isinstance(self.home_deg, Mapping | Sequence):
            # One number is meant for the axes that can take it.
            values = np.where(self.excludes_zero & (values == 0.0), midway, values)
        return self.with_followers(self.user_units * values)

    def posture(self, name: str, others: Vector) -> Vector:
        """Return a named posture, shape (n,) [rad or m], ``home`` among them; axes that it leaves out are as others.

        Raises UnknownName: no such posture, or one of an axis that is not there.
        """
        known = {"home": self.home_deg, **self.postures}
        one_of(f"posture of {self.name}", name, known)
        if name not in self.postures:
            return self.home
        position = self.axis_vector(self.postures[name], f"postures.{name}", others / self.user_units)
        return self.with_followers(self.user_units * position)

    @cached_property
    def fingers(self) -> dict[int, tuple[float, float]]:
        """Places of its fingers' axes, each with closed and open [rad or m]; raises UnknownName: a name of no axis."""
        axes = {} if self.gripper is None else self.gripper.axes
        places = {self.axis_index(axis, "gripper.axes"): ends for axis, ends in axes.items()}
        return {
            place: (ends[0] * self.user_units[place], ends[1] * self.user_units[place])
            for place, ends in places.items()
        }

    @property
    def unit_names(self) -> list[str]:
        """The unit of every axis in a user's figures: ``deg`` or ``m``."""
        return [unit.name for unit in self.units]

    @property
    def effort_units(self) -> list[str]:
        """The unit of every axis' effort: ``N·m`` or ``N``."""
        return [unit.effort for unit in self.units]

    def bounds(self, degrees: float, metres: float) -> Vector:
        """Return one bound for revolute axes [deg] and one for prismatic ones [m], in SI, shape (n,)."""
        return np.where(self.prismatic, metres, np.deg2rad(degrees))

    def axis_vector(self, values: AxisValues, name: str, default: float | Vector = 0.0) -> Vector:
        """Spread a number, a list or a mapping, written under the key ``name``, over the axes: shape (n,), in order.

        ``default`` is the value, or the values, of axes that a mapping leaves out. Raises InvalidParameter: a list of
        the wrong length; UnknownName: a mapping with a key that is no axis.
        """
        count = len(self.axes)
        if isinstance(values, Mapping):
            vector = np.full(count, default, dtype=float)
            for key, value in values.items():
                vector[self.axis_index(key, name)] = value
            return vector
        vector = np.asarray(values, dtype=float)
        if vector.ndim == 1 and vector.size != count:
            raise InvalidParameter(name, values, f"one number, or {count} numbers, one an axis of {self.name}")
        return np.broadcast_to(vector, (count,)).copy()

    def asked(self, values: AxisValues | None) -> list[Asked]:
        """How firmly a user's values per axis ask each of the n axes: see :func:`asked_by`."""
        return asked_by(values, len(self.axes), self.axis_index)

    def axis_index(self, axis: str, where: str = "") -> int:
        """Return the place of an axis given by its name or an alias."""
        for index, (name, entry) in enumerate(self.axes.items()):
            if axis == name or axis in entry.aliases:
                return index
        kind = f"axis of {self.name}" + (f" (under {where})" if where else "")
        raise UnknownName(kind, axis, [*self.axes, *(alias for a in self.axes.values() for alias in a.aliases)])


def robot_names() -> list[str]:
    """Return the names of the robots that come with the package."""
    return list(robot_files())


def load_robot(name: str) -> RobotModel:
    """Return a robot of the package by its name.

    Raises:
        UnknownName: no such robot.
        InvalidConfig: its ``robot.yaml`` has a wrong entry.
    """
    return load_robot_file(robot_files()[one_of("robot", name, robot_names())])


def load_robot_file(file: Path | str) -> RobotModel:
    """Return the robot of a ``robot.yaml``, named as that or its folder; raises InvalidConfig: a wrong entry."""
    file = as_path(file, "file").resolve()
    name = file.parent.name if file.name == ROBOT_FILE and file.parent.name else file.stem
    robot = validated(RobotModel, {"name": name, "folder": file.parent, **read_yaml(file)}, file)
    robot._file = file
    return robot


def load_robot_from_urdf(path: Path | str) -> RobotModel:
    """Return the robot of any clean URDF: with the ``robot.yaml`` beside it if that names this file, else its joints.

    Where nothing is told of its home, joints that cannot be at zero are in the middle of their range there, and fingers
    are open. Raises InvalidModel: the file cannot be read or has a defect.
    """
    path = as_path(path, "path")
    described = described_robot(path)
    if described is not None:
        return described
    root = checked_urdf(path)
    if not movable_joints(root):
        raise InvalidParameter("robot.urdf", str(path), "a robot with at least one joint that moves")
    hand = fingers_of(root)
    robot = RobotModel(
        name=next(filter(is_file_name, (root.get("name", ""), path.stem)), "robot"),
        folder=path.resolve().parent,
        urdf=path.name,
        root=root_link(root),
        axes={joint: Axis(joint=joint) for joint in movable_joints(root)},
        tools={tool: tool for tool in tool_links(root, hand[1] if hand else "")},
    )
    if hand:
        units = dict(zip(robot.axes, robot.user_units.tolist(), strict=True))
        axes = {axis: (closed / units[axis], opened / units[axis]) for axis, (closed, opened) in hand[0].items()}
        robot = robot.model_copy(update={"gripper": Gripper(axes=axes)})
    opened = {} if robot.gripper is None else {axis: ends[1] for axis, ends in robot.gripper.axes.items() if ends[1]}
    home = robot.model_copy(update={"home_deg": opened}).home / robot.user_units
    values = {axis: float(f"{value:.6g}") for axis, value in zip(robot.axes, home.tolist(), strict=True) if value}
    return robot.model_copy(update={"home_deg": values or 0.0})


def described_robot(path: Path) -> RobotModel | None:
    """Return the robot of the ``robot.yaml`` beside a URDF if it describes this file."""
    file = path.parent / ROBOT_FILE
    if not isfile(file):
        return None
    described = load_robot_file(file)
    return described if described.urdf_path.resolve() == path.resolve() else None
