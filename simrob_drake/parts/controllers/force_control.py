r"""A loop that presses with a force that is asked for: the tool moves along a direction until a sensor feels it.

With the error e of the force, the tool's path x along the direction d has the speed

.. math:: \dot x = \mathrm{clip}(k_p e + z, \pm v), \qquad \dot z = k_i e, \qquad |x| \le x_{max},

where z stands still unless the force is near what is asked for and the speed within its bound, so that it does not wind
up on the way there; v is slower until the tool touches. A surface that comes nearer steadily, or an arm that sags more
and more, then leaves no error. The joints' offsets follow so that the tool is displaced by x d from where the reference
has it, and not turned, with the Jacobian J at that posture:

.. math:: \Delta q = J^\top (J J^\top + \lambda^2)^{-1} \begin{pmatrix} \text{turn left} \\ \text{way left}
    \end{pmatrix} .
"""

import weakref
from typing import Annotated, ClassVar, Literal

import numpy as np
from pydantic import AfterValidator
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import Frame, JacobianWrtVariable

from simrob_drake.blocks.sampled import Changes, Named, SampledBlock
from simrob_drake.errors import InvalidParameter
from simrob_drake.frames import Vector
from simrob_drake.parts.controllers.loop import LoopSection, check_force_is_read
from simrob_drake.parts.site import WORLD, Site, StationRobot, Surroundings
from simrob_drake.parts.targets import frame_of
from simrob_drake.robots.axis_map import AxisMap
from simrob_drake.sections import NotNegative, Positive, Triple

_DAMPED = 1e-6 * np.eye(6)
"""The damping of the least squares, squared: near a singularity joints move less, elsewhere it does not show."""

_NEAR = 0.2
"""How near the force must be to what is asked for, as a part of that, for the integral to act."""


def _unit(direction: Triple) -> Triple:
    size = float(np.linalg.norm(direction))
    if size == 0:
        raise ValueError("a direction of length zero points nowhere")
    x, y, z = (entry / size for entry in direction)
    return x, y, z


class ForceControl(LoopSection):
    """Press with the tool: move it along a direction until a force sensor feels what is asked for.

    That is named by `reads: {force: <sensor>}`. It moves all axes of its robot; in the other directions the tool stays
    as the reference has it.
    """

    stages: ClassVar[tuple[str, ...]] = ("Error of the force", "PI law\npath of the tool", "Jacobian\njoint offsets")

    kind: Literal["force_control"]
    force: Positive
    """With what force to press [N]."""
    direction: Annotated[Triple, AfterValidator(_unit)] = (0.0, 0.0, -1.0)
    """Where to, in the axes of the sensor's `frame`: those of the world unless that says otherwise."""
    kp: Positive = 0.003
    """How fast the tool moves for an error [m/(s·N)]."""
    ki: NotNegative = 0.003
    """How fast that speed grows [m/(s²·N)]; 0 for none."""
    approach: Positive = 0.01
    """How fast it may move while it touches nothing [m/s]."""
    speed: Positive = 0.05
    """How fast otherwise [m/s]."""
    reach: Positive = 0.05
    """How far it may be from where the reference has it [m]."""

    def check(self, key: str, station: Surroundings) -> None:
        """Check what is known before anything is built."""
        super().check(key, station)
        check_force_is_read(self, key)
        if not station.robot(self.robot, key).tcp:
            raise InvalidParameter(key, "for a robot without a tool", "for one that presses with a tool or a piece")

    def block(self, key: str, robot: StationRobot, site: Site) -> SampledBlock:
        """Return the loop."""
        sensor = frame_of(site.plant, getattr(site.station.sensors.get(self.reads["force"]), "frame", WORLD))
        return PressingTool(self, site.plant.plant, robot.axis_map, robot.tools[robot.tcp], sensor)


class PressingTool(SampledBlock):
    """PI control of the force on a tool by moving it along a direction.

    Ports:
        in  ``force`` (3) [N]: on the tool, in the axes of the sensor; ``asked`` (n) [rad]: the reference of the joints.
        out ``offset`` (n) [rad]: to be added to it; ``pressing`` (1) [N]: against the direction; ``path`` (1) [m].
    """

    def __init__(self, section: ForceControl, plant: MultibodyPlant, axes: AxisMap, tool: Frame, sensor: Frame) -> None:
        """Make the block.

        Args:
            section: its parameters.
            plant: finalized; it need not be part of the diagram. What is no axis stands there as at the start.
            axes: of the robot, among the plant's.
            tool: that is moved.
            sensor: the frame in whose axes force and direction are given.
        """
        size, one = len(axes.signs), np.zeros(1)
        self.units = {"offset": "rad", "pressing": "N", "path": "m"}
        memory = {"offset": np.zeros(size), "pressing": one, "path": one}
        reads, outputs = {"force": 3, "asked": size}, list(memory)
        super().__init__(period=1 / section.rate, reads=reads, memory={**memory, "drift": one}, gives=outputs)
        self._plant, self._axes, self._tool, self._sensor = weakref.proxy(plant), axes, tool.index(), sensor.index()
        self._scratch = plant.CreateDefaultContext()  # nothing is remembered in it: every evaluation sets it anew
        self._rest = plant.GetPositions(self._scratch)
        self._section, self._direction = section, np.array(section.direction)

    def sample(self, memory: Named, read: Named) -> Changes:
        """Return how far the tool and the joints are to be moved now."""
        pressing = float(-self._direction @ read["force"])
        path, drift = self.next_path(memory["path"][0], memory["drift"][0], pressing)
        offset = self.joints(memory["offset"], read["asked"], path)
        return {"pressing": pressing, "path": path, "drift": drift, "offset": offset}

    def next_path(self, path: float, drift: float, pressing: float) -> tuple[float, float]:
        """Return x [m] and z [m/s] by what they were, and by the force [N]."""
        section = self._section
        error, fastest = section.force - pressing, section.speed if pressing > 0 else section.approach
        desired = section.kp * error + drift
        speed = min(max(desired, -fastest), fastest)
        if abs(error) < _NEAR * section.force and speed == desired:
            drift += section.ki * error * self.period
        return min(max(path + speed * self.period, -section.reach), section.reach), drift

    def joints(self, offset: Vector, reference: Vector, path: float) -> Vector:
        """Return offsets (n,) [rad], from the last ones on, that put the tool ``path`` [m] beside the reference."""
        plant, context, axes = self._plant, self._scratch, self._axes
        world, tool, sensor = plant.world_frame(), plant.get_frame(self._tool), plant.get_frame(self._sensor)
        plant.SetPositions(context, axes.spread_positions(reference, self._rest))
        target = tool.CalcPoseInWorld(context)
        along = sensor.CalcRotationMatrixInWorld(context) @ self._direction
        plant.SetPositions(context, axes.spread_positions(reference + offset, self._rest))
        now = tool.CalcPoseInWorld(context)
        turn = (target.rotation() @ now.rotation().inverse()).ToAngleAxis()
        left = np.empty(6)
        left[:3] = turn.angle() * turn.axis()
        left[3:] = target.translation() + path * along - now.translation()
        jacobian = axes.velocities(
            plant.CalcJacobianSpatialVelocity(context, JacobianWrtVariable.kV, tool, np.zeros(3), world, world)
        )
        return np.asarray(offset + jacobian.T @ np.linalg.solve(jacobian @ jacobian.T + _DAMPED, left))
