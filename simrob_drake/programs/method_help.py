"""What help shows of the methods of an arm that run what a function plans: all that the call takes."""

from collections.abc import Callable
from inspect import Parameter, Signature, getdoc, signature
from typing import Any

from simrob_drake.programs.plan import CHECKED, Plan
from simrob_drake.programs.timing import How


def describe(method: Callable[..., Any], plan: Callable[..., Plan]) -> None:
    """Let help tell of a method what its function takes, with the keys of :class:`How` one by one."""
    text, attributes = getdoc(plan) or "", (getdoc(How) or "").partition("Attributes:\n")[2]
    text = text.replace("    planning: what the move starts from.\n", "")
    method.__doc__ = text.replace("    how: see :class:`How`.", attributes.rstrip())
    method.__name__ = plan.__name__.removeprefix("plan_")
    _, *own, _ = signature(plan).parameters.values()
    options = [
        Parameter(key, Parameter.KEYWORD_ONLY, default=CHECKED if key == "check" else None, annotation=kind)
        for key, kind in How.__annotations__.items()
    ]
    arm = Parameter("self", Parameter.POSITIONAL_ONLY)
    vars(method)["__signature__"] = Signature([arm, *own, *options], return_annotation="SimulationResult")
