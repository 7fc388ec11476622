"""What every kind of gait declares, and what it plans: joint angles over time, and where the robot begins."""

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
from simrob_drake.base.sections import Integer, NotNegative, Number, Strict, validated
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
"""Of the scheme `cenic` [s]: references stand still over a step. Steps of this length are as good as longer ones with
error control, which work out each step thrice, and take half to three quarters of their time."""
_FLOOR_AROUND = 1.0  # floor beyond the way that a motion goes [m]


@dataclass(frozen=True)
class JointMotion:
    """A planned motion of a robot.

    Attributes:
        model: of the robot.
        feet: the kind of feet it is planned for; the default one if None.
        times: shape (m,) [s].
        positions: of the axes, shape (m, n) [rad].
        root: planned poses of the root in the world, shape (m, 4, 4).
        servo: gains of the servos for it, in place of the station's: kp, kd.
        feed_velocity: whether the servos are told the reference's velocity, too.
        falls: whether it ends on the floor, as it shall.
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
        """How long it takes [s]."""
        return float(self.times[-1])

    @property
    def velocities(self) -> Vector:
        """Of the axes, shape (m, n) [rad/s]; zero at both ends."""
        rates = np.gradient(self.positions, self.times, axis=0)
        rates[[0, -1]] = 0.0
        return np.asarray(rates)

    def trajectory(self) -> Trajectory:
        """Return the angles as a smooth curve through the samples (cubics with their velocities)."""
        return hermite(self.times, self.positions, self.velocities)

    def station(self, overrides: Mapping[str, Any] | None = None, *, name: str | None = None) -> StationConfig:
        """Return the robot's dynamic station, set to begin this motion; its trajectory is the reference to give it.

        Args:
            overrides: further changes, as of ``load_station``; what they say is not adapted to the motion.
            name: of the station; ``<robot>_dynamic`` unless given.
        """
        settings: dict[str, Any] = {
            "robot.base": poses_from_matrices(self.root)[0].tolist(),
            "robot.initial_deg": np.rad2deg(self.positions[0]).tolist(),
            "duration": self.duration,
            "program": None,
        }
        if self.feet is not None:
            settings["robot.feet"] = self.feet
        if self.model.folder != models_root() / self.model.name:
            settings["robot.model"] = str(self.model.folder / ROBOT_FILE)
        changes = overrides or {}
        config = load_station(name or f"{self.model.name}_dynamic", {**settings, **changes})
        nested = {f"{key}.{inner}" for key, value in changes.items() if isinstance(value, Mapping) for inner in value}
        return self.adapted(config, ONLY_ROBOT, changed={*changes, *nested})

    def adapted(
        self, config: StationConfig, robot: str, *, start: float = 0.0, changed: Collection[str] = ()
    ) -> StationConfig:
        """Return a station on which a robot can perform the motion; a kinematic one is as it was.

        Its servos have the motion's gains, and are told the velocity if it feeds it; the floor is large enough
        wherever the robot goes; steps of `cenic` are short enough for servos to follow, and of one length unless
        the station says `error_control` itself. If the robot shall fall, no monitor of its fall is left.

        Args:
            config: the station.
            robot: who performs.
            start: how far from the world's origin [m].
            changed: dotted keys of what stays as it is.
        """
        if not config.engine.moves_by_forces:
            return config
        gains = {key: value for key, value in self.servo.items() if f"servo.{key}" not in changed}
        servo = ServoConfig(**{**config.servo_of(robot).model_dump(exclude_unset=True), **gains})
        entry = config.robots[robot].model_copy(update={"servo": servo})
        changes: dict[str, Any] = {"robots": {**config.robots, robot: entry}}
        if config.floor is not None and "floor.size" not in changed:
            way = np.linalg.norm(self.root[:, :2, 3] - self.root[0, :2, 3], axis=1).max()
            size = max(config.floor.size, float(np.ceil(2.0 * (start + way + _FLOOR_AROUND))))
            changes["floor"] = config.floor.model_copy(update={"size": size})
        if self.feed_velocity and "inputs" not in changed:
            changes["inputs"] = tuple(dict.fromkeys((*config.inputs, "reference_velocity")))
        if self.falls and "monitors" not in changed:
            changes["monitors"] = unwatched(config, robot)
        return config.model_copy(update={**changes, "solver": short_steps(config.solver, changed)})


def unwatched(config: StationConfig, robot: str) -> dict[str, Any]:
    """Return the monitors of a station without those of a robot's fall, by name."""
    return {
        name: each
        for name, each in config.monitors.items()
        if not (isinstance(each, Fall) and each.faller(config.only_robot) == robot)
    }


def short_steps(solver: SolverConfig, changed: Collection[str] = ()) -> SolverConfig:
    """Shorten the steps of a solver so that servos can follow references, which it holds over a step.

    Args:
        solver: the solver. One that sees references within its steps, unlike ``cenic``, is returned unchanged.
        changed: dotted keys of the station, such as ``solver.max_step``, that stay as they are.
    """
    if not isinstance(solver, ContinuousSolver) or not solver.engine.holds_inputs_over_steps:
        return solver
    steps: dict[str, Any] = {}
    if "solver.max_step" not in changed:
        steps["max_step"] = min(solver.max_step, MAX_STEP)
    if "solver.accuracy" not in changed and "error_control" not in solver.model_fields_set:
        steps["error_control"] = False
    return solver.model_copy(update=steps)


Pace = Annotated[Number, Field(gt=0, le=100)]  # time of a step, or of a part of one [s]


class ArmBearing(Bearing):
    """How a robot carries itself, its arms included."""

    lean_arms_deg: AxisValues = 0.0
    """Per axis, for a lean to the right of one degree: arms as counterweights where the ankles do not roll [deg]."""
    swing_arms_deg: AxisValues = 0.0
    """Per axis, for a left foot that is a metre ahead of the right one [deg]."""


class Gait(Strict):
    """A gait of a robot, one of those under the section of its kind in ``gaits.yaml``.

    Attributes:
        section: of the file, in which gaits of this kind stand by their names.
        steps: whether it goes steps: it is then told how many, and how large they are (``amplitude``).
        on_feet: whether it is for a robot that stands on the feet that it is made for.
        scaled: parameters that an amplitude scales.
        pace: the parameter that is the time of a step; empty if there is none.
        usual: name of the gait that :meth:`planned` takes.
        one_step: changes with which a single step has its full length.
    """

    section: ClassVar[str]
    steps: ClassVar[bool] = False
    on_feet: ClassVar[bool] = True
    scaled: ClassVar[tuple[str, ...]] = ()
    pace: ClassVar[str] = ""
    usual: ClassVar[str] = ""
    one_step: ClassVar[Mapping[str, Any]] = {}

    feet: str | None = None
    """Kind of feet that it is made for; the robot's default one unless given."""
    rest: NotNegative = 1.0
    """Time to stand at the end [s]."""

    @classmethod
    def of(cls, walker: Walker, name: str, changes: Mapping[str, Any], amplitude: float = 1.0) -> Self:
        """Return a robot's gait of this kind by name, with ``changes`` of parameters, steps scaled by an amplitude.

        Raises UnknownName: no such gait there; tells what there is, in other sections if this one is empty;
        InvalidConfig: a parameter that cannot be.
        """
        file = walker.gaits
        known = file.section(cls.section)
        if name not in known:
            sections = [section for section in file.sections if section != REACTING]
            others = [
                compound("{other} ({section})", other=other, section=section)
                for section in sections
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
                known or others,
            )
        found = validated(cls, dict(known[name]), f"{file.file}: {cls.section}.{name}")
        return found.changed(changes, amplitude, name)

    def changed(self, changes: Mapping[str, Any], amplitude: float, name: str) -> Self:
        """Return it with changes, scaled by an amplitude; raises InvalidParameter, InvalidConfig: what cannot be."""
        amplitude = number(amplitude, "amplitude")
        scaled = {key: amplitude * value for key in self.scaled if (value := getattr(self, key, 0.0))}
        return validated(
            type(self),
            {**self.model_dump(exclude_unset=True), **scaled, **changes},
            message("programs.gait_called", "gait {name}", name=name),
        )

    @classmethod
    def planned(
        cls, robot: str | RobotModel | Walker, steps: int, name: str = "", *, amplitude: float = 1.0, **changes: Any
    ) -> JointMotion:
        """Plan a gait of this kind, by its name in the robot's ``gaits.yaml``, that of the kind unless given.

        A robot is its name, its model, or a :class:`Walker` that tells what it carries and on what slope; ``steps`` are
        full ones, or legs that swing; the amplitude scales the steps: :attr:`scaled` parameters, or how far joints go
        from the first posture; ``changes`` are of parameters of the kind. Raises OutOfReach: steps that are too long or
        too high for the legs; InvalidParameter: a robot that cannot go so, too few steps, or an amplitude that cannot
        be; InvalidConfig: a parameter that cannot be; UnknownName: no such gait, axis or foot.
        """
        walker = Walker.of(robot)
        return cls.of(walker, name or cls.usual, changes, amplitude).plan(walker, steps, amplitude)

    @abstractmethod
    def plan(self, walker: Walker, steps: int, amplitude: float) -> JointMotion:
        """Return its motion in so many steps, :attr:`scaled` parameters scaled by now; raises SimrobError: why not."""

    @property
    def hangs(self) -> bool:
        """Whether it is for a robot that is held by its trunk."""
        return False

    def check_feet(self, model: RobotModel, worn: str | None, key: str) -> None:
        """Check the kind of feet that a robot wears, beyond their size; most gaits ask for nothing else.

        Args:
            model: the robot.
            worn: name of the kind of feet.
            key: key of the station that chooses it.

        Raises:
            InvalidParameter: the gait needs other feet; the message says how to choose them.
        """

    def made_for(self, model: RobotModel) -> str | None:
        """Return the kind of feet that it is made for: what it names, else the robot's default one."""
        return self.feet or (model.feet.default if model.feet else None)


class SolvedGait(Gait):
    """A gait whose legs are solved for."""

    bearing: ArmBearing
    """How the trunk is carried."""
    widen: Number = 0.0
    """How much further out each foot stands than with straight legs, or below its hip [m]."""
    servo: Mapping[str, AxisValues] = Field(default_factory=dict)
    """Servo gains for it, in place of the station's: kp, kd."""


class EvenSteps(Strict):
    """What gaits in equal steps have, on a straight line or a circle."""

    steps: ClassVar[bool] = True
    scaled: ClassVar[tuple[str, ...]] = ("step_length", "sideways", "turn_deg")
    pace: ClassVar[str] = "step_time"
    one_step: ClassVar[Mapping[str, Any]] = {"ramp_steps": 0}

    step_time: Pace
    """From one footfall, of a foot or a pair, to the next [s]."""
    step_length: Number = 0.0
    """How far each step brings the robot ahead; negative walks backward [m]."""
    sideways: Number = 0.0
    """How far each step brings it to the left [m]."""
    turn_deg: Number = 0.0
    """How far each step turns it to the left [deg]."""
    ramp_steps: Integer = Field(default=3, ge=0)
    """Number of additional steps at the start, in which the step length grows, and at the end, in which it shrinks."""
    settle: Pace = 0.6
    """Time to shift the weight at the start and at the end [s]."""
