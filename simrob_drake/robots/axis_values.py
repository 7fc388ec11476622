"""Figures of a robot's axes, as files and callers give them."""

from collections.abc import Callable
from typing import Annotated

from pydantic import AfterValidator

from simrob_drake.sections import Number

AxisValues = Number | list[Number] | dict[str, Number]
"""One number for all axes, a list in axis order, or a mapping by axis name or alias."""


def every_axis(accepts: Callable[[float], bool], meaning: str) -> AfterValidator:
    """Check every number of values per axis; ``meaning`` says which are accepted."""

    def checked(values: AxisValues) -> AxisValues:
        listed = values.values() if isinstance(values, dict) else values if isinstance(values, list) else [values]
        if not all(map(accepts, listed)):
            raise ValueError(meaning)
        return values

    return AfterValidator(checked)


NotNegativeAxisValues = Annotated[AxisValues, every_axis(lambda value: value >= 0, "it must not be negative")]
PositiveAxisValues = Annotated[AxisValues, every_axis(lambda value: value > 0, "it must be positive")]
