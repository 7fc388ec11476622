"""A browser window that shows a station while it is simulated, run after run, and by which its walks are commanded.

A *walk* is a controller that takes commands during a run, such as a speed; any controller that does so is meant. A
*section* is the part of a station's configuration that describes a controller.
"""

from collections import deque
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from time import perf_counter, sleep
from typing import Any, NamedTuple

import numpy as np
from pydrake.geometry import Meshcat, Role

from simrob_drake.base.frames import Vector
from simrob_drake.base.renaming import keep_former_attributes
from simrob_drake.parts.controllers.section import ControllerSection, commanded_sections
from simrob_drake.parts.resolved import ResolvedRobot
from simrob_drake.results.animation.camera import WINDOW_ASPECT, camera_on, robots_to_follow, side
from simrob_drake.results.animation.drawn import (
    Command,
    commands,
    draw_geometry,
    draw_tool_paths,
    look,
    pose_commands,
)
from simrob_drake.results.animation.scene import ViewedStation, draw_floor_lines, floor_under
from simrob_drake.results.animation.window import Board, Control, Window
from simrob_drake.results.record.run import RecordedRun
from simrob_drake.results.record.state import State
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.resolve import resolve

FRAME = 1 / 30
"""Simulated time between two pictures [s]."""

_SPEED_PICTURES = 30
"""Count of pictures over which the speed of the simulation is averaged."""

_PREFIXES = {"station": Role.kIllustration}
"""Path of the station in Meshcat's tree, and the role of the shapes that are drawn there."""

Tell = Callable[[str, Sequence[Command]], object]
"""Function that sends commands to a page. Commands on the same subject replace the earlier ones of this subject."""


class _Clocks(NamedTuple):
    """Time of a simulation, and time of the computer's clock, at the same moment [s]."""

    simulated: float
    real: float


class _Sample(NamedTuple):
    """Positions of the whole plant, shape (nq,), at a time of a run [s]."""

    time: float
    positions: Vector


class StationView:
    """Sender of the commands with which a browser shows a station.

    Attributes:
        scene: the station as it is shown; None before the first :meth:`draw`.
    """

    def __init__(self, tell: Tell, aspect: float = WINDOW_ASPECT) -> None:
        """Prepare a view. It shows nothing yet.

        Args:
            tell: function that sends commands to the page.
            aspect: width over height of the view.
        """
        self._tell = tell
        self._aspect = aspect
        self._looks: object = None
        self._controllers: Mapping[str, ControllerSection] = {}
        self.scene: ViewedStation | None = None

    def draw(self, config: StationConfig, state: State | None = None) -> Vector:
        """Show a station. Its shapes are sent only if they differ from those that the page shows.

        Args:
            config: the station.
            state: state of the station; its initial state if None.

        Returns:
            the positions of the plant that are shown, shape (nq,).
        """
        # Servos do not change the picture, so that another gain does not load the station again.
        robots = {
            name: robot.model_copy(update={"servo": None}) for name, robot in config.robots.items()
        }
        self._controllers = config.controllers
        # Everything that the shapes depend on.
        looks = (robots, config.pieces, config.floor, config.mode)
        if self.scene is None or looks != self._looks:
            self.scene = ViewedStation(config)
            self._looks = looks
            self._tell_scene(self.scene, config)
        positions = self.scene.initial if state is None else state.of_plant(self.scene.station)[0]
        self.show(positions)
        return positions

    def show(self, positions: Vector) -> None:
        """Show positions of the whole plant, shape (nq,). Nothing changes if a position is not finite."""
        if self.scene is not None and np.isfinite(positions).all():
            self.scene.place(positions)
            poses = pose_commands(self.scene.query(), _PREFIXES)
            self._tell("poses", [*poses, *self._follow_commands(self.scene)])

    def _follow_commands(self, scene: ViewedStation) -> list[dict[str, Any]]:
        """Commands to the page by which the camera and the floor follow a robot that moves about.

        Such robots are those that walk on feet, and those whose controllers ask for it. The list is empty if there is
        no such robot, or several. The first command is that of the camera.

        Args:
            scene: the station as it is shown.
        """
        of_controllers = robots_to_follow(scene.station.robots, self._controllers)
        robots = scene.station.robots.values()
        followed = [
            robot
            for robot in robots
            if robot.name in of_controllers or (robot.model.feet and robot.floats)
        ]
        # A camera that followed one of several robots would lose the others.
        if len(followed) != 1:
            return []
        place = scene.pose(followed[0].root).translation()
        return [
            {"type": "follow", "place": place[:2].round(4).tolist()},
            *floor_under(scene, place),
        ]

    def _tell_scene(self, scene: ViewedStation, config: StationConfig) -> None:
        """Send all shapes of a station, its floor and the camera to the page.

        Args:
            scene: the station as it is to be shown.
            config: its configuration.
        """
        points = scene.extents(scene.initial[np.newaxis])
        azimuth = side(scene.station)
        # The shapes are sent in the initial posture, for which the camera is set; `draw` shows the state afterwards.
        scene.place(scene.initial)
        # The camera is in its place: from here on it moves as the robot does.
        here = [{**command, "begins": True} for command in self._follow_commands(scene)[:1]]

        def draw(meshcat: Meshcat) -> None:
            draw_geometry(meshcat, scene.query(), _PREFIXES)
            if here and config.floor is not None:
                draw_floor_lines(meshcat, scene, size=config.floor.size)
            look(meshcat, camera_on(points, aspect=self._aspect, azimuth=azimuth))

        # Bodies of the former station that the new one does not have would stay in the page.
        self._tell("scene", [{"type": "delete", "path": "/drake/station"}, *commands(draw), *here])


class LiveView:
    """A browser window that shows runs in real time, or slower if the simulation is slower.

    Pass :meth:`on_step` to ``simulate(on_step=...)``. The view makes the run wait, and has no other effect on it.

    Attributes:
        url: address of the window. It can be opened on this computer only.
    """

    def __init__(
        self,
        config: StationConfig,
        state: State | None = None,
        *,
        steering: "Steering | None" = None,
    ) -> None:
        """Open the window.

        Args:
            config: the station.
            state: state in which the station is shown; its initial state if None.
            steering: controls by which the user commands controllers; none if None.

        Raises:
            SimrobError: the station cannot be built, such as a robot without its files.
        """
        self._window: Window | None = Window(steering.controls if steering else None)
        if steering:
            steering.board = self._window
        self.url = self._window.url
        self._view = StationView(self._window.tell)
        self._next_frame = 0.0  # time of the run at which the next picture is shown [s]
        self._clock_at_zero = 0.0  # time of the computer's clock at which the run's time is 0 [s]
        self._shown = deque[_Clocks](maxlen=_SPEED_PICTURES)
        self._path_count = 0
        self.draw(config, state)

    def draw(self, config: StationConfig, state: State | None = None) -> None:
        """Show a station outside of any run. The next step that is shown begins a new run.

        Args:
            config: the station.
            state: its state; its initial state if None.
        """
        self._view.draw(config, state)
        self._last: _Sample | None = None  # the last step of the run; None before its first one

    def add_paths(self, result: RecordedRun) -> None:
        """Draw the paths of the tools in a run as lines, which remain in later runs. Nothing happens after `close`."""
        number = self._path_count
        if self._window is None:
            return
        self._window.tell(
            f"paths {number}", commands(lambda meshcat: draw_tool_paths(meshcat, result, number))
        )
        self._path_count += 1

    def on_step(self, time: float, positions: Vector) -> None:
        """Show the motion since the last step, in pictures at even times, and wait until each is due.

        Within the step, the positions are interpolated linearly. Nothing is shown after `close`, and if a position is
        not finite.

        Args:
            time: time of the run at the end of the step [s].
            positions: positions of the whole plant at the end of the step, shape (nq,).
        """
        if self._window is None or not np.isfinite(positions).all():
            return
        if self._last is None or time < self._last.time:  # another run begins
            # A run may begin at any time, and the clock of the computer is compared with it from its first
            # step.
            self._next_frame = time
            self._clock_at_zero = perf_counter() - time
            self._shown.clear()
        start = _Sample(time, positions)
        if self._last is not None and self._last.time < time:
            start = self._last
        while self._next_frame <= time:
            # The first step of a run has no length: its picture is that of the end.
            length = time - start.time
            part = (self._next_frame - start.time) / length if length > 0 else 1.0
            self._wait()
            self._view.show(start.positions + part * (positions - start.positions))
            self.say(f"{self._next_frame:.2f} s  {self._speed(self._next_frame):.1f} ×")
            self._next_frame += FRAME
        # A copy, since the solver reuses the array in its next step.
        self._last = _Sample(time, positions.copy())

    def _wait(self) -> None:
        """Wait until the next picture is due. If it is late by a whole picture, all later ones are as late.

        Without this shift, the run would be shown too fast after a slow part.
        """
        # Time until the picture is due [s]; negative if it is late.
        ahead = self._clock_at_zero + self._next_frame - perf_counter()
        if ahead > 0:
            sleep(ahead)
        elif ahead < -FRAME:
            self._clock_at_zero -= ahead

    def _speed(self, time: float) -> float:
        """Compute the speed of the simulation relative to real time, over the last 30 pictures.

        The present moment is noted as that of the latest picture. The speed of the first picture is 1.

        Args:
            time: time of the run that the latest picture shows [s].
        """
        self._shown.append(_Clocks(time, perf_counter()))
        first = self._shown[0]
        last = self._shown[-1]
        if last.simulated <= first.simulated:
            return 1.0  # there is only one picture yet
        return (last.simulated - first.simulated) / (last.real - first.real)

    def say(self, text: str) -> None:
        """Write something over the picture: the time of a run [s], or how it ended."""
        if self._window is not None:
            self._window.tell("said", [{"type": "said", "text": text}])

    def close(self) -> None:
        """Close the window and its port. Later steps of a run are not shown."""
        if self._window is not None:
            self._window.close()
        self._window = None


_STOP = "stop: space"
"""Label of the button that sets all numbers of a command to zero."""

_SLIDER_STEPS = 5
"""Count of steps of a slider from zero to its upper limit."""

_SLIDER_DECIMALS = 6
"""Decimals of a slider's value."""


class Steering:
    """Controls by which the user of a page commands controllers during a run.

    Each controller that takes commands, such as a walk, has a slider for each number of its command, and a button that
    sets all of them to zero.

    Attributes:
        controls: controls of the page, by label. With several commanded controllers, the label begins with the name of
            the controller. Only those of the first controller have keys.
        commands: functions that command the controllers, by name, as ``simulate(commands=...)`` takes them. They return
            None until the user touches a control.
        board: the page. It shows where the program has set the sliders.
    """

    def __init__(self, config: StationConfig) -> None:
        """Make the controls for a station. Without a controller that takes commands, the page has no controls."""
        sections = commanded_sections(config.controllers)
        self.controls = dict[str, Control]()
        self.commands: dict[str, Callable[[float], tuple[float, ...] | None]] = {}
        self._shown = dict[
            str, float
        ]()  # by label, the value to which the program has set each slider
        station = resolve(config)
        for number, (name, section) in enumerate(sections.items()):
            prefix = f"{name}: " if len(sections) > 1 else ""
            robot = station.robot(section.robot_name, f"controllers.{name}")
            # A key can only command one controller.
            self.controls |= _controls(section, robot, prefix, keys=number == 0)
            self.commands[name] = partial(self._command, prefix, section)
        self.board: Board | None = None
        self._begun = set[str]()  # prefixes of the controllers that the user has begun to command

    def _command(
        self, prefix: str, section: ControllerSection, time: float
    ) -> tuple[float, ...] | None:
        """Read the command that the user has set for a controller, by the sliders or the stop button.

        Until the user touches a control, the sliders are set to the command of the section. If the stop button was
        pressed, all sliders are set to zero.

        Args:
            prefix: beginning of the labels of the controller's controls.
            section: section of the controller.
            time: time of the run [s].

        Returns:
            the numbers of the command in the units of `command_parts`, or None until the user touches a control.
        """
        parts = section.command_parts
        sliders = [prefix + part.label for part in parts]
        stop = self.controls[prefix + _STOP]
        if stop.value:
            # The button is pressed only once; until the next press the sliders count again.
            stop.value = 0.0
            self._show(sliders, [0.0] * len(sliders))
            self._begun.add(prefix)
        # If a slider is not where the program has set it, the user has moved it.
        if any(self.controls[name].value != self._shown.get(name, 0.0) for name in sliders):
            self._begun.add(prefix)
        if prefix not in self._begun:
            numbers_of_section = zip(section.command_at(time), parts, strict=True)
            # Rounding removes the error of the conversion to the slider's unit, such as from radians to degrees.
            shown = [
                round(value / part.slider_unit, _SLIDER_DECIMALS)
                for value, part in numbers_of_section
            ]
            self._show(sliders, shown)
            return None
        values = [round(self.controls[name].value, _SLIDER_DECIMALS) for name in sliders]
        return tuple(value * part.slider_unit for value, part in zip(values, parts, strict=True))

    def _show(self, sliders: Sequence[str], values: Sequence[float]) -> None:
        """Set sliders to values of the program, here and in the page, and remember the values.

        Args:
            sliders: labels of the sliders.
            values: their values, in the units of the sliders.
        """
        for name, value in zip(sliders, values, strict=True):
            if self.controls[name].value != value:
                self.controls[name].value = value
                if self.board is not None:
                    self.board.show(name)
            self._shown[name] = value


keep_former_attributes(Steering, hands="commands")


def _controls(
    section: ControllerSection, robot: ResolvedRobot, prefix: str, *, keys: bool
) -> dict[str, Control]:
    """Make the sliders and the stop button of a controller, by label.

    Args:
        section: section of the controller.
        robot: robot of the controller.
        prefix: beginning of the labels.
        keys: whether keys of the browser move the sliders, too.
    """
    controls = dict[str, Control]()
    # The limits are in the units of the sliders.
    for part, (lower, upper) in zip(
        section.command_parts, section.command_limits(robot), strict=True
    ):
        down, up = part.keys if keys else ("", "")
        controls[prefix + part.label] = Control(
            value=0.0,
            low=lower,
            high=upper,
            # An upper limit of 0 would give a step of 0, which no slider takes.
            step=(upper or 1.0) / _SLIDER_STEPS,
            key=down or None,
            key_up=up or None,
        )
    controls[prefix + _STOP] = Control(key="Space" if keys else None)
    return controls
