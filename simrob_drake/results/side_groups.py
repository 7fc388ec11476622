"""Axes that belong in one plot: the right and the left one of a joint."""

from __future__ import annotations

from dataclasses import dataclass

from simrob_drake.frames import Vector
from simrob_drake.results.panels import Curve
from simrob_drake.stations.robots import StationRobot

_COLOURS = {"right": "#1f6fb4", "left": "#4d9221", "middle": "0.35"}
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
            Curve(values[:, place], side or label, _COLOURS.get(side, colour)) for side, place in self.places.items()
        ]


def side_groups(robot: StationRobot) -> list[SideGroup]:
    """Return a robot's axes in their order, right and left ones together at the place of the first."""
    axes, units = robot.axes, robot.model.unit_names
    groups: dict[str, dict[str, int]] = {}
    for place, axis in enumerate(axes):
        words = axis.split("_")
        pair = {side: "_".join(side if word in _SIDES else word for word in words) for side in _SIDES}
        places = {side: axes.index(name) for side, name in pair.items() if name in axes}
        if len(places) == 2 and len(set(places.values())) == 2 and len({units[at] for at in places.values()}) == 1:
            groups["_".join(word for word in words if word not in _SIDES)] = places
        else:
            groups[axis] = {"": place}
    has_sides = any(len(places) == 2 for places in groups.values())
    return [
        SideGroup(name, {"middle": places[""]} if has_sides and len(places) == 1 else places)
        for name, places in groups.items()
    ]
