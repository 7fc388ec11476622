"""A robot in the browser, with a slider for every joint.

The sliders of joints that turn are in degrees, those of joints that slide in metres. The unit follows the name of the
joint in the label of its slider.
"""

import math
from time import monotonic, sleep
from typing import NamedTuple

import numpy as np
from pydrake.geometry import Meshcat, QueryObject, Role
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import RevoluteJoint
from pydrake.visualization import AddFrameTriadIllustration

from simrob_drake.results.animation.camera import WINDOW_ASPECT, camera_on
from simrob_drake.results.animation.drawn import commands, draw_geometry, look, pose_commands
from simrob_drake.results.animation.window import Control, Window
from simrob_drake.robots.catalog import RobotModel
from simrob_drake.robots.parse import lone_robot

_TRIAD = 0.12
"""Length of the axes of a tool's frame, as a part of the robot's size."""

_STOP = "Stop"
"""Label of the button that ends the view."""

_FRAME = 1 / 30
"""Time between two readings of the sliders [s]."""

_SMALLEST = 0.1
"""Least size of a robot for the camera [m]."""

_PREFIXES = {"robot": Role.kIllustration, "collision": Role.kProximity}
"""Path in Meshcat's tree of the visible shapes, and of those for collisions."""


class _SliderUnit(NamedTuple):
    """Unit of a slider.

    Attributes:
        suffix: end of the label.
        scale: factor from the unit of the joint, rad or m.
        step: step of the slider.
        reach: largest value, in both directions, of a joint without limits.
    """

    suffix: str
    scale: float
    step: float
    reach: float


_DEGREES = _SliderUnit(" [°]", 180 / np.pi, step=0.5, reach=180.0)
_METRES = _SliderUnit(" [m]", 1.0, step=0.001, reach=1.0)


class RobotView:
    """A robot in a browser window, fixed at its root: links, tool frames, and collision shapes that can be switched on.

    Attributes:
        url: address of the window. It can be opened on this computer only.
    """

    def __init__(self, robot: RobotModel) -> None:
        """Start the window's server, with the robot at its home posture. The user opens `url` in a browser.

        Args:
            robot: the robot.

        Raises:
            InvalidModel: the robot cannot be built.
        """
        lone = lone_robot(robot)
        size = max(lone.size, _SMALLEST)
        plant = lone.plant
        for frame in robot.tools.values():
            AddFrameTriadIllustration(
                scene_graph=lone.scene_graph,
                plant=plant,
                frame=plant.GetFrameByName(frame, lone.instance),
                length=_TRIAD * size,
                radius=_TRIAD * size / 25,
            )
        self._plant = plant
        self._diagram = lone.builder.Build()
        self._context = self._diagram.CreateDefaultContext()
        self._query = lone.scene_graph.get_query_output_port()
        self._window = Window(_sliders(plant) | {_STOP: Control(key="Escape")})
        self.url = self._window.url
        # The links are thicker than their origins: a quarter of the robot's size is enough around them.
        margin = size / 4
        origins = lone.origins()
        camera = camera_on(np.vstack([origins - margin, origins + margin]), aspect=WINDOW_ASPECT)

        def draw(meshcat: Meshcat) -> None:
            draw_geometry(meshcat, self._geometry(), _PREFIXES, hidden="collision")
            look(meshcat, camera)

        self._window.tell("robot", commands(draw))

    def run(self, timeout: float = math.inf) -> None:
        """Move the robot with the sliders until the user presses "Stop", or the time is over.

        Args:
            timeout: longest time [s].
        """
        plant_context = self._plant.GetMyMutableContextFromRoot(self._context)
        end = monotonic() + timeout
        shown = np.empty(0)  # different from any positions, so that the first are shown
        while not self._window.controls[_STOP].value and monotonic() < end:
            positions = np.array(list(self.sliders().values()))
            # Nothing is sent while no slider moves: the page would draw the same picture thirty times a second.
            if not np.array_equal(positions, shown):
                self._plant.SetPositions(plant_context, positions)
                self._window.tell("poses", pose_commands(self._geometry(), _PREFIXES))
                shown = positions
            sleep(_FRAME)

    def sliders(self) -> dict[str, float]:
        """Positions of the sliders by the name of the joint, in the order of the plant's positions [rad or m]."""
        positions = {}
        for label, control in self._window.controls.items():
            # The button to stop has no unit, so that it is none of them.
            if label.endswith(_DEGREES.suffix):
                positions[label.removesuffix(_DEGREES.suffix)] = math.radians(control.value)
            elif label.endswith(_METRES.suffix):
                positions[label.removesuffix(_METRES.suffix)] = control.value
        return positions

    def close(self) -> None:
        """Close the window and its port."""
        self._window.close()

    def _geometry(self) -> QueryObject:
        """Drake's query object for the shapes of the robot at its present positions."""
        graph = self._query.get_system()
        query: QueryObject = self._query.Eval(graph.GetMyContextFromRoot(self._context))
        return query


def _sliders(plant: MultibodyPlant) -> dict[str, Control]:
    """Make a slider for each of the plant's positions, in their order and at their default.

    Returns:
        the sliders by label: the name of the position, which is that of its joint, and the unit.
    """
    names = plant.GetPositionNames(add_model_instance_prefix=False, always_add_suffix=False)
    units = [_METRES] * len(names)
    for index in plant.GetJointIndices():
        joint = plant.get_joint(index)
        # Other joints with a position slide.
        if joint.type_name() == RevoluteJoint.kTypeName:
            units[joint.position_start()] = _DEGREES
    scales = np.array([unit.scale for unit in units])
    reaches = np.array([unit.reach for unit in units])
    values = scales * plant.GetPositions(plant.CreateDefaultContext())
    lower = scales * plant.GetPositionLowerLimits()
    upper = scales * plant.GetPositionUpperLimits()
    # A joint without limits has infinite ones, which a slider cannot have.
    lower = np.where(np.isfinite(lower), lower, -reaches)
    upper = np.where(np.isfinite(upper), upper, reaches)
    sliders = {}
    for index, (name, unit) in enumerate(zip(names, units, strict=True)):
        value = float(values[index])
        sliders[name + unit.suffix] = Control(
            value, float(lower[index]), float(upper[index]), unit.step
        )
    return sliders
