"""Base classes of gaits that are planned before they begin, and the motion that a gait plans.

A robot's file ``gaits.yaml`` has one section for each kind of gait, such as ``walks`` or ``trots``, with the gaits of
this kind by name. A subclass of :class:`Gait` is such a kind: its fields are the parameters that the file sets, and its
method :meth:`Gait.plan` computes a :class:`JointMotion`: joint angles over time and the pose in which the robot begins.
The servos of a dynamic station then follow these angles.
"""

from abc import abstractmethod
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from typing import Annotated, Any, ClassVar, Self

import numpy as np
from pydantic import Field
from pydrake.trajectories import Trajectory

from simrob_drake.base.arguments import number
from simrob_drake.base.errors import UnknownName
from simrob_drake.base.files import ROBOT_FILE, models_root
from simrob_drake.base.frames import Vector, poses_from_matrices
from simrob_drake.base.messages import compound, message
from simrob_drake.base.sections import Integer, NotNegative, Number, Strict, validate_section
from simrob_drake.blocks.references import hermite
from simrob_drake.parts.monitors.sections import Fall
from simrob_drake.programs.gaits.walker import Walker
from simrob_drake.robots.axis_map import AxisValues
from simrob_drake.robots.catalog import RobotModel
from simrob_drake.stations.config import ServoConfig, StationConfig
from simrob_drake.stations.load import ONLY_ROBOT, load_station
from simrob_drake.stations.solver_config import ContinuousSolver, SolverConfig
from simrob_drake.walking.parameters import REACTING, Bearing

MAX_STEP = 0.005
"""Longest step of the scheme `cenic` under a planned motion [s].

`cenic` holds references constant over a step. Steps of this length are as accurate as longer ones with error control,
which compute each step three times, and they take half to three quarters of the time.
"""

# Floor that has to remain around the path of a motion [m]: feet and a fallen robot reach beyond the root link.
_FLOOR_AROUND = 1.0


@dataclass(frozen=True)
class JointMotion:
    """A planned motion of a robot, sampled at m times.

    Attributes:
        model: the robot.
        feet: kind of feet for which the motion is planned. If it is None, the robot's default kind.
        times: times of the samples, shape (m,) [s].
        positions: positions of the n axes, shape (m, n) [rad].
        root: planned poses of the root link in the world, shape (m, 4, 4).
        servo: gains of the servos that replace those of the station, by the keys kp and kd.
        feed_velocity: whether the servos get the velocity of the reference as well.
        falls: whether the motion ends with the robot lying on the floor, as intended.
    """

    model: RobotModel
    feet: str | None
    times: Vector
    positions: Vector
    root: Vector
    servo: Mapping[str, AxisValues] = field(default_factory=dict)
    feed_velocity: bool = True
    falls: bool = False

    @property
    def duration(self) -> float:
        """Duration of the motion [s]."""
        return float(self.times[-1])

    @property
    def velocities(self) -> Vector:
        """Velocities of the axes, shape (m, n) [rad/s]. They are zero at both ends."""
        rates = np.gradient(self.positions, self.times, axis=0)
        # The one-sided differences at the ends are not zero, but a motion begins and ends at rest.
        rates[[0, -1]] = 0.0
        return np.asarray(rates)

    def trajectory(self) -> Trajectory:
        """Smooth trajectory through the samples: cubic polynomials with the velocities at each sample."""
        return hermite(self.times, self.positions, self.velocities)

    def station(
        self,
        overrides: Mapping[str, Any] | None = None,
        *,
        name: str | None = None,
    ) -> StationConfig:
        """Load the robot's dynamic station, set to begin this motion. :meth:`trajectory` is the reference for it.

        Args:
            overrides: further changes, as for ``load_station``. The keys that they set are not adapted to the motion.
                If it is None, there are none.
            name: name of the station. If it is None, ``<robot>_dynamic``.

        Raises:
            SimrobError: there is no such station, or a change has a wrong key or value.
        """
        # The robot starts in the first posture of the plan. A program of the station would move the same axes.
        settings: dict[str, Any] = {
            "robot.base": poses_from_matrices(self.root)[0].tolist(),
            "robot.initial_deg": np.rad2deg(self.positions[0]).tolist(),
            "duration": self.duration,
            "program": None,
        }
        if self.feet is not None:
            settings["robot.feet"] = self.feet
        # A robot that is not one of the package is loaded from its own folder.
        # Two robots may have the same name: that of the package, and one in a folder of the user.
        is_of_package = self.model.folder == models_root() / self.model.name
        if not is_of_package:
            settings["robot.model"] = str(self.model.folder / ROBOT_FILE)
        # The overrides come last: the user may change the start and the duration, too.
        changes = overrides or {}
        config = load_station(name or f"{self.model.name}_dynamic", {**settings, **changes})

        # An override may be nested, {"floor": {"size": 8}}: its dotted key "floor.size" counts as set, too.
        keys = set(changes)
        for key, value in changes.items():
            if isinstance(value, Mapping):
                keys |= {f"{key}.{inner}" for inner in value}
        return self.adapt_station(config, ONLY_ROBOT, changed=keys)

    def adapt_station(
        self,
        config: StationConfig,
        robot: str,
        *,
        start: float = 0.0,
        changed: Collection[str] = (),
    ) -> StationConfig:
        """Make a copy of a station on which a robot can perform this motion.

        In the copy:

        * the servos have the gains of the motion, and get the velocity of the reference if the motion feeds it;
        * a floor is large enough wherever the robot goes;
        * steps of `cenic` are short enough for the servos to follow, and of one length unless the station sets
          `error_control` itself or `changed` has ``solver.accuracy``;
        * no monitor watches for a fall of the robot if the motion ends in one.

        A kinematic station, in which nothing moves by forces, is returned unchanged.

        Args:
            config: the station.
            robot: name of the robot that performs the motion.
            start: the larger one of the robot's distances from the world's origin along x and along y at the start [m].
            changed: dotted keys of the station, such as ``floor.size``, that are not adapted.
        """
        if not config.engine.moves_by_forces:
            return config
        # Gains of the motion replace those of the station, unless the user has changed them on purpose.
        gains = {key: value for key, value in self.servo.items() if f"servo.{key}" not in changed}
        # Only gains that the station sets are copied, so that the others still count as not set.
        station_gains = config.servo_of(robot).model_dump(exclude_unset=True)
        servo = ServoConfig(**{**station_gains, **gains})
        robot_entry = config.robots[robot].model_copy(update={"servo": servo})
        changes: dict[str, Any] = {"robots": {**config.robots, robot: robot_entry}}
        if config.floor is not None and "floor.size" not in changed:
            # The floor is a square around the origin; the robot may go in any direction.
            distances = np.linalg.norm(self.root[:, :2, 3] - self.root[0, :2, 3], axis=1)
            needed = 2.0 * (start + distances.max() + _FLOOR_AROUND)
            size = max(config.floor.size, float(np.ceil(needed)))
            changes["floor"] = config.floor.model_copy(update={"size": size})
        if self.feed_velocity and "inputs" not in changed:
            # The station may have this input already, and each input may be listed only once.
            inputs = (*config.inputs, "reference_velocity")
            changes["inputs"] = tuple(dict.fromkeys(inputs))
        if self.falls and "monitors" not in changed:
            changes["monitors"] = monitors_without_fall(config, robot)
        changes["solver"] = short_steps(config.solver, changed)
        return config.model_copy(update=changes)


def monitors_without_fall(config: StationConfig, robot: str) -> dict[str, Any]:
    """Monitors of a station by name, without those that end a run when one robot falls. Those of other robots stay.

    Args:
        config: the station.
        robot: name of the robot that may fall.
    """
    monitors = {}
    for name, monitor in config.monitors.items():
        watches_fall = isinstance(monitor, Fall) and monitor.faller(config.only_robot) == robot
        if not watches_fall:
            monitors[name] = monitor
    return monitors


def short_steps(solver: SolverConfig, changed: Collection[str] = ()) -> SolverConfig:
    """Shorten the steps of a solver that holds references constant over a step, so that servos can follow them.

    Args:
        solver: the solver. Only the scheme ``cenic`` of continuous time gets shorter steps: other schemes see
            references within their steps, and solvers of discrete time are returned unchanged, too.
        changed: dotted keys of the station that the user has set. With ``solver.max_step`` the longest step stays as it
            is, with ``solver.accuracy`` the control of errors does.
    """
    if not isinstance(solver, ContinuousSolver) or not solver.engine.holds_inputs_over_steps:
        return solver
    steps: dict[str, Any] = {}
    if "solver.max_step" not in changed:
        steps["max_step"] = min(solver.max_step, MAX_STEP)
    # Steps that short need no error control, unless the station sets `error_control` or the user an accuracy.
    if "solver.accuracy" not in changed and "error_control" not in solver.model_fields_set:
        steps["error_control"] = False
    return solver.model_copy(update=steps)


Pace = Annotated[Number, Field(gt=0, le=100)]
"""Type of a parameter that is the duration of a step, or of a part of a step [s]."""


class ArmBearing(Bearing):
    """Posture of a robot while it walks, with the motion of its arms."""

    lean_arms_deg: AxisValues = 0.0
    """Change of each axis per degree of lean to the right [deg]: arms are counterweights if ankles cannot roll."""
    swing_arms_deg: AxisValues = 0.0
    """Change of each axis per metre that the left foot is ahead of the right one [deg]."""


class Gait(Strict):
    """A gait of a robot. A subclass is a kind of gait, and has a section in ``gaits.yaml``.

    Attributes:
        section: name of the section with the gaits of this kind.
        steps: whether the gait consists of steps. It is then planned for a count of steps and an amplitude.
        on_feet: whether the robot stands on its feet, so that it has to have feet for which the gait is made.
        scaled: names of the parameters that an amplitude multiplies.
        pace: name of the parameter that is the time of one step. It is empty if the kind has none.
        usual: name of the gait that :meth:`plan_by_name` takes if none is named.
        one_step: changes of parameters with which a single step has its full length.
    """

    section: ClassVar[str]
    steps: ClassVar[bool] = False
    on_feet: ClassVar[bool] = True
    scaled: ClassVar[tuple[str, ...]] = ()
    pace: ClassVar[str] = ""
    usual: ClassVar[str] = ""
    one_step: ClassVar[Mapping[str, Any]] = {}

    feet: str | None = None
    """Kind of feet for which the gait is made. If it is not set, the robot's default kind."""
    rest: NotNegative = 1.0
    """Time to stand at the end [s]."""

    @classmethod
    def of(
        cls, walker: Walker, name: str, changes: Mapping[str, Any], amplitude: float = 1.0
    ) -> Self:
        """Read a gait of this kind from a robot's ``gaits.yaml``.

        Args:
            walker: the robot.
            name: name of the gait in the section of this kind.
            changes: values of parameters that replace those of the file.
            amplitude: factor of the parameters in :attr:`scaled`, such as the step length.

        Raises:
            UnknownName: the robot has no such gait. The message proposes the nearest gait of the section, or lists them
                if none is near; if this section is empty, the entries of the others except ``reacting``.
            InvalidParameter: the amplitude is not a finite number.
            InvalidConfig: a parameter has an invalid value.
        """
        file = walker.gaits
        # Content of the file by the name of the gait; empty if the file has no such section.
        gaits = file.section(cls.section)
        if name not in gaits:
            # An empty section would give a message without any name: then gaits of other kinds are proposed.
            # Walks that react to measurements are no gaits that are planned before they begin.
            others = [
                compound("{other} ({section})", other=other, section=section)
                for section in file.sections
                if section != REACTING
                for other in file.section(section)
            ]
            raise UnknownName(
                message(
                    "programs.gait_under",
                    "gait of {model} under {section}",
                    model=walker.model.name,
                    section=cls.section,
                ),
                name,
                gaits or others,
            )
        gait = validate_section(cls, dict(gaits[name]), f"{file.file}: {cls.section}.{name}")
        return gait.with_changes(changes, amplitude, name)

    def with_changes(self, changes: Mapping[str, Any], amplitude: float, name: str) -> Self:
        """Make a copy of the gait with other parameters.

        Args:
            changes: new values of parameters. They are not scaled.
            amplitude: factor of the parameters in :attr:`scaled`. 1 leaves them as they are.
            name: name of the gait, for error messages.

        Raises:
            InvalidParameter: the amplitude is not a finite number.
            InvalidConfig: a parameter has an invalid value.
        """
        factor = number(amplitude, "amplitude")
        scaled = {}
        for key in self.scaled:
            value = getattr(self, key, 0.0)
            # No amplitude changes a parameter that is zero: it stays unset.
            if value:
                scaled[key] = factor * value
        # Later entries replace earlier ones: a parameter that the caller changes is not scaled.
        return validate_section(
            type(self),
            {**self.model_dump(exclude_unset=True), **scaled, **changes},
            message("programs.gait_called", "gait {name}", name=name),
        )

    @classmethod
    def plan_by_name(
        cls,
        robot: str | RobotModel | Walker,
        steps: int,
        name: str = "",
        *,
        amplitude: float = 1.0,
        **changes: Any,
    ) -> JointMotion:
        """Plan a gait of this kind.

        Args:
            robot: name or model of the robot, or a :class:`Walker` with its load and its slope.
            steps: count of full steps; for a crawl, of legs that swing.
            name: name of the gait in the robot's ``gaits.yaml``. If it is empty, the usual one of this kind.
            amplitude: factor of the parameters in :attr:`scaled`; for a march, of how far joints move from the first
                posture.
            **changes: values of parameters that replace those of the file.

        Raises:
            OutOfReach: a leg is too short for a step, or a joint is beyond a limit.
            InvalidParameter: the robot cannot perform this kind of gait, the count of steps is less than 1 for a kind
                with steps, or the amplitude is invalid.
            InvalidConfig: a parameter has an invalid value.
            UnknownName: there is no such robot, gait, axis or foot.
        """
        walker = Walker.of(robot)
        return cls.of(walker, name or cls.usual, changes, amplitude).plan(walker, steps, amplitude)

    @abstractmethod
    def plan(self, walker: Walker, steps: int, amplitude: float) -> JointMotion:
        """Plan the motion.

        Args:
            walker: the robot.
            steps: count of full steps. Kinds without steps ignore it.
            amplitude: factor of the motion. The parameters in :attr:`scaled` are already multiplied by it.

        Raises:
            SimrobError: the robot cannot perform the gait.
        """

    @property
    def hangs(self) -> bool:
        """Whether the gait is for a robot that is held by its trunk, such as a swimming stroke."""
        return False

    def check_feet(self, model: RobotModel, worn: str | None, key: str) -> None:
        """Check that the kind of feet suits this gait, apart from their size. The base class accepts every kind.

        Args:
            model: the robot.
            worn: kind of feet that the robot has in its station. If it is None, the robot has no feet.
            key: key of the station that chooses the kind of feet, for the message.

        Raises:
            InvalidParameter: the gait needs other feet; the message has the command that chooses them.
        """

    def made_for(self, model: RobotModel) -> str | None:
        """Kind of feet for which the gait is made: the one it names, or the robot's default one.

        Returns None if the gait names none and the robot has no feet.
        """
        return self.feet or (model.feet.default if model.feet else None)


class SolvedGait(Gait):
    """A gait that plans paths of the feet, for which the joint angles of the legs are solved."""

    bearing: ArmBearing
    """Posture of the trunk and of the arms."""
    widen: Number = 0.0
    """Distance by which each foot stands further out than with straight legs, or than below its hip [m]."""
    servo: Mapping[str, AxisValues] = Field(default_factory=dict)
    """Gains of the servos that replace those of the station: kp, kd."""


class EvenSteps(Strict):
    """Parameters of gaits whose full steps are equal, on a straight line or a circle."""

    steps: ClassVar[bool] = True
    scaled: ClassVar[tuple[str, ...]] = ("step_length", "sideways", "turn_deg")
    pace: ClassVar[str] = "step_time"
    one_step: ClassVar[Mapping[str, Any]] = {"ramp_steps": 0}

    step_time: Pace
    """Time from one touchdown, of a foot or of a pair of feet, to the next [s]."""
    step_length: Number = 0.0
    """Distance that each step brings the robot ahead [m]. A negative one walks backward."""
    sideways: Number = 0.0
    """Distance that each step brings the robot to the left [m]."""
    turn_deg: Number = 0.0
    """Angle by which each step turns the robot to the left [deg]."""
    ramp_steps: Integer = Field(default=3, ge=0)
    """Count of steps at the start in which the step length grows. At the end it shrinks in as many steps."""
    settle: Pace = 0.6
    """Time of each of the two weight transfers, at the start and at the end [s]."""
