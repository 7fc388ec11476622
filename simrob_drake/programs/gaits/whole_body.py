r"""From the planned paths of feet and zero-moment point (ZMP) to the joint angles of the whole robot.

The trunk first follows the linear inverted pendulum. The motion that results has another zero-moment point than the
desired one, because legs and arms have masses of their own. The missing part of the ZMP drives the pendulum again,
and the trunk is moved by its answer (preview of the error: Kajita 2003). After a few rounds the error is in the
millimetres. All of this is computed in the frame of the ground: on a slope gravity is inclined, and the trunk stays
upright against it.

The *root* is the link of the trunk on which the legs hang. The *lean* of the trunk is its turn about the direction
ahead, to the right [rad]. The *bearing* of a gait is how the robot holds its trunk and its arms.

A trunk on legs without ankle roll cannot move sideways while the soles stay flat: it leans instead. Its lean
:math:`\varphi` moves the centre of mass by :math:`k\varphi`, and acts like a pendulum of another height, :math:`Z/k`
with :math:`Z = \sum m (z\,\partial y/\partial\varphi - y\,\partial z/\partial\varphi) / \sum m`.
"""

from typing import NamedTuple

import numpy as np

from simrob_drake.base.frames import Vector
from simrob_drake.base.interpolation import stack_poses
from simrob_drake.programs.gaits.legs import leg_angles
from simrob_drake.programs.gaits.motion import JointMotion, SolvedGait
from simrob_drake.programs.gaits.phases import SAMPLE, GaitPlan
from simrob_drake.programs.gaits.walker import (
    UP,
    Walker,
    exchange_sides,
    facing_rotation,
    rolled_distances,
    rotations_about,
    upright_rotation,
)
from simrob_drake.programs.gaits.zmp import com_from_zmp, whole_body_zmp
from simrob_drake.results.record.history import parts

AHEAD = np.array([1.0, 0.0, 0.0])
LEFT = np.array([0.0, 1.0, 0.0])

ROUNDS = 4
"""Count of rounds in which the error of the zero-moment point is reduced."""

_AXES_WITHOUT_ANKLE_ROLL = 4  # count of axes of a leg without yaw at the hip and roll at the ankle
_SMALL_LEAN = 1e-3  # lean by which the effect of a lean is measured [rad]


class _StartPosture(NamedTuple):
    """Posture at the start of a plan, and the pendulums that describe the robot in it.

    Attributes:
        angles: angles of all axes, shape (n,) [rad].
        com_height: height of the centre of mass [m].
        com_per_lean: how far the centre of mass moves to the left by a lean to the right, k of the module [m/rad]. It
            has no meaning if the robot does not lean.
        lean_height: height of the pendulum that answers to the ZMP as a lean does, Z/k of the module [m]. It has no
            meaning if the robot does not lean.
    """

    angles: Vector
    com_height: float
    com_per_lean: float
    lean_height: float


class WholeBody:
    """Solves the postures of a robot for a plan of its feet and its zero-moment point."""

    def __init__(self, walker: Walker, gait: SolvedGait, plan: GaitPlan) -> None:
        """Prepare the solution.

        Args:
            walker: the robot and its conditions.
            gait: gait whose parameters say how the robot holds its trunk and its arms.
            plan: sampled paths of the feet and of the ZMP.
        """
        self.walker = walker
        self.gait = gait
        self.plan = plan
        self.skeleton = walker.skeleton
        self.facing_deg = walker.gaits.facing_deg

        # Angles of the axes that are in no leg: a constant part (n,) [rad], a part per radian of lean to the right
        # (n,) [rad/rad], and a part per metre that the left foot is ahead of the right one (n,) [rad/m].
        model = walker.model
        bearing = gait.bearing
        self._posture = np.deg2rad(model.axis_vector(bearing.posture_deg, "posture_deg"))
        self._arms_per_lean = model.axis_vector(bearing.lean_arms_deg, "lean_arms_deg")
        self._arms_per_stride = np.deg2rad(
            model.axis_vector(bearing.swing_arms_deg, "swing_arms_deg")
        )

        self._upright = upright_rotation(walker.gravity)
        self._kind = gait.feet
        self.feet = walker.feet(self._kind)
        self.leans = any(len(foot.axes) == _AXES_WITHOUT_ANKLE_ROLL for foot in self.feet)
        # How far each foot that is a ball has rolled since its touchdown, shape (m, 2) [m].
        self._rolled = {foot.name: np.zeros((len(plan.times), 2)) for foot in self.feet}

    def solve(self, rounds: int = ROUNDS) -> tuple[JointMotion, Vector]:
        """Solve the plan: compute the joint angles with which the whole robot has the planned ZMP.

        Args:
            rounds: count of rounds in which the error of the zero-moment point is reduced.

        Returns:
            The motion in the world, and its zero-moment point if no foot slips, in the frame of the plan,
            shape (m, 2) [m].

        Raises:
            OutOfReach: a leg is too short for the path of its foot, or a joint is beyond a limit.
            InvalidParameter: a leg has neither three, four nor six joints, or the plan has fewer than three samples.
        """
        count = len(self.plan.times)
        start = self._start_posture()
        angles = np.tile(start.angles, (count, 1))
        desired = self.plan.zmp
        pull = -float(self.walker.gravity[2])  # gravity towards the ground [m/s²]

        # First, while no error is known, the root link moves as the mass of the linear inverted pendulum. `position` is
        # its x and y, shape (m, 2) [m].
        position = com_from_zmp(desired, step=SAMPLE, height=start.com_height, gravity=pull)
        lean = np.zeros(count)
        angles, root = self._postures(position, lean, angles)
        zmp = whole_body_zmp(self.skeleton, root, angles, SAMPLE, self.walker.gravity)
        for _ in range(rounds):
            # The motion by which the pendulum would have the missing ZMP is added to that of the trunk.
            missing = desired - zmp
            move = com_from_zmp(missing, step=SAMPLE, height=start.com_height, gravity=pull)
            if self.leans:
                # The lean replaces the sideways move of the trunk. A lean by an angle moves the centre of mass by
                # `com_per_lean` times the angle.
                lean_move = com_from_zmp(
                    missing[:, 1:], step=SAMPLE, height=start.lean_height, gravity=pull
                )
                lean = lean + lean_move[:, 0] / start.com_per_lean
                move[:, 1] = 0.0
            position = position + move
            self._update_rolled(angles, root)
            angles, root = self._postures(position, lean, angles)
            zmp = whole_body_zmp(self.skeleton, root, angles, SAMPLE, self.walker.gravity)
        return self._motion_in_world(angles, root), zmp

    def _postures(self, position: Vector, lean: Vector, angles: Vector) -> tuple[Vector, Vector]:
        """Solve the legs for a motion of the trunk, a part of the samples at a time to save memory.

        Args:
            position: horizontal position of the root link, shape (m, 2) [m].
            lean: lean of the trunk to the right, shape (m,) [rad].
            angles: angles of all axes from which the inverse kinematics begins, shape (m, n) [rad].

        Returns:
            Angles of all axes (m, n) [rad], and poses of the root link (m, 4, 4).
        """
        result = angles.copy()
        root = np.empty((len(lean), 4, 4))
        for part in parts(len(lean)):
            result[part], root[part] = self._postures_of(
                part, position[part], lean[part], result[part]
            )
        return result, root

    def _postures_of(
        self,
        part: slice,
        position: Vector,
        lean: Vector,
        angles: Vector,
    ) -> tuple[Vector, Vector]:
        """Solve a part of the samples, see :meth:`_postures`.

        Args:
            part: the samples of the plan that are solved.
            position: horizontal position of the root link in this part, shape (k, 2) [m].
            lean: lean of the trunk to the right, shape (k,) [rad].
            angles: angles from which the inverse kinematics begins, shape (k, n) [rad].

        Returns:
            Angles of all axes (k, n) [rad], and poses of the root link (k, 4, 4). Legs that cannot place their feet
            sideways move the root from the given position.

        Raises:
            OutOfReach: a leg is too short for the path of its foot, or a joint is beyond a limit.
        """
        plan = self.plan
        bearing = self.gait.bearing
        count = len(lean)

        # Rotation of the root, from its own link frame (on the right) outward: to look along x, leaned, pitched, turned
        # to the heading, and upright against gravity.
        turned = rotations_about(UP, plan.heading[part])
        pitched = rotations_about(LEFT, np.full(count, np.deg2rad(bearing.pitch_deg)))
        leaned = rotations_about(AHEAD, lean)
        rotation = self._upright @ (turned @ pitched @ leaned) @ facing_rotation(self.facing_deg)
        # The height of the ground may be one number for all samples.
        height = bearing.height + np.broadcast_to(plan.ground, len(plan.times))[part]
        root = stack_poses(np.column_stack([position, height]), rotation)

        angles = self._set_free_axes(part, angles, lean)
        sideways = np.zeros(count)  # how far the feet have to be moved to the left on average [m]
        for foot in self.feet:
            path = plan.feet[foot.name][part]  # x, y, height and turn of the sole
            # The point of the foot, the middle of its contact, is above its sole. A ball has rolled on the ground.
            goal = path[:, :3] + foot.over * UP
            goal[:, :2] += self._rolled[foot.name][part]
            target = stack_poses(goal, rotations_about(UP, path[:, 3]))
            angles = leg_angles(self.skeleton.model, foot, target, root, angles, plan.times[part])
            if self.leans:
                # Such a leg cannot place its foot sideways, see the module: the error moves the root instead.
                error = goal - foot.poses(angles, root)[:, :3, 3]
                sideways += error[:, 1] / len(self.feet)
        root[:, 1, 3] += sideways
        return angles, root

    def _update_rolled(self, angles: Vector, root: Vector) -> None:
        """Store how far each foot that is a ball rolls in a motion, for the next round.

        Args:
            angles: angles of all axes, shape (m, n) [rad].
            root: poses of the root link, shape (m, 4, 4).
        """
        for foot in self.feet:
            if foot.is_ball:
                rotations = foot.poses(angles, root)[:, :3, :3]
                standing = self.plan.stands(foot.name)
                self._rolled[foot.name] = rolled_distances(rotations, standing, foot.over)

    def _set_free_axes(self, part: slice, angles: Vector, lean: Vector) -> Vector:
        """Replace the angles of the axes that are in no leg, such as those of the arms.

        Args:
            part: the samples of the plan that are solved.
            angles: angles of all axes, shape (k, n) [rad].
            lean: lean of the trunk to the right, shape (k,) [rad].

        Returns:
            A copy of the angles in which the free axes have their posture, the counterweight of the lean, and a swing
            with the steps.
        """
        leg_axes = {axis for foot in self.feet for axis in foot.axes}
        free_axes = [axis for axis in range(angles.shape[1]) if axis not in leg_axes]
        feet = self.plan.feet
        stride = 0.0 * lean  # how far the left foot is ahead of the right one, shape (k,) [m]
        if "left_foot" in feet:  # only a robot on two legs swings its arms
            stride = feet["left_foot"][part, 0] - feet["right_foot"][part, 0]
        # A lean to the left moves the arms as the mirror image of a lean to the right.
        right = np.maximum(lean, 0.0)
        left = np.maximum(-lean, 0.0)
        mirrored_arms = exchange_sides(self.skeleton.model, self._arms_per_lean)
        desired = (
            self._posture + np.outer(right, self._arms_per_lean) + np.outer(left, mirrored_arms)
        )
        desired = desired + np.outer(stride, self._arms_per_stride)
        result = angles.copy()
        result[:, free_axes] = desired[:, free_axes]
        return result

    def _start_posture(self) -> _StartPosture:
        """Solve the first sample of the plan, and measure the pendulums of the robot in it.

        The trunk is at its height over ground at z = 0 here, whatever the height of the plan's ground is.

        Raises:
            OutOfReach: a leg cannot reach its foothold.
        """
        plan = self.plan
        first = GaitPlan(
            times=plan.times[:1],
            feet={foot: path[:1] for foot, path in plan.feet.items()},
            zmp=plan.zmp[:1],
            heading=plan.heading[:1],
        )
        # A solution of this sample alone, with the trunk over the ZMP.
        start = WholeBody(self.walker, self.gait, first)
        angles = self._posture[np.newaxis]
        # A lean to one side only: the arms answer to a lean to the left and to the right by different angles.
        # Each solution begins at the one before, so the order of the two is part of the result.
        angles, leaning_points = start._leaning(_SMALL_LEAN, angles)
        angles, points = start._leaning(0.0, angles)
        shares = self.skeleton.point_masses / self.skeleton.mass  # of the whole mass
        height = float(shares @ points[:, 2])
        if not self.leans:
            return _StartPosture(angles[0], height, com_per_lean=1.0, lean_height=height)
        # k and Z of the module, with the difference quotient in place of the derivative.
        change = (leaning_points - points) / _SMALL_LEAN
        com_per_lean = float(shares @ change[:, 1])
        moment = float(shares @ (points[:, 2] * change[:, 1] - points[:, 1] * change[:, 2]))
        return _StartPosture(angles[0], height, com_per_lean, lean_height=moment / com_per_lean)

    def _leaning(self, lean: float, angles: Vector) -> tuple[Vector, Vector]:
        """Solve a plan of a single sample for a lean.

        Args:
            lean: lean of the trunk to the right [rad].
            angles: angles from which the inverse kinematics begins, shape (1, n) [rad].

        Returns:
            Angles of all axes (1, n) [rad], and positions of the mass points (k, 3) [m].
        """
        angles, root = self._postures(self.plan.zmp, np.array([lean]), angles)
        points = self.skeleton.mass_points(self.skeleton.frames(angles, root))
        return angles, points[0]

    def _motion_in_world(self, angles: Vector, root: Vector) -> JointMotion:
        """Turn the motion from walking along x to where the robot looks, and start it over the world's origin.

        Args:
            angles: angles of all axes, shape (m, n) [rad].
            root: poses of the root link in the frame of the plan, shape (m, 4, 4).

        Returns:
            The motion. In the world of its poses, the root begins over the origin. It is not turned about the vertical
            if the plan's heading begins with 0.
        """
        # From walking along x to the direction in which the robot looks.
        facing = facing_rotation(-self.facing_deg)
        horizontal = np.array([1.0, 1.0, 0.0])  # keeps x and y, without the height
        positions = (root[:, :3, 3] - root[0, :3, 3] * horizontal) @ facing.T
        poses = stack_poses(positions, facing @ root[:, :3, :3])
        return JointMotion(
            model=self.walker.model,
            feet=self._kind,
            times=self.plan.times,
            positions=angles,
            root=poses,
            servo=self.gait.servo,
        )
