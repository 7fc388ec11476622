"""Plots of a robot: its joints, right and left of a name together, its tool as asked and reached, and its walk."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from simrob_drake.base.frames import Vector, matrices_from_xyz_quaternions, poses_from_matrices
from simrob_drake.base.messages import compound, join_texts, message, translate
from simrob_drake.base.signals import QUANTITY_WORDS
from simrob_drake.parts.station_plant import StationRobot
from simrob_drake.results.colours import COLOURS, RED
from simrob_drake.results.plots.grid import (
    ERROR,
    ERROR_HEIGHT,
    REFERENCE,
    VALUE,
    Curve,
    Plot,
    Stack,
    dashed,
    grid_figure,
    style,
    trusted,
)
from simrob_drake.results.record.run import RecordedRun
from simrob_drake.results.record.walks import headings, tilts

_SIDES = {"right": (COLOURS[0], 1.5), "left": (COLOURS[2], 0.8), "middle": (COLOURS[7], 1.0)}
"""Colours and weights of lines, so that both sides are seen where they are equal."""
_SIDE_WORDS = {
    "right": message("results.right", "right"),
    "left": message("results.left", "left"),
    "middle": message("results.middle", "middle"),
}
_REFERENCE = message("results.reference", "reference")
_TOOL = message("results.tool_centre_point", "tool centre point")
_NEAR = 1.3  # a limit up to so many times the largest torque is drawn; one further away would flatten the curve
QUANTITIES = {
    "deg": QUANTITY_WORDS["position"],
    "m": QUANTITY_WORDS["position"],
    "N·m": QUANTITY_WORDS["torque"],
    "N": QUANTITY_WORDS["force"],
}
"""Quantities of joints by the unit in which they are shown."""


@dataclass(frozen=True, eq=False)
class SideGroup:
    """An axis, or the right and the left one of a name."""

    name: str  # without the sides, if both are there
    # in the robot's axes, by side; an axis alone has the side "middle" where others have two, else ""
    places: dict[str, int]

    @property
    def first(self) -> int:
        """The place of one of the axes, which have their unit in common."""
        return next(iter(self.places.values()))

    def curves(self, values: Vector, label: str, colour: str) -> list[Curve]:
        """Return the curves of the group's columns in values (m, n); label and colour hold where there are no sides."""
        return [
            Curve(values[:, place], _SIDE_WORDS.get(side, label), *_SIDES.get(side, (colour, 1.0)))
            for side, place in self.places.items()
        ]


def side_groups(robot: StationRobot) -> list[SideGroup]:
    """Return a robot's axes in their order, right and left ones together at the place of the first."""
    axes, units = robot.axes, robot.model.unit_names
    sides = ("right", "left")
    groups = []
    for place, axis in enumerate(axes):
        words = axis.split("_")
        names = {side: "_".join(side if word in sides else word for word in words) for side in sides}
        places = {side: axes.index(name) for side, name in names.items() if name in axes}
        if len(set(places.values())) < 2 or len({units[at] for at in places.values()}) > 1:
            groups.append(SideGroup(axis, {"": place}))
        elif place == min(places.values()):
            groups.append(SideGroup("_".join(word for word in words if word not in sides), places))
    if all(len(group.places) == 1 for group in groups):
        return groups
    return [replace(group, places={"middle": group.places[""]}) if "" in group.places else group for group in groups]


def position_stacks(result: RecordedRun, robot: StationRobot) -> list[Stack]:
    """Return each axis with its reference and, where there can be one, the error below."""
    reference, reached = (result.axes(signal, robot.name) / robot.model.user_units for signal in ("q_ref", "q"))
    with np.errstate(invalid="ignore"):  # a diverging run may end with infinite positions
        error = reference - reached
    stacks = []
    for group in side_groups(robot):
        unit = robot.model.unit_names[group.first]
        curves = group.curves(reached, QUANTITY_WORDS["position"], VALUE)
        curves += [dashed(reference[:, place], _REFERENCE, REFERENCE) for place in group.places.values()]
        plots = [Plot(_with_unit(QUANTITIES[unit], unit), curves)]
        if result.config.engine.moves_by_forces:
            label = message("results.error_of_position", "error: reference - position")
            errors = group.curves(error, label, ERROR)
            plots.append(Plot(_with_unit(_ERROR, unit), errors, ERROR_HEIGHT))
        stacks.append(Stack(group.name, plots))
    return stacks


def torque_stacks(result: RecordedRun, robot: StationRobot) -> list[Stack]:
    """Make the plots of the torque of each axis, with its limit."""
    torques = result.axes("tau", robot.name)
    limits = robot.gains.judged_limit  # infinite for axes without a motor
    stacks = []
    for group in side_groups(robot):
        unit, places = robot.model.effort_units[group.first], list(group.places.values())
        curves = group.curves(torques, QUANTITY_WORDS["torque"], VALUE)
        own = np.unique(limits[places])
        limit_label = message("results.torque_limit", "torque limit")
        for bound in (*own, *-own):
            if _NEAR * (np.sign(bound) * torques[:, places]).max() >= abs(bound):
                curves.append(dashed(np.full(len(torques), bound), limit_label, RED))
        note = message("results.no_limit", "no limit")
        if robot.gains.passive[places].all():
            note = message("results.no_motor", "no motor")
        elif np.isfinite(own).any():
            shown = [
                compound("±{limit:g} {unit}", limit=limit, unit=unit)
                if np.isfinite(limit)
                else message("results.none", "none")
                for limit in own
            ]
            note = message("results.limit_of_torque", "limit {limits}", limits=join_texts(shown, " / "))
        stacks.append(Stack(group.name, [Plot(_with_unit(QUANTITIES[unit], unit), curves, note=note)]))
    return stacks


_ERROR = message("results.error", "error")


def _with_unit(quantity: str, unit: str) -> str:
    """Label of an axis: a quantity with its unit, such as "position [deg]"."""
    return compound("{quantity} [{unit}]", quantity=quantity, unit=unit)


_PARTS = ("x", "y", "z", "Rz", "Ry", "Rx")
_PLACE, _ORIENTATION = slice(0, 3), slice(3, 6)
_ERROR_UNITS = np.array([1e3, 1e3, 1e3, 1.0, 1.0, 1.0])  # mm and deg
_LOCKED = 80.0  # deg of Ry, from where on small turns are large angles Rz and Rx
_LOCK = message("results.near_gimbal_lock", "large where Ry is near ±90")


@np.errstate(over="ignore", invalid="ignore")  # of a run that diverged
def tcp_stacks(result: RecordedRun, robot: StationRobot) -> list[Stack]:
    """Return x, y and z of the tool centre point and its angles Rz, Ry and Rx, each with its reference and error.

    The reference is where the axes' references put the tool, on the root link as it stands. Each error is the
    reference minus what was reached, of the same number.
    """
    reached, desired = matrices_from_xyz_quaternions(result.pose("tcp", robot.name)), reference_tools(result, robot)
    poses, references = poses_from_matrices(reached), poses_from_matrices(desired)
    poses[:, _ORIENTATION] = np.unwrap(poses[:, _ORIENTATION], axis=0)
    references[:, _ORIENTATION] = _nearest(references[:, _ORIENTATION], poses[:, _ORIENTATION])
    shown, targets = _for_users(poses), _for_users(references)
    locked = _LOCK if (np.abs(shown[:, _PARTS.index("Ry")]) > _LOCKED).any() else ""
    errors = (targets - shown) * _ERROR_UNITS
    stacks = []
    for place, part in enumerate(_PARTS):
        is_position = place < _PLACE.stop
        label = _with_unit(QUANTITY_WORDS["orientation"], "deg")
        unit = "deg"  # of the error
        if is_position:
            label = _with_unit(QUANTITY_WORDS["position"], "m")
            unit = "mm"
        curves = [Curve(shown[:, place], _TOOL, VALUE), dashed(targets[:, place], _REFERENCE, REFERENCE)]
        plots = [Plot(label, curves, note=locked if part in ("Rz", "Rx") else "")]
        if result.config.engine.moves_by_forces:
            error_label = message("results.error_of_tool", "error: reference - tool centre point")
            error = Curve(errors[:, place], error_label, ERROR)
            plots.append(Plot(_with_unit(_ERROR, unit), [error], ERROR_HEIGHT))
        stacks.append(Stack(part, plots))
    return stacks


def reference_tools(result: RecordedRun, robot: StationRobot) -> Vector:
    """Return where references put a robot's tool, in a program each run's, on its root as it stood, (m, 4, 4)."""
    if result.runs:
        parts = [reference_tools(run, run.plant.robots[robot.name]) for run in result.runs]
        return np.concatenate([*(part[:-1] for part in parts[:-1]), parts[-1]])
    plant, tool = robot.plant, robot.tools[robot.tcp]
    context = plant.CreateDefaultContext()
    positions = robot.axis_map.spread_positions(result.axes("q_ref", robot.name), result.positions_at(result.times))
    matrices = np.full((len(positions), 4, 4), np.nan)
    for row in np.flatnonzero(np.isfinite(positions).all(axis=1)):
        plant.SetPositions(context, positions[row])
        matrices[row] = tool.CalcPoseInWorld(context).GetAsMatrix4()
    return matrices


def _nearest(angles: Vector, reached: Vector) -> Vector:
    """Return the angles Rz, Ry and Rx (m, 3) [rad] of the same orientations that lie nearest to those reached."""
    same = np.stack([angles, angles * (1.0, -1.0, 1.0) + np.pi])
    same += 2 * np.pi * np.round((reached - same) / (2 * np.pi))
    first, second = np.abs(same - reached).sum(axis=2)
    return np.asarray(np.where((second < first)[:, np.newaxis], same[1], same[0]))


def _for_users(poses: Vector) -> Vector:
    return np.hstack([poses[:, _PLACE], np.rad2deg(poses[:, _ORIENTATION])])


_WIDTH, _LEFT, _RIGHT = 11.0, 0.95, 5.2  # inches: of the figure, and where the path begins and ends beside the curves
_X, _Y, _Z, _FACING, _TILT, *_ = COLOURS
_PATH = "0.35"
_NARROWEST = 0.1  # m: a robot that stands is not shown trembling
_ARROWS = 8  # along the path
_ARROW = 0.07  # of the picture's width


def base_figure(result: RecordedRun, robot: StationRobot, title: str) -> Figure:
    """Draw x, y and z of a robot's base [m], its tilt and yaw [deg], and its path seen from above.

    The tilt is the angle of the root's z axis from the vertical, and the yaw how far it turned to the left.
    """
    pose = result.pose("base", robot.name)
    heading = headings(result.plant, robot, pose)
    yaw = np.rad2deg(heading - heading[0])
    tilt = message("results.tilt", "tilt")
    turn = message("results.yaw", "yaw")
    plots = [
        Plot("x, y [m]", [Curve(pose[:, 0], "x", _X), Curve(pose[:, 1], "y", _Y)]),
        Plot(_with_unit(message("results.height_z", "height z"), "m"), [Curve(pose[:, 2], "z", _Z)]),
        Plot(_with_unit(tilt, "deg"), [Curve(np.rad2deg(tilts(pose)), tilt, _TILT)]),
        Plot(_with_unit(turn, "deg"), [Curve(yaw, turn, _FACING)]),
    ]
    stack = Stack(message("results.over_time", "over time"), plots)
    figure = grid_figure(result, title, [stack], width=_WIDTH, legend=_RIGHT + 0.2)
    first, last = (figure.axes[place].get_position() for place in (0, -1))
    inch = 1 / figure.get_size_inches()[0]
    area = first.x1 + _LEFT * inch, last.y0, (_RIGHT - _LEFT) * inch, first.y1 - last.y0
    _draw_path(figure.add_axes(area), trusted(result, pose[:, :2].T), heading)
    return figure


def _draw_path(axes: Axes, path: Vector, heading: Vector) -> None:
    """Draw the path (2, m) [m] with arrows that show where the robot faced."""
    style(axes, message("results.seen_from_above", "seen from above"))
    frame = axes.get_window_extent()
    low, high = path.min(axis=1), path.max(axis=1)
    size = np.array([frame.width, frame.height]) / frame.width
    span = max(1.25 * float(((high - low) / size).max()), _NARROWEST)  # m, across the picture
    left_bottom, right_top = (low + high - span * size) / 2, (low + high + span * size) / 2
    axes.set(xlim=(left_bottom[0], right_top[0]), ylim=(left_bottom[1], right_top[1]), aspect="equal")
    axes.plot(*path, color=_PATH, linewidth=1.4)
    shown = np.unique(np.linspace(0, path.shape[1] - 1, _ARROWS).astype(int))
    arrows = _ARROW * span * np.array([np.cos(heading[shown]), np.sin(heading[shown])])
    looks: dict[str, Any] = {"angles": "xy", "scale_units": "xy", "scale": 1, "width": 0.005}
    axes.quiver(*path[:, shown], *arrows, color=_FACING, **looks)
    start = translate(message("results.start", "start"))
    end = translate(message("results.end", "end"))
    heading_label = translate(message("results.heading", "heading"))
    axes.plot(*path[:, :1], "o", color=_PATH, markerfacecolor="white", label=start)
    axes.plot(*path[:, -1:], "s", color=_PATH, label=end)
    axes.plot([], [], marker=">", markersize=7, linestyle="", color=_FACING, label=heading_label)
    axes.set(xlabel="x [m]", ylabel="y [m]")
    axes.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=3, frameon=False, fontsize=8, borderaxespad=0.0)
