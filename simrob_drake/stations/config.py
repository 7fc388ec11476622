"""The sections and keys of a station's file. The fields are the YAML schema, the texts below them its documentation.

All values are in SI units and radians, except those of keys that end in ``_deg``: they are in degrees, or in metres for
a prismatic axis. A value "per axis" is one number for all axes, a list in axis order, or a mapping by axis name.
"""

from collections.abc import Mapping
from html import escape
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

import yaml
from pydantic import Field, field_validator, model_validator

from simrob_drake.base.constants import LARGEST_GAIN, STANDARD_GRAVITY
from simrob_drake.base.errors import InvalidParameter
from simrob_drake.base.messages import compound, message
from simrob_drake.base.sections import (
    FASTEST_RATE,
    ORIGIN,
    Boolean,
    Duration,
    FileName,
    NotNegative,
    Number,
    Pose,
    Positive,
    Renamed,
    Strict,
    check_plain,
    default_of,
)
from simrob_drake.parts.controllers import Controllers
from simrob_drake.parts.couplings import Couplings
from simrob_drake.parts.engine import KINEMATIC, Engine
from simrob_drake.parts.forces import Forces
from simrob_drake.parts.monitors import Monitors
from simrob_drake.parts.references import Hold, ReferenceConfig
from simrob_drake.parts.sensors import Sensors
from simrob_drake.parts.terrain import Terrain
from simrob_drake.robots.axis_map import (
    AxisValues,
    NotNegativeAxisValues,
    PositiveAxisValues,
    every_axis,
)
from simrob_drake.robots.imports import ImportOptions
from simrob_drake.robots.motors import CommandBusConfig, Drives, Motors
from simrob_drake.stations.piece_config import PieceConfig, with_scattered_copies
from simrob_drake.stations.solver_config import (
    ContactConfig,
    ContinuousSolver,
    SolverConfig,
    VerdictConfig,
)

Input = Literal["feedforward", "reference_velocity", "external_force", "external_torque"]
Realization = Literal["per_joint", "vector", "implicit"]
Law = Literal["pid", "cascade", "computed_torque"]
Feedforward = Literal["none", "gravity", "inverse_dynamics"]
MOST_SAMPLES = 1_000_000
"""Samples that a run may have: a quarter of an hour at 1 kHz. With 100 signals they fill 0.8 GB."""
MOST_LATE = 10_000  # largest delay of a sensor [samples]
MOST_FREE_PIECES = 200
"""Pieces of ``free: true``. Drake's time to build a station grows with the third power of the pieces: 4 s for 200."""
MOST_PIECES = 300
"""Pieces, free or not. A station of 300 is built in about 14 s."""
MOST_STEPS = 10_000_000
"""Steps that a run may have, and samples of a sensor: a day of steps of 10 ms. A robot's states fill 4 GB then."""


_Gain = Annotated[
    AxisValues,
    every_axis(
        lambda value: 0 <= value <= LARGEST_GAIN,
        message(
            "stations.gain_range", "a gain must be between 0 and {largest:g}", largest=LARGEST_GAIN
        ),
    ),
]
_Limit = Annotated[
    AxisValues,
    every_axis(
        lambda value: value > 0,
        message(
            "stations.positive_torque_limit",
            "a torque limit must be positive [N·m or N]; servo.passive lists axes without a motor",
        ),
    ),
]
_Speed = Annotated[
    AxisValues,
    every_axis(
        lambda value: value > 0,
        message("stations.positive_speed_limit", "a speed limit must be positive [rad/s or m/s]"),
    ),
]


class ServoConfig(Renamed):
    """The joint servos: PID and saturation. Values that are not given come from the robot's own file."""

    renamed: ClassVar[Mapping[str, str]] = {"yield_gain": "admittance_gain"}

    realization: Realization = "per_joint"
    """Separate blocks for each joint, one block for all, or inside the plant's actuators."""
    law: Law = "pid"
    """`pid`; `cascade`: a position loop that commands a velocity loop with at most speed_limit; or `computed_torque`:
    kp and kd act through the model of the arm, so that they are the same for every joint and in every posture."""
    feedforward: Feedforward = "none"
    """Torque that the model of the robot and its load adds for the desired motion: `gravity` against the weight, or
    `inverse_dynamics` for the whole motion; the derivative part then acts on the error of the velocity, too."""
    kp: _Gain | None = None
    """Proportional gain, per axis [N·m/rad, or N/m of a prismatic axis; 1/s² of a computed torque]."""
    ki: _Gain | None = None
    """Integral gain, per axis [N·m/(rad·s) or N/(m·s)]; 0 leaves the integrators out."""
    kd: _Gain | None = None
    """Derivative gain, per axis [N·m·s/rad or N·s/m; 1/s of a computed torque]."""
    motor: Motors | None = None
    """Motors of the axes, by name (of `models/motors.yaml`, `urdf` or `none`) or by their values, for all axes or by
    axis; by default those of the robot's own file. A motor gives all values that no other key gives: the limit of the
    torque and its fall with speed, the rotors, gears and friction of `drives`, the resolution of `encoders`."""
    passive: list[str] | None = None
    """Axes without a motor, which move freely; by default those of the robot's own file. With [] every axis has a
    motor: one that has none in the robot's file then needs a torque_limit."""
    bus: CommandBusConfig | None = None
    """The bus that transmits commands to the servos; without a bus, commands arrive at once and unchanged."""
    torque_limit: _Limit | None = None
    """Saturation, per axis [N·m or N]; by default that of the motor or the effort limit of the URDF."""
    integral_limit: _Limit | None = None
    """Largest output of the integral part, per axis [N·m or N]; by default torque_limit."""
    speed_limit: _Speed | None = None
    """Largest speed that the position loop of a cascade commands, per axis [rad/s or m/s]; by default the velocity
    limit of the URDF."""
    admittance_gain: Annotated[NotNegative, Field(le=LARGEST_GAIN)] = 0.0
    """Rate at which the servo gives way to forces that the model of the arm does not explain [1/s], for hand guiding; 0
    if it never gives way."""

    @property
    def follows_motion(self) -> bool:
        """Whether the servos also need the desired velocity and acceleration, for torques from the robot's model."""
        return self.law == "computed_torque" or self.feedforward == "inverse_dynamics"

    @model_validator(mode="after")
    def _fits_together(self) -> "ServoConfig":
        """Check that realization, law, feedforward, motor and admittance can be realized together.

        Raises:
            ValueError: two keys exclude each other, or a law lacks the gains that it needs.
        """
        # The admittance integrates the servo's torque, which an actuator of the plant does not give
        # out.
        if self.admittance_gain > 0 and self.realization == "implicit":
            raise ValueError(
                message(
                    "stations.admittance_needs_realization",
                    "admittance_gain needs realization per_joint or vector, since implicit does not report the "
                    "servo's torque",
                )
            )
        # Drake's actuators have PD gains, and no other law.
        if self.law != "pid" and self.realization == "implicit":
            raise ValueError(
                message(
                    "stations.law_needs_realization",
                    "law {law} needs realization per_joint or vector, since actuators have only the law pid",
                    law=self.law,
                )
            )
        if self.motor is not None and self.admittance_gain > 0:
            raise ValueError(
                message(
                    "stations.admittance_without_motor",
                    "admittance_gain cannot be combined with motor",
                )
            )
        if self.law != "pid" and self.admittance_gain > 0:
            raise ValueError(
                message("stations.admittance_with_pid", "admittance_gain needs law pid")
            )
        # Only a cascade has a loop whose command is a speed.
        if self.speed_limit is not None and self.law != "cascade":
            raise ValueError(
                message("stations.speed_limit_with_cascade", "speed_limit needs law cascade")
            )
        if self.law == "computed_torque":
            # A feedforward would count gravity and inertia twice.
            if self.feedforward != "none":
                raise ValueError(
                    message(
                        "stations.computed_torque_is_whole",
                        "law computed_torque contains the whole torque of the model already; remove feedforward",
                    )
                )
            # Gains of a robot's file are torques for an error [N·m/rad], those of this law
            # accelerations [1/s²].
            if self.kp is None or self.kd is None:
                raise ValueError(
                    message(
                        "stations.computed_torque_needs_gains",
                        "law computed_torque needs kp [1/s²] and kd [1/s], such as 400 and 40",
                    )
                )
        return self


class JointStops(Strict):
    """Elastic end stops of the joints, for solver schemes without joint limits. The defaults are Simulink's.

    Prismatic axes have stops with the same values, in N/m and N·s/m, unless they are given their own.
    """

    stiffness: PositiveAxisValues = 5.73e5
    """Spring of a stop, per axis [N·m/rad or N/m]; 1e4 N·m/deg."""
    damping: NotNegativeAxisValues = 573.0
    """Damper of a stop, per axis [N·m·s/rad or N·s/m]; 10 N·m·s/deg."""


class RobotConfig(Renamed):
    """A robot of the station: one of the package by name, or any URDF by path."""

    renamed: ClassVar[Mapping[str, str]] = {
        "pushes": message(
            "stations.push_renamed",
            "one of the station's forces: {{push: {{start: 1, duration: 0.1, force: [5, 0, 0]}}}}",
        )
    }

    model: str | None = None
    """Name of a robot of `simrob list`, or path of a `robot.yaml`; relative paths start at the station's file."""
    urdf: Path | None = None
    """A URDF file instead of a model; relative paths start at the station's file. A file with defects is imported."""
    import_options: ImportOptions | None = None
    """Options of the import of the URDF. If they are given, the URDF is always imported."""
    base: Pose = ORIGIN
    """Pose of the root link in the world, [x y z Rz Ry Rx]. For a robot on its own feet, it is relative to the floor,
    which may be inclined."""
    initial_deg: AxisValues | None = None
    """Joint positions at the start, per axis; by default the robot's `home_deg`. Axes that a mapping leaves out are at
    0, or at home if 0 is outside their ranges; coupled axes that are not named follow their couplings."""
    mimic: Boolean = True
    """Whether axes that mimic others in the robot's file are coupled to them; each of them has a motor in any case."""
    tcp: str | None = None
    """Tool, or link, whose pose is `tcp_pose`; by default the last piece of the robot's chain."""
    tcp_offset: Pose | None = None
    """Pose of the tool centre point in that tool's frame, [x y z Rz Ry Rx]; the offset frame is then the tool `tcp`."""
    feet: str | None = None
    """Feet of a legged robot: a kind of feet of its `robot.yaml`, such as spheres_C or soles."""
    mass_factors: dict[str, Positive] = Field(default_factory=dict)
    """Factors on the masses of links in the URDF, {chest: 1.05}; moments of inertia grow by the same factor."""
    drives: Drives | None = None
    """Motors, gears and friction; values that are not given are those of the robot's own file."""
    servo: ServoConfig | None = None
    """This robot's servos, in place of the station's."""
    reference: ReferenceConfig | None = None
    """This robot's reference, in place of the station's."""
    joint_stops: JointStops | None = None
    """This robot's end stops, in place of the station's."""

    @model_validator(mode="after")
    def _one_origin(self) -> "RobotConfig":
        """Check that the robot comes either from a model or from a URDF, and that import options belong to a URDF.

        Raises:
            ValueError: both keys are given, or neither, or the options without a URDF.
        """
        # True if both are given, and if neither is.
        if (self.model is None) == (self.urdf is None):
            raise ValueError(
                message("stations.model_or_urdf", "a robot needs either model or urdf, not both")
            )
        if self.urdf is None and self.import_options is not None:
            raise ValueError(
                message("stations.options_go_with_urdf", "import_options needs the key urdf")
            )
        return self


class FloorConfig(Strict):
    """A square floor around the world's origin, its top at z = 0 there."""

    size: Positive = 3.0
    """Length of a side [m]."""
    incline_deg: Annotated[Number, Field(ge=0, le=45)] = 0.0
    """Inclination of the floor [deg]; robots on their own feet are put upright on it."""
    heading_deg: Number = 0.0
    """Direction in which the floor rises, counterclockwise from the world's x [deg]."""
    terrain: Terrain | None = None
    """A field of uneven ground on the floor; by default the floor is even."""


NAME_OF_ONLY_ROBOT = "robot"
"""Name of the robot of a station that has the section ``robot:`` instead of ``robots:``."""


class StationConfig(Renamed):
    """Configuration of a whole station. Written to YAML and loaded again, it is equal."""

    renamed: ClassVar[Mapping[str, str]] = {
        "external_force": message(
            "stations.hand_renamed",
            "one of forces: {{hand: {{kind: sine, at: tool0, amplitude: [0, 0, 5], frequency: 1}}}}",
        )
    }

    @model_validator(mode="before")
    @classmethod
    def _refuse_keys_of_robots(cls, content: Any) -> Any:
        """Refuse a key that belongs to a robot, such as `drives`, with the key under which it is to be written.

        Raises:
            ValueError: there is such a key. Other unknown keys are refused later.
        """
        # Other types are refused by pydantic, with a message of their own.
        if isinstance(content, dict):
            for key in content:
                if key in RobotConfig.model_fields and key not in cls.model_fields:
                    raise ValueError(
                        message(
                            "stations.key_of_robot",
                            "{key} is a key of a robot: write robot.{key}, or robots.NAME.{key} in a station with "
                            "several robots",
                            key=key,
                        )
                    )
        return content

    name: FileName
    """Name of the station in results and pictures; by default that of the file."""
    description: str = ""
    """Description of the station in one line, for lists."""
    extensions: tuple[str, ...] = ()
    """Packages whose extensions the station needs, such as `simrob-playground`; an error names a package that is
    missing."""
    packages: dict[str, Path] = Field(default_factory=dict)
    """Folders of ROS packages by name, for paths such as `package://arm_description/urdf/arm.urdf`; further packages
    are found around the file, with `--mesh-path` and in `ROS_PACKAGE_PATH`."""
    add_directives: tuple[Path, ...] = ()
    """Files with model directives or scenarios of Drake, whose models become robots and pieces of the station; keys of
    the station's own replace those of the files. `FILE#NAME` is the scenario NAME of a file with several."""
    mode: Literal["dynamic", "kinematic"] = "dynamic"
    """`dynamic`: forces and torques move the robots. `kinematic`: the motion is the input, and the torques are
    computed."""
    robots: dict[str, RobotConfig] = Field(default_factory=dict)
    """The robots by name; a single robot may be given under `robot` instead."""
    pieces: dict[str, PieceConfig] = Field(default_factory=dict)
    """Pieces by name: those that robots carry, those that are fixed, and those that are free to move."""
    servo: ServoConfig = default_of(ServoConfig)
    """The joint servos of all robots that have none of their own."""
    reference: ReferenceConfig = default_of(Hold, kind="hold")
    """Desired motion of all robots that have no reference of their own."""
    prescribed: dict[str, ReferenceConfig] = Field(default_factory=dict)
    """Axes of a dynamic station that follow a given motion exactly, while forces move everything else, by name
    (<robot>.<axis> if there are several robots). The torque of such an axis is computed."""
    inputs: tuple[Input, ...] = ()
    """Input ports in addition to `reference`."""
    floor: FloorConfig | None = None
    """The floor; a station without this section has none."""
    contact: ContactConfig | None = None
    """Contact between bodies; without this section they pass through each other."""
    joint_stops: JointStops = default_of(JointStops)
    """Springs that hold joints at their limits, if the solver does not."""
    gravity: Annotated[Number, Field(ge=-1e4, le=1e4)] = STANDARD_GRAVITY
    """Gravity along -z [m/s²]."""
    solver: SolverConfig = default_of(ContinuousSolver, kind="continuous")
    """Solver of a dynamic station."""
    couplings: Couplings = Field(default_factory=dict)
    """Couplings between axes or bodies in addition to the joints, by name: gears, rods, springs; an entry named after
    its kind needs no `kind`."""
    forces: Forces = Field(default_factory=dict)
    """External forces on the robots, by name; an entry named after its kind needs no `kind`."""
    sensors: Sensors = Field(default_factory=dict)
    """Sensors by name; an entry named after its kind needs no `kind`."""
    monitors: Monitors = Field(default_factory=dict)
    """Conditions that end the run, by name; an entry named after its kind needs no `kind`."""
    controllers: Controllers = Field(default_factory=dict)
    """Control loops around the servos, by name."""
    program: dict[str, Any] | None = None
    """Program of the robots when the station is run as a whole, in place of their references: the content of a
    program's file, or the path of one."""
    verdict: VerdictConfig = default_of(VerdictConfig)
    """Bounds of the criteria by which a run is judged; a value beyond its bound is a warning."""
    start: Path | None = None
    """State at the start: the `start.json` of a result, in place of the initial postures; relative paths start at the
    station's file."""
    duration: Duration = 3.0
    """Simulated time [s]."""
    sample_rate: Positive = Field(default=100.0, le=FASTEST_RATE)
    """Samples of the signals per second [Hz]; at most 10 kHz, and a million samples in all."""

    def __repr__(self) -> str:
        """Summary in one line. :meth:`to_yaml` has the whole configuration."""
        robots = ", ".join(
            f"{name} ({robot.model or robot.urdf})" for name, robot in self.robots.items()
        )
        pieces = f", pieces {', '.join(self.pieces)}" if self.pieces else ""
        return f"<StationConfig {self.name}, {self.mode}, {self.duration:g} s: {robots or 'no robot'}{pieces}>"

    __str__ = __repr__

    def to_content(self, *, only: Mapping[str, Any] | None = None) -> dict[str, Any]:
        """Convert the configuration to the content of a station's file: nested dicts and lists, without keys of None.

        Args:
            only: keys to convert, as pydantic's ``include``; all by default. An only robot named ``robot`` is under
                ``robot`` if all keys are converted, otherwise under ``robots``.
        """
        content = self.model_dump(mode="json", exclude_none=True, include=only)
        # The short form, as most users write it.
        if only is None and list(self.robots) == [NAME_OF_ONLY_ROBOT]:
            content["robot"] = content.pop("robots")[NAME_OF_ONLY_ROBOT]
        return content

    def to_yaml(self, *, only: Mapping[str, Any] | None = None) -> str:
        """Write the configuration as the text of a station's file. Loading a whole text gives an equal configuration.

        Args:
            only: keys to write, as pydantic's ``include``; all by default.
        """
        content = self.to_content(only=only)
        return yaml.safe_dump(
            content, sort_keys=False, allow_unicode=True, width=120, default_flow_style=None
        )

    def _repr_html_(self) -> str:
        """HTML for notebooks: the summary, and the whole configuration as YAML to unfold."""
        return (
            f"<details><summary>{escape(repr(self))}</summary>"
            f"<pre>{escape(self.to_yaml())}</pre></details>"
        )

    @model_validator(mode="after")
    def _can_be_computed(self) -> "StationConfig":
        """Check the size of a run, see `check_effort`."""
        # Checked with the file: a run that is too large would fail only after its memory is full.
        check_effort(self)
        return self

    @field_validator(
        "robots", "pieces", "sensors", "monitors", "couplings", "forces", "controllers"
    )
    @classmethod
    def _check_names(cls, entries: dict[str, Any]) -> dict[str, Any]:
        """Check that the names of a section's entries are plain, and return the same entries.

        Raises:
            ValueError: a name is not plain: see :func:`check_plain`.
        """
        # The names become parts of the names of ports, columns and files.
        for name in entries:
            check_plain(name)
        return entries

    @model_validator(mode="after")
    def _check_keys_of_files(self) -> "StationConfig":
        """Refuse the keys ``packages`` and ``add_directives``, which `load_station` replaces before this check.

        Raises:
            ValueError: one of these keys has a value.
        """
        if self.packages or self.add_directives:
            raise ValueError(
                message(
                    "stations.keys_of_files",
                    "packages and add_directives are keys of a station's file; load_station replaces them by robots "
                    "and pieces",
                )
            )
        return self

    @field_validator("pieces")
    @classmethod
    def _add_scattered_copies(cls, entries: dict[str, PieceConfig]) -> dict[str, PieceConfig]:
        return with_scattered_copies(entries)

    @property
    def only_robot(self) -> str | None:
        """The name of the station's robot if it has one only; then ports and columns carry no prefix."""
        return next(iter(self.robots)) if len(self.robots) == 1 else None

    def prefix(self, robot: str) -> str:
        """Prefix of the names of a robot's ports, blocks and columns; empty for the only robot of a station."""
        return "" if self.only_robot else f"{robot}."

    def robot_key(self, robot: str) -> str:
        """Dotted key of the section of a robot: ``robot``, or ``robots.<name>``."""
        # An only robot with a name of its own is under `robots`, too.
        has_short_form = list(self.robots) == [NAME_OF_ONLY_ROBOT]
        return NAME_OF_ONLY_ROBOT if has_short_form else f"robots.{robot}"

    @property
    def free_pieces(self) -> list[str]:
        """Names of the free pieces, which only contact and gravity move."""
        return [name for name, piece in self.pieces.items() if piece.free]

    @property
    def engine(self) -> Engine:
        """The engine that moves the station: its reference if the station is kinematic, otherwise its solver."""
        return KINEMATIC if self.mode == "kinematic" else self.solver.engine

    @property
    def has_contact_forces(self) -> bool:
        """Whether bodies that touch push each other."""
        return self.contact is not None and self.engine.moves_by_forces

    def servo_of(self, robot: str) -> ServoConfig:
        """Return a robot's own servo section, or the station's."""
        return self.robots[robot].servo or self.servo

    def motors_are_dampers(self, robot: str) -> bool:
        """Whether dampers of Drake's joints realize the torque lines of a robot's motors, if it has motor models.

        The torque of a motor falls with its speed along a line. Servos in the plant's actuators, or an engine that
        limits torques there, cannot compute this fall; a damper of the joint can. Some engines, such as MuJoCo, allow
        no such dampers.
        """
        engine = self.engine
        # In a kinematic station no motor gives a torque.
        if not (engine.moves_by_forces and engine.allows_dampers_of_motors):
            return False
        return self.servo_of(robot).realization == "implicit" or engine.limits_torques_in_actuators

    def follows_speed(self, robot: str) -> bool:
        """Whether the desired speed is an input of a robot, so that samples of positions must be joined smoothly."""
        # A kinematic station takes the speeds as inputs, as its inverse dynamics needs them.
        speed_is_input = not self.engine.moves_by_forces or "reference_velocity" in self.inputs
        return speed_is_input or self.servo_of(robot).follows_motion

    def reference_of(self, robot: str) -> ReferenceConfig:
        """Return a robot's own reference section, or the station's."""
        return self.robots[robot].reference or self.reference

    def stops_of(self, robot: str) -> JointStops:
        """Return a robot's own joint stops, or the station's."""
        return self.robots[robot].joint_stops or self.joint_stops


def check_effort(config: StationConfig) -> None:
    """Check that a station can be built and run with the memory and the time of a computer.

    Raises:
        InvalidParameter: there are too many pieces, too many samples of signals or of a sensor, too many steps of a
            solver, or too many samples in the delay of a sensor. The bounds are the constants at the top of the module.
    """
    # Free pieces first: their bound is the smaller one.
    if len(config.free_pieces) > MOST_FREE_PIECES:
        found = message(
            "stations.with_free_pieces", "{count} free pieces", count=len(config.free_pieces)
        )
        raise InvalidParameter(
            "pieces",
            found,
            message(
                "stations.most_free_pieces",
                "at most {most} pieces with free: true",
                most=MOST_FREE_PIECES,
            ),
        )
    if len(config.pieces) > MOST_PIECES:
        raise InvalidParameter(
            "pieces",
            message("stations.count_of_pieces", "{count} pieces", count=len(config.pieces)),
            message("stations.at_most", "at most {most}", most=MOST_PIECES),
        )
    duration = config.duration
    rate = config.sample_rate
    solver = config.solver
    if duration * rate > MOST_SAMPLES:
        longest = message(
            "stations.longest_duration",
            "at most {longest:g} s at a sample_rate of {rate:g} Hz ({samples:g} samples)",
            longest=MOST_SAMPLES / rate,
            rate=rate,
            samples=MOST_SAMPLES,
        )
        raise InvalidParameter("duration", compound("{duration:g} s", duration=duration), longest)
    # A kinematic station integrates nothing, so the step of a solver does not matter there.
    if config.engine.moves_by_forces and duration > MOST_STEPS * solver.step:
        shortest = message(
            "stations.shortest_step",
            "at least {shortest:g} s for a duration of {duration:g} s ({steps:g} steps)",
            shortest=duration / MOST_STEPS,
            duration=duration,
            steps=MOST_STEPS,
        )
        raise InvalidParameter(
            f"solver.{solver.step_key}", compound("{step:g} s", step=solver.step), shortest
        )
    for name, sensor in config.sensors.items():
        # Only sampled sensors have a rate; the others count as never sampled.
        sensor_rate = getattr(sensor, "rate", None) or 0.0
        if duration * sensor_rate > MOST_STEPS:
            most = message(
                "stations.largest_rate",
                "at most {rate:g} Hz for a duration of {duration:g} s ({samples:g} samples)",
                rate=MOST_STEPS / duration,
                duration=duration,
                samples=MOST_STEPS,
            )
            raise InvalidParameter(
                f"sensors.{name}.rate", compound("{rate:g} Hz", rate=sensor_rate), most
            )
        delay = getattr(sensor, "delay", 0.0)
        # The block of a sensor keeps every sample that is on its way.
        if delay * sensor_rate > MOST_LATE:
            most = message(
                "stations.largest_delay",
                "at most {delay:g} s at a rate of {rate:g} Hz ({samples:g} samples)",
                delay=MOST_LATE / sensor_rate,
                rate=sensor_rate,
                samples=MOST_LATE,
            )
            raise InvalidParameter(
                f"sensors.{name}.delay", compound("{delay:g} s", delay=delay), most
            )
