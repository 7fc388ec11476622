"""A robot in the browser, with a slider for every joint."""

import gc
import math
from time import monotonic, sleep

import numpy as np
from pydrake.geometry import MeshcatVisualizer, MeshcatVisualizerParams, Role
from pydrake.multibody.meshcat import JointSliders
from pydrake.visualization import AddFrameTriadIllustration

from simrob_drake.results.animation.camera import camera_on
from simrob_drake.results.animation.recording import ASPECT, look, open_meshcat
from simrob_drake.robots.catalog import RobotModel
from simrob_drake.robots.parse import lone_robot

_TRIAD = 0.12  # length of a tool frame's axes, as a part of the robot's size
_STOP = "Stop"
_FRAME = 1 / 30  # s between two looks at the sliders
_SMALLEST = 0.1  # what a robot's size counts as, at least [m]
_WITHOUT_LIMITS = np.pi  # how far a slider goes where the joint has no limit [rad or m]


class RobotView:
    """Show a robot on its foot in Meshcat: links, tool frames, and collision geometry that can be switched on.

    Attributes:
        url: where to look; it listens on this computer only.
    """

    def __init__(self, robot: RobotModel) -> None:
        """Open the window, with the robot at its home posture.

        Args:
            robot: what to show.

        Raises:
            InvalidModel: a robot that cannot be built.
        """
        self._meshcat = open_meshcat()
        self.url: str = self._meshcat.web_url()
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
        for role, prefix in ((Role.kIllustration, "robot"), (Role.kProximity, "collision")):
            shown = role == Role.kIllustration
            params = MeshcatVisualizerParams(role=role, prefix=prefix, visible_by_default=shown)
            MeshcatVisualizer.AddToBuilder(builder, lone.scene_graph, self._meshcat, params)
        limits = {"lower_limit": -_WITHOUT_LIMITS, "upper_limit": _WITHOUT_LIMITS}
        self._sliders = builder.AddSystem(JointSliders(self._meshcat, plant, **limits))
        self._diagram = builder.Build()
        margin = np.array([[-1.0], [1.0]]) * size / 4
        look(self._meshcat, camera_on(np.vstack([lone.origins() + side for side in margin]), aspect=ASPECT))

    def run(self, timeout: float = math.inf) -> None:
        """Move the robot as the sliders say, until "Stop" is pressed in the browser or ``timeout`` [s] is over.

        The loop is ours, since that of ``JointSliders`` lets no Ctrl+C through.
        """
        context = self._diagram.CreateDefaultContext()
        own, of_plant = (part.GetMyMutableContextFromRoot(context) for part in (self._sliders, self._plant))
        end, shown = monotonic() + timeout, np.empty(0)
        self._meshcat.AddButton(_STOP, "Escape")
        while self._meshcat.GetButtonClicks(_STOP) == 0 and monotonic() < end:
            wanted = self._sliders.get_output_port().Eval(own)
            if not np.array_equal(wanted, shown):
                self._plant.SetPositions(of_plant, wanted)
                self._diagram.ForcedPublish(context)
                shown = wanted
            sleep(_FRAME)
        self._meshcat.DeleteButton(_STOP)

    def sliders(self) -> dict[str, float]:
        """Return where the slider of each joint is [rad or m]."""
        return {name: self._meshcat.GetSliderValue(name) for name in self._meshcat.GetSliderNames()}

    def close(self) -> None:
        """Close the window and its port."""
        del self._sliders, self._plant, self._diagram, self._meshcat
        gc.collect()  # Drake's diagrams are cycles: without this Meshcat would go on listening for a while
