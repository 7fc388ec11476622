"""Plots of a robot: positions and torques of its joints, the pose of its tool, and the path of its base.

An *axis* of a robot is a joint with its drive. The right and the left axis of a legged robot that have the same name
otherwise, such as ``right_knee`` and ``left_knee``, share a plot. A *stack* is a title with plots below each other.
Positions and torques are shown in the units of users: degrees for joints that turn, metres for joints that slide.
"""

from dataclasses import dataclass, replace
from typing import Any, NamedTuple

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
    dashed_curve,
    grid_figure,
    reliable_samples,
    style,
)
from simrob_drake.results.record.run import RecordedRun
from simrob_drake.results.record.walks import headings, tilts


class _SideLook(NamedTuple):
    """Look of the curves of one side: the colour, and the width of the line relative to that of other curves."""

    colour: str
    weight: float


# The first drawn side has the wider line, so that both are visible where they are equal.
_SIDE_LOOKS = {
    "right": _SideLook(COLOURS[0], 1.5),
    "left": _SideLook(COLOURS[2], 0.8),
    "middle": _SideLook(COLOURS[7], 1.0),
}
_SIDE_WORDS = {
    "right": message("results.right", "right"),
    "left": message("results.left", "left"),
    "middle": message("results.middle", "middle"),
}
_REFERENCE = message("results.reference", "reference")
_ERROR = message("results.error", "error")
_TOOL = message("results.tool_centre_point", "tool centre point")

_NEAR = 1.3
"""A limit is drawn if it is at most this many times the largest torque. A larger one would flatten the curve."""

QUANTITIES = {
    "deg": QUANTITY_WORDS["position"],
    "m": QUANTITY_WORDS["position"],
    "N·m": QUANTITY_WORDS["torque"],
    "N": QUANTITY_WORDS["force"],
}
"""Quantities of joints by the unit in which they are shown."""


@dataclass(frozen=True, eq=False)
class SideGroup:
    """Axes that share a plot: one axis, or the right and the left axis of the same name.

    Attributes:
        name: name of the axis. The name of two axes is without "right" and "left".
        axes: index of each axis in the robot's axes, by side: "right" and "left", or "middle" for an axis alone. If
            the robot has no axes with two sides, the side of every axis is "".
    """

    name: str
    axes: dict[str, int]

    @property
    def first_axis(self) -> int:
        """Index of the first axis. All axes of a group have the same unit."""
        return next(iter(self.axes.values()))

    def curves(self, values: Vector, label: str, colour: str) -> list[Curve]:
        """Make the curves of the group, one for each of its axes.

        Args:
            values: values of all axes of the robot, shape (m, n).
            label: name of the curve in the legend, if the robot has no sides. Otherwise the side is the name.
            colour: colour of the curve, if the robot has no sides. Otherwise each side has its colour.
        """
        curves = []
        for side, axis in self.axes.items():
            look = _SIDE_LOOKS.get(side, _SideLook(colour, 1.0))
            curves.append(
                Curve(values[:, axis], _SIDE_WORDS.get(side, label), look.colour, look.weight)
            )
        return curves


def side_groups(robot: StationRobot) -> list[SideGroup]:
    """Group the axes of a robot by sides, in the order of the axes. A pair has the position of its first axis.

    If the robot has a pair, its axes without a partner have the side "middle". Otherwise all axes have the side "".
    """
    groups = []
    for index in range(len(robot.axes)):
        pair = _pair_of(robot, index)
        if pair is None:
            groups.append(SideGroup(robot.axes[index], {"": index}))
        # Both axes find the same pair; it is added once, by its first axis.
        elif index == min(pair.axes.values()):
            groups.append(pair)
    # In a robot without pairs, the colours of sides would mean nothing.
    has_pairs = any(len(group.axes) > 1 for group in groups)
    if not has_pairs:
        return groups
    return [
        replace(group, axes={"middle": group.axes[""]}) if "" in group.axes else group
        for group in groups
    ]


def _pair_of(robot: StationRobot, index: int) -> SideGroup | None:
    """Find the right and the left axis to which an axis belongs, from the names of the axes.

    Returns None for an axis alone, and for two axes of different units.

    Args:
        robot: the robot.
        index: index of the axis.
    """
    sides = ("right", "left")
    words = robot.axes[index].split("_")
    axes = {}
    for side in sides:
        # The name with each word "right" or "left" replaced by the side. Sides are whole words between underscores:
        # "brightness" has no side.
        name = "_".join(side if word in sides else word for word in words)
        if name in robot.axes:
            axes[side] = robot.axes.index(name)
    # An axis whose name has no side is found twice.
    is_pair = len(set(axes.values())) == 2
    # A joint that turns and one that slides cannot share an upright axis.
    units = {robot.model.unit_names[axis] for axis in axes.values()}
    if not is_pair or len(units) > 1:
        return None
    return SideGroup("_".join(word for word in words if word not in sides), axes)


def position_stacks(result: RecordedRun, robot: StationRobot) -> list[Stack]:
    """Make the plots of the position of each axis with its reference, in degrees or metres: one stack for each group.

    The error, reference minus position, is below. It is left out if the engine moves the axes without forces, since
    then there is none.
    """
    user_units = robot.model.user_units
    reference = result.axes("q_ref", robot.name) / user_units
    reached = result.axes("q", robot.name) / user_units
    with np.errstate(invalid="ignore"):  # a diverging run may end with infinite positions
        error = reference - reached
    stacks = []
    for group in side_groups(robot):
        unit = robot.model.unit_names[group.first_axis]
        curves = group.curves(reached, QUANTITY_WORDS["position"], VALUE)
        curves += [
            dashed_curve(reference[:, axis], _REFERENCE, REFERENCE) for axis in group.axes.values()
        ]
        plots = [Plot(_with_unit(QUANTITIES[unit], unit), curves)]
        if result.config.engine.moves_by_forces:
            label = message("results.error_of_position", "error: reference - position")
            errors = group.curves(error, label, ERROR)
            plots.append(Plot(_with_unit(_ERROR, unit), errors, ERROR_HEIGHT))
        stacks.append(Stack(group.name, plots))
    return stacks


def torque_stacks(result: RecordedRun, robot: StationRobot) -> list[Stack]:
    """Make the plots of the torque (or force) of each axis: one stack for each group.

    A limit that the torque comes near to is drawn. All limits are in a note above the frame.
    """
    torques = result.axes("tau", robot.name)
    stacks = []
    for group in side_groups(robot):
        unit = robot.model.effort_units[group.first_axis]
        curves = group.curves(torques, QUANTITY_WORDS["torque"], VALUE)
        curves += _limit_curves(torques, group, robot)
        note = _note_on_limits(group, robot, unit)
        stacks.append(
            Stack(group.name, [Plot(_with_unit(QUANTITIES[unit], unit), curves, note=note)])
        )
    return stacks


def _limits_of(group: SideGroup, robot: StationRobot) -> Vector:
    """Different torque limits of the axes of a group, each once, in ascending order [N·m or N].

    The limit of an axis without a motor is infinite, as is that of a motor without limit.
    """
    axes = list(group.axes.values())
    return np.unique(robot.gains.judged_limit[axes])


def _limit_curves(torques: Vector, group: SideGroup, robot: StationRobot) -> list[Curve]:
    """Make the curves of the torque limits, positive and negative, that the torques come near to.

    Args:
        torques: torques of all axes of the robot, shape (m, n) [N·m or N].
        group: the axes of the plot.
        robot: the robot.
    """
    axes = list(group.axes.values())
    limits = _limits_of(group, robot)
    curves = []
    # An infinite limit is never near.
    for bound in (*limits, *-limits):  # upper limits, then lower ones
        largest = (np.sign(bound) * torques[:, axes]).max()  # in the direction of the bound
        if _NEAR * largest >= abs(bound):
            label = message("results.torque_limit", "torque limit")
            curves.append(dashed_curve(np.full(len(torques), bound), label, RED))
    return curves


def _note_on_limits(group: SideGroup, robot: StationRobot, unit: str) -> str:
    """Write the torque limits of a group in words, such as "limit ±40 N·m": they may be too large for the plot.

    It is "no motor" or "no limit" if that is true of all axes of the group.

    Args:
        group: the axes.
        robot: the robot.
        unit: unit of the limits, N·m or N.
    """
    axes = list(group.axes.values())
    limits = _limits_of(group, robot)
    if robot.gains.passive[axes].all():
        return message("results.no_motor", "no motor")
    if not np.isfinite(limits).any():
        return message("results.no_limit", "no limit")
    texts = []
    for limit in limits:
        if np.isfinite(limit):
            texts.append(compound("±{limit:g} {unit}", limit=limit, unit=unit))
        else:
            texts.append(message("results.none", "none"))
    return message("results.limit_of_torque", "limit {limits}", limits=join_texts(texts, " / "))


def _with_unit(quantity: str, unit: str) -> str:
    """Label of an axis: a quantity with its unit, such as "position [deg]"."""
    return compound("{quantity} [{unit}]", quantity=quantity, unit=unit)


_COMPONENTS = ("x", "y", "z", "Rz", "Ry", "Rx")
"""Components of a pose, as its columns: the position, and angles of rotations about z, the new y and the new x."""

_POSITION = slice(0, 3)
_ORIENTATION = slice(3, 6)
_RY = _COMPONENTS.index("Ry")
_ERROR_UNITS = np.array([1e3, 1e3, 1e3, 1.0, 1.0, 1.0])
"""Factors from the units of a pose, m and deg, to those of its error, mm and deg."""

_LOCK_ANGLE = 80.0
"""Ry beyond which small rotations are large angles Rz and Rx [deg]. At 90 deg the two turn about the same axis."""

_LOCK_NOTE = message("results.near_gimbal_lock", "large where Ry is near ±90 deg (gimbal lock)")


@np.errstate(over="ignore", invalid="ignore")  # a diverging run may have infinite poses
def tcp_stacks(result: RecordedRun, robot: StationRobot) -> list[Stack]:
    """Make the plots of the tool centre point in the world: x, y, z and Rz, Ry, Rx with their references and errors.

    The reference is the pose of the tool if the axes were at their references, and the root link where it is. Each
    error is the reference minus the value of the same component. Errors are left out if the engine moves the axes
    without forces.

    Args:
        result: the run.
        robot: a robot with a tool.
    """
    poses = poses_from_matrices(matrices_from_xyz_quaternions(result.pose("tcp", robot.name)))
    references = poses_from_matrices(reference_tools(result, robot))
    # Poses are rows x y z Rz Ry Rx, in m and rad. No jumps from 180 to -180 degrees.
    poses[:, _ORIENTATION] = np.unwrap(poses[:, _ORIENTATION], axis=0)
    # Otherwise the error of a tool that is near its reference could be 360 degrees.
    references[:, _ORIENTATION] = _nearest(references[:, _ORIENTATION], poses[:, _ORIENTATION])
    shown = _in_degrees(poses)
    targets = _in_degrees(references)
    errors = (targets - shown) * _ERROR_UNITS
    is_near_lock = (np.abs(shown[:, _RY]) > _LOCK_ANGLE).any()
    stacks = []
    for index, component in enumerate(_COMPONENTS):
        is_position = index < _POSITION.stop
        if is_position:
            label = _with_unit(QUANTITY_WORDS["position"], "m")
            error_unit = "mm"
        else:
            label = _with_unit(QUANTITY_WORDS["orientation"], "deg")
            error_unit = "deg"
        note = _LOCK_NOTE if is_near_lock and component in ("Rz", "Rx") else ""
        value = Curve(shown[:, index], _TOOL, VALUE)
        reference = dashed_curve(targets[:, index], _REFERENCE, REFERENCE)
        plots = [Plot(label, [value, reference], note=note)]
        if result.config.engine.moves_by_forces:
            error_label = message("results.error_of_tool", "error: reference - tool centre point")
            error = Curve(errors[:, index], error_label, ERROR)
            plots.append(Plot(_with_unit(_ERROR, error_unit), [error], ERROR_HEIGHT))
        stacks.append(Stack(component, plots))
    return stacks


def reference_tools(result: RecordedRun, robot: StationRobot) -> Vector:
    """Compute the pose of a robot's tool for the references of its axes, with the root link where it was.

    Args:
        result: a run, or a program of several runs, each of which may have another tool.
        robot: a robot with a tool.

    Returns:
        poses of the tool in the world, homogeneous matrices, shape (m, 4, 4). They are NaN at times at which a
        position is not finite, as at the end of a diverging run.
    """
    if result.runs:
        matrices_of_runs = [
            reference_tools(run, run.plant.robots[robot.name]) for run in result.runs
        ]
        # The last sample of a run is the first sample of the next one.
        without_ends = [matrices[:-1] for matrices in matrices_of_runs[:-1]]
        return np.concatenate([*without_ends, matrices_of_runs[-1]])

    plant = robot.plant
    tool = robot.tools[robot.tcp]
    context = plant.CreateDefaultContext()
    # The recorded positions with the axes replaced: the base of a robot is where it was at each time, so that only the
    # errors of the axes are shown.
    positions = robot.axis_map.spread_positions(
        result.axes("q_ref", robot.name), result.positions_at(result.times)
    )
    matrices = np.full((len(positions), 4, 4), np.nan)
    is_finite = np.isfinite(positions).all(axis=1)
    for row in np.flatnonzero(is_finite):
        plant.SetPositions(context, positions[row])
        matrices[row] = tool.CalcPoseInWorld(context).GetAsMatrix4()
    return matrices


def _nearest(angles: Vector, reached: Vector) -> Vector:
    """Find the angles of the same orientations that are nearest to other angles.

    Args:
        angles: angles Rz, Ry and Rx of orientations, shape (m, 3) [rad].
        reached: angles to which the result is near, shape (m, 3) [rad].
    """
    # The angles (Rz + pi, pi - Ry, Rx + pi) are the same orientation as (Rz, Ry, Rx), and so are whole turns more.
    # Both forms, shape (2, m, 3).
    candidates = np.stack([angles, angles * (1.0, -1.0, 1.0) + np.pi])
    # Whole turns that bring each angle within half a turn of the other angle.
    candidates += 2 * np.pi * np.round((reached - candidates) / (2 * np.pi))
    first_distance, second_distance = np.abs(candidates - reached).sum(axis=2)
    is_second_nearer = (second_distance < first_distance)[:, np.newaxis]
    return np.asarray(np.where(is_second_nearer, candidates[1], candidates[0]))


def _in_degrees(poses: Vector) -> Vector:
    """Convert poses (m, 6), rows x y z Rz Ry Rx, from radians to degrees. Positions stay in m."""
    return np.hstack([poses[:, _POSITION], np.rad2deg(poses[:, _ORIENTATION])])


# Widths in the figure of the base [inches].
_WIDTH = 11.0  # the figure
_LEFT = 0.95  # from the curves to the left edge of the picture of the path
_RIGHT = 5.2  # from the curves to its right edge

_X, _Y, _Z, _FACING, _TILT, *_ = COLOURS
"""Colours of the coordinates of the base, of its direction, and of its tilt."""

_PATH_COLOUR = "0.35"
"""Matplotlib's name of a dark grey: 0 is black, 1 white."""

_NARROWEST = 0.1
"""Least width of the picture of the path [m], so that the trembling of a standing robot is not shown large."""

_ARROW_COUNT = 8
"""Count of arrows along the path."""

_ARROW_LENGTH = 0.07
"""Length of an arrow, as a part of the width of the picture."""


def base_figure(result: RecordedRun, robot: StationRobot, title: str) -> Figure:
    """Draw x, y and z of a robot's base [m], its tilt and yaw [deg], and its path seen from above.

    The tilt is the angle of the root link's z axis from the vertical, and the yaw is how far the robot has turned to
    the left since the start.

    Args:
        result: the run.
        robot: a robot that walks.
        title: title of the figure, after the name of the station.
    """
    pose = result.pose("base", robot.name)
    heading = headings(result.plant, robot, pose)
    yaw = np.rad2deg(heading - heading[0])
    tilt = message("results.tilt", "tilt")
    turn = message("results.yaw", "yaw")
    plots = [
        Plot("x, y [m]", [Curve(pose[:, 0], "x", _X), Curve(pose[:, 1], "y", _Y)]),
        Plot(
            _with_unit(message("results.height_z", "height z"), "m"), [Curve(pose[:, 2], "z", _Z)]
        ),
        Plot(_with_unit(tilt, "deg"), [Curve(np.rad2deg(tilts(pose)), tilt, _TILT)]),
        Plot(_with_unit(turn, "deg"), [Curve(yaw, turn, _FACING)]),
    ]
    stack = Stack(message("results.over_time", "over time"), plots)
    # The picture of the path shares the space right of the curves with their legends.
    figure = grid_figure(result, title, [stack], width=_WIDTH, legend=_RIGHT + 0.2)
    first = figure.axes[0].get_position()
    last = figure.axes[-1].get_position()
    inch = 1 / figure.get_size_inches()[0]  # as a part of the figure's width
    # Left, bottom, width and height, as parts of the figure: right of the curves, as high as all of them.
    area = (first.x1 + _LEFT * inch, last.y0, (_RIGHT - _LEFT) * inch, first.y1 - last.y0)
    # A run that diverges would make its path a point in an empty frame.
    path = reliable_samples(result, pose[:, :2].T)
    _draw_path(figure.add_axes(area), path, heading)
    return figure


def _draw_path(axes: Axes, path: Vector, heading: Vector) -> None:
    """Draw the path of a robot from above, with arrows that show where it faced.

    Args:
        axes: an empty frame.
        path: x and y of the base in the world, shape (2, m) [m].
        heading: direction of the robot from the x axis, counterclockwise, for these samples and perhaps more [rad].
    """
    style(axes, message("results.seen_from_above", "seen from above"))
    width = _set_path_limits(axes, path)
    axes.plot(path[0], path[1], color=_PATH_COLOUR, linewidth=1.4)

    # Even in time, so that arrows are close together where the robot is slow.
    shown = np.unique(np.linspace(0, path.shape[1] - 1, _ARROW_COUNT).astype(int))
    length = _ARROW_LENGTH * width
    along_x = length * np.cos(heading[shown])
    along_y = length * np.sin(heading[shown])
    # Arrows with the directions and lengths of the axes' units; their width is a part of the width of the frame.
    in_units_of_axes: dict[str, Any] = {
        "angles": "xy",
        "scale_units": "xy",
        "scale": 1,
        "width": 0.005,
    }
    axes.quiver(path[0, shown], path[1, shown], along_x, along_y, color=_FACING, **in_units_of_axes)

    # A circle at the start and a square at the end; an empty curve explains the arrows in the legend.
    start = translate(message("results.start", "start"))
    end = translate(message("results.end", "end"))
    heading_label = translate(message("results.heading", "heading"))
    axes.plot(*path[:, :1], "o", color=_PATH_COLOUR, markerfacecolor="white", label=start)
    axes.plot(*path[:, -1:], "s", color=_PATH_COLOUR, label=end)
    axes.plot([], [], marker=">", markersize=7, linestyle="", color=_FACING, label=heading_label)
    axes.set(xlabel="x [m]", ylabel="y [m]")
    axes.legend(
        loc="lower right",
        bbox_to_anchor=(1.0, 1.0),
        ncols=3,
        frameon=False,
        fontsize=8,
        borderaxespad=0.0,
    )


def _set_path_limits(axes: Axes, path: Vector) -> float:
    """Set the limits of a frame around a path (2, m) [m], with the same scale of both axes.

    The path is in the middle. In the direction in which it fills the picture more, a tenth of the picture is free on
    each side; a path of a few centimetres leaves more.

    Args:
        axes: the frame, in its final place.
        path: x and y of the path, shape (2, m) [m].

    Returns:
        the width of the picture [m].
    """
    frame = axes.get_window_extent()
    # The size of the picture, as parts of its width.
    relative_size = np.array([frame.width, frame.height]) / frame.width
    low = path.min(axis=1)
    high = path.max(axis=1)
    # An eighth of the path on each side is a tenth of the picture. The larger need of both directions counts.
    width = max(1.25 * float(((high - low) / relative_size).max()), _NARROWEST)
    left, bottom = (low + high - width * relative_size) / 2
    right, top = (low + high + width * relative_size) / 2
    axes.set(xlim=(left, right), ylim=(bottom, top), aspect="equal")
    return width
