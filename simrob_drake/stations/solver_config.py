"""How a station's time advances: an error-controlled continuous scheme, or fixed discrete steps."""

from typing import Annotated, Literal, Self

from pydantic import Field

from simrob_drake.sections import Boolean, Positive, Strict

TIGHTER = 10.0
"""How much tighter `simrob run --converge` reruns."""

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
FIXED_STEP_SCHEMES = ("explicit_euler", "semi_explicit_euler", "runge_kutta2", "radau1")
"""Continuous schemes of Drake without error control: they take steps of ``max_step``."""


class ContinuousSolver(Strict):
    """One of Drake's integrators of continuous time."""

    kind: Literal["continuous"]
    scheme: ContinuousScheme = "radau3"
    """Drake's name of the integrator: radau3 for stiff servos, cenic for contacts, runge_kutta3 for single impacts."""
    accuracy: Positive = 1e-2
    """Relative error that one step may have."""
    max_step: Positive = 0.1
    """Longest step [s]."""
    error_control: Boolean = True
    """Steps as short as the accuracy asks for. Without it each is max_step long: a third of the work with cenic, which
    stays stable, but nothing looks after impacts."""

    def tighter(self, factor: float = TIGHTER) -> Self:
        """Return the same scheme with accuracy and step divided by ``factor``."""
        return self.model_copy(update={"accuracy": self.accuracy / factor, "max_step": self.max_step / factor})

    @property
    def holds_joint_limits(self) -> bool:
        """Whether the scheme itself keeps joints within their limits; the others need stop forces."""
        return self.scheme == "cenic"

    @property
    def sees_inputs(self) -> bool:
        """Whether what drives the plant counts as it changes within a step; ``cenic`` takes it as at the start."""
        return self.scheme != "cenic"

    @property
    def fixed_steps(self) -> bool:
        """Whether every step is ``max_step`` long."""
        return not self.error_control or self.scheme in FIXED_STEP_SCHEMES


class FixedSteps(Strict):
    """Steps of one length, contacts and joint limits within them."""

    time_step: Positive = 1e-3
    """Length of a step [s]."""

    def tighter(self, factor: float = TIGHTER) -> Self:
        """Return the same solver with its step divided by ``factor``."""
        return self.model_copy(update={"time_step": self.time_step / factor})

    @property
    def holds_joint_limits(self) -> bool:
        """Discrete solvers keep joints within their limits."""
        return True

    @property
    def sees_inputs(self) -> bool:
        """Discrete solvers take what drives the plant as it is at the start of a step."""
        return False


class DiscreteSolver(FixedSteps):
    """Drake's discrete contact solvers with fixed steps."""

    kind: Literal["discrete"]
    scheme: Literal["sap", "lagged", "similar"] = "sap"
    """Drake's contact approximation; sap always converges, and does not know dissipation."""


class MujocoSolver(FixedSteps):
    """MuJoCo in the place of Drake's plant, its servos and contacts in one implicit step (extra `mujoco`)."""

    kind: Literal["mujoco"]
    time_step: Positive = 2e-3
    """Length of a step [s]."""

    @property
    def scheme(self) -> str:
        """What it is called among Drake's."""
        return "mujoco"


SolverConfig = Annotated[ContinuousSolver | DiscreteSolver | MujocoSolver, Field(discriminator="kind")]
