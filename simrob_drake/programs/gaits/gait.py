"""What every kind of gait declares, and what several have in common."""

from abc import abstractmethod
from collections.abc import Mapping
from typing import Annotated, Any, ClassVar, Self

from pydantic import Field

from simrob_drake.arguments import number
from simrob_drake.errors import UnknownName
from simrob_drake.programs.gaits.motion import JointMotion
from simrob_drake.programs.gaits.walker import Walker
from simrob_drake.robots.axis_map import AxisValues
from simrob_drake.robots.catalog import RobotModel
from simrob_drake.sections import Integer, NotNegative, Number, Strict, validated
from simrob_drake.walking.parameters import REACTING, Bearing

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
            others = [f"{other} ({section})" for section in sections for other in file.section(section)]
            raise UnknownName(f"gait of {walker.model.name} under {cls.section}", name, known or others)
        found = validated(cls, dict(known[name]), f"{file.file}: {cls.section}.{name}")
        return found.changed(changes, amplitude, name)

    def changed(self, changes: Mapping[str, Any], amplitude: float, name: str) -> Self:
        """Return it with changes, scaled by an amplitude; raises InvalidParameter, InvalidConfig: what cannot be."""
        amplitude = number(amplitude, "amplitude")
        scaled = {key: amplitude * value for key in self.scaled if (value := getattr(self, key, 0.0))}
        return validated(type(self), {**self.model_dump(exclude_unset=True), **scaled, **changes}, f"gait {name}")

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
    """EvenSteps in which the step length grows at the start and shrinks at the end, which go in addition."""
    settle: Pace = 0.6
    """Time to shift the weight at the start and at the end [s]."""
