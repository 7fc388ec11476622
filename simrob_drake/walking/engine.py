"""The walking engine: from a command, and what the robot does, to a posture at each sample; in three parts."""

from collections.abc import Sequence

from simrob_drake.frames import Vector
from simrob_drake.walking.body import Body, Seen, StanceFeet
from simrob_drake.walking.estimator import Estimate, Estimator
from simrob_drake.walking.height_map import HeightMap
from simrob_drake.walking.parameters import WalkingParameters
from simrob_drake.walking.planner import WalkPlanner
from simrob_drake.walking.poser import Poser
from simrob_drake.walking.steps import Command, Landing
from simrob_drake.walking.stride import Ground, Step, Stride, Swing, Trunk

_FIRST_ROUNDS, _SETTLINGS = 10, 12  # of Newton's method, from a posture that may be far away; of the centre of mass


class Engine:
    """Makes a walk, sample by sample; it remembers nothing but what a :class:`Stride` and a posture tell.

    Attributes:
        body: the robot's kinematics.
        estimator: what the robot does.
        planner: where steps land, and when.
        poser: the legs.
        max_speed: that the legs can follow.
    """

    def __init__(
        self,
        body: Body,
        parameters: WalkingParameters,
        groups: Sequence[Sequence[int]],
        period: float,
        height_map: HeightMap | None = None,
    ) -> None:
        """Prepare.

        Args:
            body: the robot's kinematics.
            parameters: of its walk.
            groups: the feet that stand and swing together, the right ones first.
            period: between samples [s].
            height_map: of the ground; None: nothing is known of that but what is felt.
        """
        self.body, self._height, self.max_speed = body, parameters.bearing.height, parameters.max_speed
        self.stance = StanceFeet.of(body, parameters, groups)
        self.estimator = Estimator(body, self.stance, parameters.feedback)
        self.planner = WalkPlanner(parameters, self.stance, period, height_map)
        self.poser = Poser(body, self.stance, parameters.bearing)

    def standing(self, posture: Vector, slope: complex = 0j) -> tuple[Stride, Vector]:
        """Return a stride in which both feet stand side by side, and its posture (n,), found from one that is alike."""
        steps = self.planner.steps
        foot = steps.apart[0]
        middle = steps.middle(1, foot)
        trunk, landing = Trunk(com=middle, zmp=middle), Landing(0.0, foot)
        stride = Stride(Step(zmp_from=middle), Swing(foot), landing, trunk, Ground(slope=slope))
        for _ in range(_SETTLINGS):
            self.body.take(posture)
            posture = self.poser.posture(stride, self.body.centre(), 0.0, _FIRST_ROUNDS)
        return stride, posture

    def estimate(self, stride: Stride, seen: Seen, forces: Sequence[float] | None = None) -> Estimate:
        """Return what the robot does; see :meth:`Estimator.estimate`."""
        return self.estimator.estimate(stride, seen, forces)

    def sample(
        self, stride: Stride, posture: Vector, command: Command, estimate: Estimate | None
    ) -> tuple[Stride, Vector]:
        """Return where a walk is a sample later, and its posture (n,); without feedback if there is no estimate."""
        self.body.take(posture)
        centre = self.body.centre()
        omega = self.stance.omega(self._height + centre[2])
        now, lift, later = self.planner.sample(stride, command, estimate, omega)
        return later, self.poser.posture(now, centre, lift)
