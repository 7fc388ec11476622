"""Fields for numbers, which refuse in words what is beyond their limits."""

from math import inf
from typing import Any

from nicegui import ui

from simrob_drake.teach.pages.buttons import told
from simrob_drake.teach.pages.phrases import figure
from simrob_drake.teach.pages.words import Words

_SLACK = 1e-6
"""How far beyond a limit a number may be that was made of another one."""


class NumberField:
    """A field for a number.

    Attributes:
        field: as the page has it.
    """

    def __init__(
        self,
        t: Words,
        label: str,
        value: float | None,
        *,
        low: float = -inf,
        high: float = inf,
        unit: str = "",
        step: float = 1.0,
        whole: bool = False,
        titled: bool = True,
    ) -> None:
        """Build it in the present place.

        Args:
            t: the words.
            label: what it is; shown with it only if ``titled``.
            value: at first.
            low: smallest that is taken.
            high: largest.
            unit: behind it.
            step: of its arrows.
            whole: whether it takes whole numbers alone.
            titled: see ``label``.
        """
        self._t, self._low, self._high, self._unit, self._whole = t, low, high, unit, whole
        self.field = ui.number(label if titled else None, value=value, step=step, suffix=unit.strip() or None)
        self.field.props("dense outlined hide-bottom-space no-error-icon").validation = self.problem
        told(self.field, label)

    @property
    def value(self) -> float | None:
        """What it holds; None where that is nothing or refused, as it says in the field."""
        value = self.field.value
        if value is None or self.problem(value) is not None:
            return None
        return int(value) if self._whole else float(value)

    def needed(self) -> float | None:
        """Return what it holds; where that is nothing or refused, None, and the user is taken there."""
        if self.value is None:
            self.field.error = self.problem(self.field.value) or self._t("legs.number_needed")
            self.field.run_method("focus")
        return self.value

    def problem(self, value: Any) -> str | None:
        """Return what is wrong with a value, if anything is."""
        within = value is None or self._low - _SLACK <= value <= self._high + _SLACK
        if within and not (self._whole and value is not None and value % 1):
            return None
        low, high = (f"{figure(limit)}{self._unit}" for limit in (self._low, self._high))
        return self._t("legs.whole_limits" if self._whole else "legs.limits", low=low, high=high)
