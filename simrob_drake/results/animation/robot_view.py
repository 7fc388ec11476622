"""A robot in the browser, with a slider for every joint, in degrees where it turns."""

import math
from time import monotonic, sleep

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

_TRIAD = 0.12  # length of a tool frame's axes, as a part of the robot's size
_STOP = "Stop"
_FRAME = 1 / 30  # s between two looks at the sliders
_DEGREES, _METRES = " [°]", " [m]"  # what follows the name on a slider
_STEPS = {_DEGREES: 0.5, _METRES: 0.001}  # of a slider
_PREFIXES = {"robot": Role.kIllustration, "collision": Role.kProximity}
_SMALLEST = 0.1  # what a robot's size counts as, at least [m]
_WITHOUT_LIMITS = {_DEGREES: 180.0, _METRES: 1.0}  # how far a slider goes where the joint has no limit


class RobotView:
    """Show a robot on its foot in Meshcat: links, tool frames, and collision geometry that can be switched on."""

    def __init__(self, robot: RobotModel) -> None:
        """Open the window, with the robot at its home posture; raises InvalidModel: it cannot be built."""
        lone = lone_robot(robot)
        builder, size = lone.builder, max(lone.size, _SMALLEST)
        self._plant = plant = lone.plant
        for frame in robot.tools.values():
            AddFrameTriadIllustration(
                scene_graph=lone.scene_graph,
                plant=plant,
                frame=plant.GetFrameByName(frame, lone.instance),
                length=_TRIAD * size,
                radius=_TRIAD * size / 25,
            )
        self._diagram = builder.Build()
        self._context = self._diagram.CreateDefaultContext()
        self._query = lone.scene_graph.get_query_output_port()
        self._window = Window(_sliders(plant) | {_STOP: Control(key="Escape")})
        self.url = self._window.url  # where to look; it listens on this computer only
        margin = np.array([[-1.0], [1.0]]) * size / 4
        camera = camera_on(np.vstack([lone.origins() + side for side in margin]), aspect=WINDOW_ASPECT)

        def draw(meshcat: Meshcat) -> None:
            draw_geometry(meshcat, self._geometry(), _PREFIXES, hidden="collision")
            look(meshcat, camera)

        self._window.tell("robot", commands(draw))

    def run(self, timeout: float = math.inf) -> None:
        """Move the robot as the sliders say, until "Stop" is pressed in the browser or ``timeout`` [s] is over."""
        of_plant = self._plant.GetMyMutableContextFromRoot(self._context)
        end, shown = monotonic() + timeout, np.empty(0)
        while not self._window.controls[_STOP].value and monotonic() < end:
            moved = np.array(list(self.sliders().values()))
            if not np.array_equal(moved, shown):
                self._plant.SetPositions(of_plant, moved)
                self._window.tell("poses", pose_commands(self._geometry(), _PREFIXES))
                shown = moved
            sleep(_FRAME)

    def sliders(self) -> dict[str, float]:
        """Return where the slider of each joint is [rad or m]."""
        set_at = {name: control.value for name, control in self._window.controls.items() if name != _STOP}
        return {
            name.removesuffix(_DEGREES).removesuffix(_METRES): math.radians(value) if name.endswith(_DEGREES) else value
            for name, value in set_at.items()
        }

    def close(self) -> None:
        """Close the window and its port."""
        self._window.close()

    def _geometry(self) -> QueryObject:
        graph = self._query.get_system()
        query: QueryObject = self._query.Eval(graph.GetMyContextFromRoot(self._context))
        return query


def _sliders(plant: MultibodyPlant) -> dict[str, Control]:
    """Return a slider for each of the plant's positions, in their order, where they are by default."""
    names = plant.GetPositionNames(add_model_instance_prefix=False, always_add_suffix=False)
    units = [_METRES] * len(names)
    for joint in map(plant.get_joint, plant.GetJointIndices()):
        if joint.type_name() == RevoluteJoint.kTypeName:
            units[joint.position_start()] = _DEGREES
    scales = np.where(np.array(units) == _DEGREES, 180 / np.pi, 1.0)
    far = np.array([_WITHOUT_LIMITS[unit] for unit in units])
    values = scales * plant.GetPositions(plant.CreateDefaultContext())
    lower, upper = scales * plant.GetPositionLowerLimits(), scales * plant.GetPositionUpperLimits()
    lower, upper = np.where(np.isfinite(lower), lower, -far), np.where(np.isfinite(upper), upper, far)
    sliders = zip(names, units, values.tolist(), lower.tolist(), upper.tolist(), strict=True)
    return {name + unit: Control(value, low, high, _STEPS[unit]) for name, unit, value, low, high in sliders}
