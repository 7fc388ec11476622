"""Axes that belong in one plot: the right and the left one of a joint."""

from __future__ import annotations

from dataclasses import dataclass, replace

from simrob_drake.frames import Vector
from simrob_drake.parts.site import StationRobot
from simrob_drake.results.plots.panels import Curve

_COLOURS = {"right": "#4f9bd9", "left": "#35721b", "middle": "0.35"}
_WEIGHTS = {"right": 1.5, "left": 0.8}  # so that both are seen where they are equal
_SIDES = ("right", "left")


@dataclass(frozen=True)
class SideGroup:
    """An axis, or the right and the left one of a name.

    Attributes:
        name: without the sides, if both are there.
        places: in the robot's axes, by side; an axis alone has the side "middle" where others have two, else "".
    """

    name: str
    places: dict[str, int]

    @property
    def first(self) -> int:
        """The place of one of the axes, which have their unit in common."""
        return next(iter(self.places.values()))

    def curves(self, values: Vector, label: str, colour: str) -> list[Curve]:
        """Return the curves of the group's columns in values (m, n); label and colour hold where there are no sides."""
        return [
            Curve(values[:, place], side or label, _COLOURS.get(side, colour), _WEIGHTS.get(side, 1.0))
            for side, place in self.places.items()
        ]


def side_groups(robot: StationRobot) -> list[SideGroup]:
    """Return a robot's axes in their order, right and left ones together at the place of the first."""
    axes, units = robot.axes, robot.model.unit_names
    groups = []
    for place, axis in enumerate(axes):
        words = axis.split("_")
        names = {side: "_".join(side if word in _SIDES else word for word in words) for side in _SIDES}
        places = {side: axes.index(name) for side, name in names.items() if name in axes}
        if len(set(places.values())) < 2 or len({units[at] for at in places.values()}) > 1:
            groups.append(SideGroup(axis, {"": place}))
        elif place == min(places.values()):
            groups.append(SideGroup("_".join(word for word in words if word not in _SIDES), places))
    if all(len(group.places) == 1 for group in groups):
        return groups
    return [replace(group, places={"middle": group.places[""]}) if "" in group.places else group for group in groups]
