"""A browser window that shows a station while it is simulated, run after run, and by which its walks are commanded."""

from collections import deque
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from time import perf_counter, sleep
from typing import Any

import numpy as np
from pydrake.geometry import Meshcat, Role

from simrob_drake.base.frames import Vector
from simrob_drake.parts.controllers.section import ControllerSection, commanded_sections
from simrob_drake.parts.resolved import ResolvedRobot
from simrob_drake.results.animation.camera import WINDOW_ASPECT, camera_on, robots_to_follow, side
from simrob_drake.results.animation.drawn import Command, commands, draw_geometry, draw_tool_paths, look, pose_commands
from simrob_drake.results.animation.scene import ViewedStation, draw_floor_lines, floor_under
from simrob_drake.results.animation.window import Board, Control, Window
from simrob_drake.results.record.run import RecordedRun
from simrob_drake.results.record.state import State
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.resolve import resolve

FRAME = 1 / 30  # simulated time from one picture to the next [s]
_SPEED_OVER = 30  # pictures
_PREFIXES = {"station": Role.kIllustration}
Tell = Callable[[str, Sequence[Command]], object]


class StationView:
    """What a browser is told so that it shows a station."""

    def __init__(self, tell: Tell, aspect: float = WINDOW_ASPECT) -> None:
        """Show nothing yet in a view of an aspect, width over height.

        ``tell`` takes a subject, and the commands to Meshcat's page in place of its last ones.
        """
        self._tell, self._aspect = tell, aspect
        self._looks: object = None
        self._controllers: Mapping[str, ControllerSection] = {}
        self.scene: ViewedStation | None = None  # the station as it is shown

    def draw(self, config: StationConfig, state: State | None = None) -> Vector:
        """Show a station in a state, or as it begins, loaded anew where it looks otherwise; return positions (nq,)."""
        robots = {name: robot.model_copy(update={"servo": None}) for name, robot in config.robots.items()}
        self._controllers = config.controllers
        looks = robots, config.pieces, config.floor, config.mode
        if self.scene is None or looks != self._looks:
            self.scene, self._looks = ViewedStation(config), looks
            self._tell_scene(self.scene, config)
        positions = self.scene.initial if state is None else state.of_plant(self.scene.station)[0]
        self.show(positions)
        return positions

    def show(self, positions: Vector) -> None:
        """Show positions of the whole plant, shape (nq,)."""
        if self.scene is not None and np.isfinite(positions).all():
            self.scene.place(positions)
            self._tell("poses", [*pose_commands(self.scene.query(), _PREFIXES), *self._follow_commands(self.scene)])

    def _follow_commands(self, scene: ViewedStation) -> list[dict[str, Any]]:
        """Commands to the page by which the camera and the floor follow a robot that moves about.

        Such robots are those that walk on feet, and those whose controllers ask for it. The list is empty if there is
        no such robot, or several. The first command is that of the camera.

        Args:
            scene: the station as it is shown.
        """
        of_controllers = robots_to_follow(scene.station.robots, self._controllers)
        robots = scene.station.robots.values()
        followed = [robot for robot in robots if robot.name in of_controllers or (robot.model.feet and robot.floats)]
        if len(followed) != 1:
            return []
        place = scene.pose(followed[0].root).translation()
        return [{"type": "follow", "place": place[:2].round(4).tolist()}, *floor_under(scene, place)]

    def _tell_scene(self, scene: ViewedStation, config: StationConfig) -> None:
        points, azimuth = scene.extents(scene.initial[np.newaxis]), side(scene.station)
        scene.place(scene.initial)
        here = [{**one, "begins": True} for one in self._follow_commands(scene)[:1]]

        def draw(meshcat: Meshcat) -> None:
            draw_geometry(meshcat, scene.query(), _PREFIXES)
            if here and config.floor is not None:
                draw_floor_lines(meshcat, scene, size=config.floor.size)
            look(meshcat, camera_on(points, aspect=self._aspect, azimuth=azimuth))

        self._tell("scene", [{"type": "delete", "path": "/drake/station"}, *commands(draw), *here])


class LiveView:
    """Show runs in a browser at the pace of the clock, or slower where the simulation is slower.

    Hand :meth:`on_step` to ``simulate(on_step=...)``. The view only reads: it makes the run wait, and nothing else.
    """

    def __init__(
        self, config: StationConfig, state: State | None = None, *, steering: "Steering | None" = None
    ) -> None:
        """Open the window with the station in a state, or at its initial posture, and what its user may command there.

        Raises InvalidModel: a robot that cannot be built.
        """
        self._window: Window | None = Window(steering.controls if steering else None)
        if steering:
            steering.board = self._window
        self.url = self._window.url  # where to look; it listens on this computer only
        self._view = StationView(self._window.tell)
        self._next_frame = self._clock_at_zero = 0.0
        self._shown = deque[tuple[float, float]](maxlen=_SPEED_OVER)
        self._paths = 0
        self.draw(config, state)

    def draw(self, config: StationConfig, state: State | None = None) -> None:
        """Show a station in a state, outside of any run; its robots and pieces are loaded anew where they changed."""
        self._view.draw(config, state)
        self._last: tuple[float, Vector] | None = None

    def add_paths(self, result: RecordedRun) -> None:
        """Leave the ways of the tools in a run as lines."""
        number = self._paths
        if self._window is None:
            return
        self._window.tell(f"paths {number}", commands(lambda meshcat: draw_tool_paths(meshcat, result, number)))
        self._paths += 1

    def on_step(self, time: float, positions: Vector) -> None:
        """Show the motion to positions (nq,) at a time [s], in even pictures on a step's straight line."""
        if self._window is None or not np.isfinite(positions).all():
            return
        if self._last is None or time < self._last[0]:
            self._next_frame, self._clock_at_zero = time, perf_counter() - time
            self._shown.clear()
        start, low = self._last if self._last is not None and self._last[0] < time else (time, positions)
        while self._next_frame <= time:
            part = (self._next_frame - start) / (time - start) if time > start else 1.0
            # time that was lost is not made up for
            ahead = self._clock_at_zero + self._next_frame - perf_counter()
            if ahead > 0:
                sleep(ahead)
            elif ahead < -FRAME:
                self._clock_at_zero -= ahead
            self._view.show(low + part * (positions - low))
            self.say(f"{self._next_frame:.2f} s  {self._speed(self._next_frame):.1f} ×")
            self._next_frame += FRAME
        self._last = (time, positions.copy())

    def _speed(self, time: float) -> float:
        """Return how fast it came to a time [s] since the picture of a while before, over the clock's."""
        self._shown.append((time, perf_counter()))
        (begin, then), (end, now) = self._shown[0], self._shown[-1]
        return (end - begin) / (now - then) if end > begin else 1.0

    def say(self, text: str) -> None:
        """Write something over the picture: the time of a run [s], or how it ended."""
        if self._window is not None:
            self._window.tell("said", [{"type": "said", "text": text}])

    def close(self) -> None:
        """Close the window and its port; what comes after is not shown."""
        if self._window is not None:
            self._window.close()
        self._window = None


_STOP = "stop: space"  # label of the button that sets all numbers of a command to zero
_SLIDER_STEPS = 5  # steps of a slider from zero to its upper limit
_SLIDER_DECIMALS = 6  # decimals of a slider's value


class Steering:
    """Controls by which the user of a page commands controllers during a run.

    Each controller that takes commands, such as a walk, has a slider for each number of its command, and a button that
    sets all of them to zero.

    Attributes:
        controls: controls of the page, by label. With several commanded controllers, the label begins with the name of
            the controller. Only those of the first controller have keys.
        hands: functions that command the controllers, as ``simulate(commands=...)`` takes them. They return None until
            the user touches a control.
        board: the page. It shows where the program has set the sliders.
    """

    def __init__(self, config: StationConfig) -> None:
        """Make the controls for a station. There are none if no controller takes commands."""
        sections = commanded_sections(config.controllers)
        self.controls = dict[str, Control]()
        self.hands: dict[str, Callable[[float], tuple[float, ...] | None]] = {}
        self._shown = dict[str, float]()
        station = resolve(config)
        for number, (name, section) in enumerate(sections.items()):
            prefix = f"{name}: " if len(sections) > 1 else ""
            robot = station.robot(section.robot_name, f"controllers.{name}")
            self.controls |= _controls(section, robot, prefix, keys=number == 0)
            self.hands[name] = partial(self._command, prefix, section)
        self.board: Board | None = None
        self._begun = set[str]()

    def _command(self, prefix: str, section: ControllerSection, time: float) -> tuple[float, ...] | None:
        """Command that the user has set for a controller, by the sliders or the stop button.

        Until the user touches a control, the sliders are set to the command of the section.

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
            stop.value = 0.0
            self._show(sliders, [0.0] * len(sliders))
            self._begun.add(prefix)
        # A slider is not where the program has set it: the user has moved it.
        if any(self.controls[name].value != self._shown.get(name, 0.0) for name in sliders):
            self._begun.add(prefix)
        if prefix not in self._begun:
            numbers_of_section = zip(section.command_at(time), parts, strict=True)
            # Rounding removes the error of the conversion to the slider's unit, such as from radians to degrees.
            shown = [round(value / part.slider_unit, _SLIDER_DECIMALS) for value, part in numbers_of_section]
            self._show(sliders, shown)
            return None
        values = [round(self.controls[name].value, _SLIDER_DECIMALS) for name in sliders]
        return tuple(value * part.slider_unit for value, part in zip(values, parts, strict=True))

    def _show(self, sliders: Sequence[str], values: Sequence[float]) -> None:
        """Put sliders where the program has them."""
        for name, value in zip(sliders, values, strict=True):
            if self.controls[name].value != value:
                self.controls[name].value = value
                if self.board is not None:
                    self.board.show(name)
            self._shown[name] = value


def _controls(section: ControllerSection, robot: ResolvedRobot, prefix: str, *, keys: bool) -> dict[str, Control]:
    """Make the sliders and the stop button of a controller, by label.

    Args:
        section: section of the controller.
        robot: robot of the controller.
        prefix: beginning of the labels.
        keys: whether keys of the browser move the sliders, too.
    """
    controls = dict[str, Control]()
    # The limits are in the units of the sliders.
    for part, (lower, upper) in zip(section.command_parts, section.command_limits(robot), strict=True):
        down, up = part.keys if keys else ("", "")
        controls[prefix + part.label] = Control(
            value=0.0,
            low=lower,
            high=upper,
            step=(upper or 1.0) / _SLIDER_STEPS,  # a slider takes no step of 0, which an upper limit of 0 would give
            key=down or None,
            key_up=up or None,
        )
    controls[prefix + _STOP] = Control(key="Space" if keys else None)
    return controls
