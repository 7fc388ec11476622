"""The sections ``solver``, ``contact`` and ``verdict`` of a station's file.

A *scheme* is an integrator or a discrete solver of Drake, by its name. An `Engine` describes what a scheme, or an
engine of an extension, can do: other modules read its properties and compare no names of schemes.
"""

from abc import ABC, abstractmethod
from dataclasses import replace
from typing import Annotated, Any, Literal, Self

from pydantic import (
    ConfigDict,
    Field,
    GetJsonSchemaHandler,
    ModelWrapValidatorHandler,
    ValidationError,
    model_validator,
)
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import CoreSchema, InitErrorDetails

from simrob_drake.base.extension import usable_objects
from simrob_drake.base.messages import message
from simrob_drake.base.sections import Boolean, NotNegative, Number, Positive, Strict
from simrob_drake.parts.engine import Engine
from simrob_drake.parts.kinds import Kinds

TIGHTER = 10.0  # how much tighter `simrob run --converge` reruns

ContinuousScheme = Literal[
    "cenic",
    "radau3",
    "implicit_euler",
    "runge_kutta3",
    "runge_kutta5",
    "bogacki_shampine3",
    "velocity_implicit_euler",
    "radau1",
    "runge_kutta2",
    "explicit_euler",
    "semi_explicit_euler",
]
DiscreteScheme = Literal["sap", "lagged", "similar"]


def _implicit(name: str, *, has_fixed_steps: bool = False) -> Engine:
    """Describe an implicit integrator of Drake."""
    return Engine(name=name, holds_stiff_springs=True, has_fixed_steps=has_fixed_steps)


def _explicit(name: str, *, has_fixed_steps: bool = False) -> Engine:
    """Describe an explicit integrator of Drake."""
    return Engine(name=name, is_explicit=True, has_fixed_steps=has_fixed_steps)


# Schemes with fixed steps are those of Drake without an estimate of the error.
CONTINUOUS_SCHEMES = {
    # A convex problem in each step, with contacts, joint limits and gears as constraints. Forces of other blocks are
    # linearised at the start of the step.
    "cenic": Engine(
        name="cenic",
        needs_plant_as_direct_child=True,
        holds_joint_limits=True,
        constrains_gears=True,
        constrains_many_axes=False,
        constrains_in_plant=True,
        holds_inputs_over_steps=True,
        limits_torques_in_actuators=True,
        puts_friction_in_actuators=False,
        reports_forces_of_joints=False,
        reports_friction_of_contacts=False,
        takes_any_contact_stiffness=True,
    ),
    "radau3": _implicit("radau3"),
    "implicit_euler": _implicit("implicit_euler"),
    "velocity_implicit_euler": _implicit("velocity_implicit_euler"),
    "radau1": _implicit("radau1", has_fixed_steps=True),
    "runge_kutta3": _explicit("runge_kutta3"),
    "runge_kutta5": _explicit("runge_kutta5"),
    "bogacki_shampine3": _explicit("bogacki_shampine3"),
    "runge_kutta2": _explicit("runge_kutta2", has_fixed_steps=True),
    "explicit_euler": _explicit("explicit_euler", has_fixed_steps=True),
    "semi_explicit_euler": _explicit("semi_explicit_euler", has_fixed_steps=True),
}
"""Drake's integrators of continuous time, by name. A further one is one entry here, and in `ContinuousScheme`."""


def _discrete(name: str) -> Engine:
    """Describe a discrete solver of Drake, by the name of its approximation of contacts.

    The step length is left at its default: the section ``solver`` replaces it by its own.
    """
    return Engine(
        name=name,
        has_fixed_steps=True,
        holds_joint_limits=True,
        constrains_gears=True,
        constrains_bodies=True,
        constrains_in_plant=True,
        takes_any_contact_stiffness=True,
        actuator_torques_lack_friction=True,
        has_static_friction=False,
    )


DISCRETE_SCHEMES = {
    # The convex problem of `sap` regularises contact: stiff contacts become softer, and friction holds too much.
    "sap": replace(
        _discrete("sap"),
        softens_contacts=True,
        has_contact_dissipation=False,
        has_realistic_grip=False,
    ),
    "lagged": _discrete("lagged"),
    "similar": _discrete("similar"),
}
"""Drake's discrete solvers, by the name of their approximation of contacts."""


class SolverSection(Strict, ABC):
    """A section ``solver``: the base class of all kinds."""

    kind: str

    @property
    @abstractmethod
    def engine(self) -> Engine:
        """Properties of the engine that this solver makes, see `Engine`."""

    @abstractmethod
    def tighter(self, factor: float = TIGHTER) -> Self:
        """Copy the solver, with steps and errors divided by a factor."""

    @property
    @abstractmethod
    def step_key(self) -> str:
        """Key that holds the length of the steps."""

    @property
    def step(self) -> float:
        """Length of a step, or of the longest one [s]."""
        return float(getattr(self, self.step_key))


class ContinuousSolver(SolverSection):
    """One of Drake's integrators of continuous time."""

    kind: Literal["continuous"]
    scheme: ContinuousScheme = "radau3"
    """Drake's name of the integrator: radau3 for stiff servos, cenic for contacts, runge_kutta3 for single impacts."""
    accuracy: Positive = 1e-2
    """Largest relative error of one step."""
    max_step: Positive = 0.1
    """Longest step [s]."""
    error_control: Boolean = True
    """Whether the solver shortens its steps to keep the accuracy. Without error control each step is max_step long: a
    third of the work with cenic, which stays stable, but impacts are not resolved."""

    @property
    def engine(self) -> Engine:
        """Properties of the scheme, see `Engine`. Without error control its steps have the same length."""
        known = CONTINUOUS_SCHEMES[self.scheme]
        # Without error control all steps are max_step long, so that checks treat the scheme as one
        # of fixed steps.
        return known if self.error_control else replace(known, has_fixed_steps=True)

    @property
    def step_key(self) -> str:
        """Key that holds the length of the longest step."""
        return "max_step"

    def tighter(self, factor: float = TIGHTER) -> Self:
        """Copy the solver, with its accuracy and its longest step divided by ``factor``."""
        # Both, since either may be what limits the steps.
        changes = {"accuracy": self.accuracy / factor, "max_step": self.max_step / factor}
        return self.model_copy(update=changes)


class DiscreteSolver(SolverSection):
    """Drake's discrete contact solvers with fixed steps."""

    kind: Literal["discrete"]
    time_step: Positive = 1e-3
    """Length of a step [s]."""
    scheme: DiscreteScheme = "sap"
    """Drake's contact approximation; sap always converges, and ignores dissipation."""

    @property
    def engine(self) -> Engine:
        """Properties of the scheme, see `Engine`, with the length of its steps."""
        return replace(DISCRETE_SCHEMES[self.scheme], time_step=self.time_step)

    @property
    def step_key(self) -> str:
        """Key that holds the length of the steps."""
        return "time_step"

    def tighter(self, factor: float = TIGHTER) -> Self:
        """Copy the solver, with its step divided by ``factor``."""
        return self.model_copy(update={"time_step": self.time_step / factor})


SOLVERS = Kinds(
    __name__,
    {"continuous": "ContinuousSolver", "discrete": "DiscreteSolver"},
    base=SolverSection,
    base_of_extensions="simrob_drake.stations.other_engine:OtherEngine",
    point="engines",
)
"""The kinds of the section ``solver``. Extensions add engines that stand in for Drake's plant."""
SolverConfig = Annotated[SolverSection, SOLVERS]


class Friction(Strict):
    """Coulomb friction of a surface."""

    static: NotNegative = 1.0
    """Coefficient of friction of surfaces that stick to each other."""
    dynamic: NotNegative = 0.9
    """Coefficient of friction of surfaces that slide; not above the static one."""

    @model_validator(mode="after")
    def _check_dynamic_is_not_more(self) -> "Friction":
        """Check that the coefficient of sliding is not above that of sticking.

        Raises:
            ValueError: the coefficient of sliding is above.
        """
        # A body that begins to slide would otherwise be held back more than before.
        if self.dynamic > self.static:
            raise ValueError(
                message(
                    "stations.dynamic_over_static",
                    "dynamic friction ({dynamic:g}) must not be more than static friction ({static:g})",
                    dynamic=self.dynamic,
                    static=self.static,
                )
            )
        return self


class ContactMaterial(Strict):
    """Material of a surface. Values that are not given come from the shape's own file, or from Drake."""

    stiffness: Positive | None = None
    """Stiffness of a point contact [N/m]. That of two surfaces is the harmonic mean, 2 k1 k2 / (k1 + k2), so that two
    equal values give the same value. (Drake takes the springs of two shapes in series; each gets twice the value
    here.)"""
    dissipation: NotNegative | None = None
    """Hunt and Crossley's d [s/m]: the force is k x (1 + d dx/dt). That of two surfaces is the mean, each weighted with
    the stiffness of the other surface. The solver scheme `sap` ignores it."""
    friction: Friction | None = None
    """Coulomb friction; the coefficient of two surfaces is 2 m1 m2 / (m1 + m2)."""
    hydroelastic_modulus: Positive | None = None
    """Pressure of a body that is pressed in to its middle [Pa], for the hydroelastic models; by default 1e7."""


class PieceContact(ContactMaterial):
    """Contact of a piece, in place of the station's section ``contact``."""

    model: Literal["point"] | None = None
    """`point`: the piece touches at points although the station's model is `hydroelastic_with_fallback`. Balls then
    roll without facets."""


class ContactConfig(ContactMaterial):
    """Contact between robots, pieces and floor. A station without this section has no contact.

    The material is that of all surfaces, also of the floor; a piece's own section `contact` replaces it.
    """

    model: Literal["point", "hydroelastic", "hydroelastic_with_fallback"] = "point"
    """`point`: springs at points. `hydroelastic`: pressure over surfaces, with a rigid floor."""
    corners: Boolean = True
    """Whether flat bodies also touch at their corners in point contact. Otherwise each pair of shapes touches only at
    its deepest point, so that a flat free body trembles and sticks."""
    self_collision: Boolean = False
    """Contact between the links of one robot."""
    stiction_speed: Positive = 1e-3
    """Speed up to which a contact counts as sticking [m/s]; with continuous solvers, sticking contacts slide at up to
    this speed."""
    resolution: Positive = 0.02
    """Length of the edges of hydroelastic surfaces [m]."""


Bound = NotNegative | Literal["none"]


def bound_value(bound: float | str) -> float:
    """Bound of a verdict as a number: infinite for ``none``."""
    # Infinity compares as a bound that nothing exceeds, so that callers need no special case.
    return float("inf") if isinstance(bound, str) else bound


class VerdictConfig(Strict):
    """Bounds of the criteria by which a run is judged, each with the name of its criterion; ``none`` is no bound.

    Further keys are bounds of the criteria of installed extensions.
    """

    model_config = ConfigDict(extra="allow")
    __pydantic_extra__: dict[str, Bound] = Field(init=False)

    final_error_deg: Bound = 3.0
    """Largest position error of a revolute axis at the end [deg]."""
    final_error_m: Bound = 0.005
    """Largest position error of a prismatic axis at the end [m]."""
    largest_error_deg: Bound = 30.0
    """Largest position error of a revolute axis during the run [deg]; a reference that jumps needs a larger bound."""
    largest_error_m: Bound = 0.05
    """Largest position error of a prismatic axis during the run [m]."""
    beyond_stop_deg: Bound = 1.0
    """Largest distance of a revolute axis beyond a limit of its range [deg]."""
    beyond_stop_m: Bound = 0.002
    """Largest distance of a prismatic axis beyond a limit of its range [m]."""
    torque_share: Bound = 1.05
    """Largest torque or force of an axis, as a share of its limit, or of the torque of its motor at that speed; in a
    kinematic station it may exceed 1."""
    torque_time: Bound = 0.05
    """Share of the run in which an axis is at its torque limit."""
    speed_share: Bound = 1.05
    """Largest speed of an axis, as a share of its motor's no-load speed or of the limit in its URDF."""
    speed_time: Bound = "none"
    """Share of the run in which an axis is beyond its speed limit."""
    rated_time: Bound = "none"
    """Share of the run in which a motor gives more than its rated torque."""
    heat: Bound = 1.0
    """Largest heating of a motor; 1 is the heating that its rated torque causes in the long run."""
    tcp_speed: Bound = 1.05
    """Largest speed of a tool centre point, as a share of its rated speed."""
    payload: Bound = 1.0
    """Mass of everything that a robot carries, as a share of its rated payload."""
    move_end: Bound = 0.002
    """Largest distance of an arm's tool from its target at the end of a move [m]."""
    move_following: Bound = 0.05
    """Largest distance of the tool from its planned position in a move [m]."""
    move_speed: Bound = "none"
    """Least share of the requested speed that the tool reaches in a move."""
    move_distance: Number | Literal["none"] = "none"
    """Least distance of the robot and its load from any other body in a move [m]."""
    below_floor: Bound = 0.005
    """Largest depth of tools in use, floating bases and free pieces below the ground [m]."""
    distance: Number | Literal["none"] = -0.005
    """Least distance that distance sensors measure [m]; below 0 two bodies overlap."""
    penetration: Bound = 0.005
    """Largest overlap of two bodies that touch [m]."""
    resting_force: Bound = 0.02
    """Largest difference between the vertical contact forces on a free piece at rest and its load (weight and applied
    forces), as a share of its weight."""
    friction_share: Bound = 1.05
    """Largest friction on a free piece, as a share of the friction that its coefficient allows."""
    lost_piece: Bound = 0.01
    """Largest distance, at the end, of a piece that slipped out of fingers from its place between them [m]."""
    coupling_gap: Bound = 0.005
    """Largest gap between the axes or bodies that a coupling holds together [m or rad]."""
    foot_slip: Bound = 0.02
    """Largest distance that a foot slides over the ground before it is lifted again [m]."""
    shortened_steps: Bound = 3.0
    """Count of steps that the solver repeats with a shorter length, per accepted step."""

    @model_validator(mode="wrap")
    @classmethod
    def _check_further_keys(
        cls,
        content: Any,
        check: ModelWrapValidatorHandler[Self],
    ) -> Self:
        """Check the content, and refuse keys that are neither fields nor bounds of measures of extensions.

        Args:
            content: content of the section.
            check: function of pydantic that checks all else.

        Raises:
            ValidationError: a key is unknown. It is the error of any section that has an unknown key.
        """
        # Pydantic allows all further keys here, since extensions are known at run time only.
        checked = check(content)
        further = checked.__pydantic_extra__
        if not further:  # as in most stations: to look for extensions would take time
            return checked
        known = _keys_of_extensions()
        unknown = [key for key in further if key not in known]
        if unknown:
            # Pydantic's own type of error, so that the message is that of any unknown key.
            errors = []
            for key in unknown:
                error = InitErrorDetails(type="extra_forbidden", loc=(key,), input=further[key])
                errors.append(error)
            raise ValidationError.from_exception_data(cls.__name__, errors)
        return checked

    @classmethod
    def __get_pydantic_json_schema__(
        cls,
        core: CoreSchema,
        handler: GetJsonSchemaHandler,
    ) -> JsonSchemaValue:
        """Make the JSON Schema of the section, with the bounds of measures of installed extensions among its keys.

        A measure is a number about a run, which the verdict compares with its bound.

        Args:
            core: description of the section by pydantic.
            handler: makes pydantic's own schema of it.
        """
        reference = super().__get_pydantic_json_schema__(core, handler)
        schema = handler.resolve_ref_schema(reference)
        # Pydantic allows any further key with a bound as its value. Only the known ones are to be allowed.
        bound = schema["additionalProperties"]
        schema["additionalProperties"] = False
        for key in sorted(_keys_of_extensions()):
            schema["properties"][key] = {
                **bound,
                "description": "Bound of a measure of an extension.",
            }
        return reference


def _keys_of_extensions() -> set[str]:
    """Keys of the section ``verdict`` that belong to measures (numbers about a run) of installed extensions."""
    keys = set[str]()
    # The class of measures, `Criterion`, cannot be imported here, since its module imports this one. An object of
    # another class has no keys, and the verdict reports it.
    for criterion in usable_objects("measures", object).values():
        keys.update(getattr(criterion, "bound_keys", ()))
    return keys
