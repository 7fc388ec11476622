r"""From a course of feet and zero-moment point to the joint angles of the whole robot.

The trunk first follows the linear inverted pendulum. The motion so found has another zero-moment point than was asked
for, since legs and arms have masses of their own; what is missing drives the pendulum again, and the trunk is moved by
as much (Kajita's preview of the error, 2003). A few rounds bring it to millimetres. All this is done in the
frame of the ground: on a slope it is gravity that leans, and the trunk stays upright against it.

A trunk on legs without ankle roll cannot go sideways while the soles stay flat: it leans instead. Its lean
:math:`\varphi` moves the centre of mass by :math:`k\varphi`, and acts like a pendulum of another height, :math:`Z/k`
with :math:`Z = \sum m (z\,\partial y/\partial\varphi - y\,\partial z/\partial\varphi) / \sum m`.
"""

import numpy as np

from simrob_drake.base.frames import Vector
from simrob_drake.base.interpolation import stacked
from simrob_drake.programs.gaits.legs import leg_angles
from simrob_drake.programs.gaits.motion import JointMotion, SolvedGait
from simrob_drake.programs.gaits.phases import SAMPLE, GaitPlan
from simrob_drake.programs.gaits.walker import UP, Walker, facing_rotation, mirrored, rolled, rotations_about, upright
from simrob_drake.programs.gaits.zmp import com_from_zmp, whole_body_zmp
from simrob_drake.results.record.history import parts

AHEAD, LEFT = np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0])
ROUNDS = 4  # how often the zero-moment point is mended
_NUDGE = 1e-3  # lean whose effect is measured [rad]


class WholeBody:
    """Solves the posture of a robot for a course."""

    def __init__(self, walker: Walker, gait: SolvedGait, plan: GaitPlan) -> None:
        """Prepare for a course, on which the robot carries itself as its gait says."""
        self.walker, self.gait, self.plan = walker, gait, plan
        self.skeleton, self.facing_deg = walker.skeleton, walker.gaits.facing_deg
        model, bearing = walker.model, gait.bearing
        self._posture = np.deg2rad(model.axis_vector(bearing.posture_deg, "posture_deg"))
        self._arms = model.axis_vector(
            bearing.lean_arms_deg, "lean_arms_deg"
        )  # of each axis, a radian of lean to the right
        self._swing = np.deg2rad(model.axis_vector(bearing.swing_arms_deg, "swing_arms_deg"))
        self._upright = upright(walker.gravity)
        self._kind = gait.feet
        self.feet = walker.feet(self._kind)
        self.leans = any(len(foot.axes) == 4 for foot in self.feet)
        self._rolled = {foot.name: np.zeros((len(plan.times), 2)) for foot in self.feet}

    def solve(self, rounds: int = ROUNDS) -> tuple[JointMotion, Vector]:
        """Return the motion, and its zero-moment point without slip, shape (m, 2) [m].

        Raises OutOfReach: a leg cannot reach where its foot is to be.
        """
        count = len(self.plan.times)
        angles, height, factor, lean_height = self._start()
        angles = np.tile(angles, (count, 1))
        desired, pull = self.plan.zmp, -float(self.walker.gravity[2])
        place, lean = com_from_zmp(desired, step=SAMPLE, height=height, gravity=pull), np.zeros(count)
        angles, root = self._postures(place, lean, angles)
        zmp = whole_body_zmp(self.skeleton, root, angles, SAMPLE, self.walker.gravity)
        for _ in range(rounds):
            missing = desired - zmp
            move = com_from_zmp(missing, step=SAMPLE, height=height, gravity=pull)
            if self.leans:
                lean = lean + com_from_zmp(missing[:, 1:], step=SAMPLE, height=lean_height, gravity=pull)[:, 0] / factor
                move[:, 1] = 0.0
            place = place + move
            self._roll(angles, root)
            angles, root = self._postures(place, lean, angles)
            zmp = whole_body_zmp(self.skeleton, root, angles, SAMPLE, self.walker.gravity)
        return self._in_the_world(angles, root), zmp

    def _postures(self, place: Vector, lean: Vector, angles: Vector) -> tuple[Vector, Vector]:
        """Return the angles (m, n) for a motion of the trunk, and the poses of the root (m, 4, 4).

        The trunk goes over places (m, 2) [m] of the floor, and leans to the right by angles (m,) [rad].
        """
        angles, root = angles.copy(), np.empty((len(lean), 4, 4))
        for part in parts(len(lean)):
            angles[part], root[part] = self._postures_of(part, place[part], lean[part], angles[part])
        return angles, root

    def _postures_of(self, part: slice, place: Vector, lean: Vector, angles: Vector) -> tuple[Vector, Vector]:
        plan, bearing = self.plan, self.gait.bearing
        count = len(lean)
        turned = rotations_about(UP, plan.heading[part])
        rotation = (
            turned @ rotations_about(LEFT, np.full(count, np.deg2rad(bearing.pitch_deg))) @ rotations_about(AHEAD, lean)
        )
        rotation = self._upright @ rotation @ facing_rotation(self.facing_deg)
        height = bearing.height + np.broadcast_to(plan.ground, len(plan.times))[part]
        root = stacked(np.column_stack([place, height]), rotation)
        angles = self._with_arms(part, angles, lean)
        apart = np.zeros(count)
        for foot in self.feet:
            path = plan.feet[foot.name][part]
            goal = path[:, :3] + foot.over * UP
            goal[:, :2] += self._rolled[foot.name][part]
            target = stacked(goal, rotations_about(UP, path[:, 3]))
            angles = leg_angles(self.skeleton.model, foot, target, root, angles, plan.times[part])
            if self.leans:  # which moves the root sideways
                apart += (goal - foot.poses(angles, root)[:, :3, 3])[:, 1] / len(self.feet)
        root[:, 1, 3] += apart
        return angles, root

    def _roll(self, angles: Vector, root: Vector) -> None:
        """Find how far feet that are balls roll in a motion."""
        for foot in self.feet:
            if not foot.half.any():
                turned = foot.poses(angles, root)[:, :3, :3]
                self._rolled[foot.name] = rolled(turned, self.plan.stands(foot.name), foot.over)

    def _with_arms(self, part: slice, angles: Vector, lean: Vector) -> Vector:
        """Return the angles with the axes that are in no leg set: posture, counterweight of a lean, and swing."""
        free = [axis for axis in range(angles.shape[1]) if not any(axis in foot.axes for foot in self.feet)]
        right, left = np.maximum(lean, 0.0), np.maximum(-lean, 0.0)
        feet = self.plan.feet
        stride = feet["left_foot"][part, 0] - feet["right_foot"][part, 0] if "left_foot" in feet else 0.0 * lean
        other = mirrored(self.skeleton.model, self._arms)
        all_ = self._posture + np.outer(right, self._arms) + np.outer(left, other)
        all_ = all_ + np.outer(stride, self._swing)
        result = angles.copy()
        result[:, free] = all_[:, free]
        return result

    def _start(self) -> tuple[Vector, float, float, float]:
        """Return the posture at the start (n,), the height of its centre of mass [m], and what a lean does.

        A lean moves the centre of mass to the left [m/rad], as a pendulum of some height would [m].
        """
        plan = self.plan
        feet = {foot: path[:1] for foot, path in plan.feet.items()}
        first = GaitPlan(plan.times[:1], feet, plan.zmp[:1], plan.heading[:1])
        short = WholeBody(self.walker, self.gait, first)
        angles, points = self._posture[np.newaxis], []
        for lean in (_NUDGE, 0.0):  # to one side: arms answer to each side by themselves
            angles, root = short._postures(first.zmp, np.array([lean]), angles)
            points.append(self.skeleton.mass_points(self.skeleton.frames(angles, root))[0])
        masses = self.skeleton.point_masses / self.skeleton.mass
        height = float(masses @ points[1][:, 2])
        if not self.leans:
            return angles[0], height, 1.0, height
        change = (points[0] - points[1]) / _NUDGE
        factor = float(masses @ change[:, 1])
        moment = float(masses @ (points[1][:, 2] * change[:, 1] - points[1][:, 1] * change[:, 2]))
        return angles[0], height, factor, moment / factor

    def _in_the_world(self, angles: Vector, root: Vector) -> JointMotion:
        """Return the motion, turned from walking along x to where the robot looks, and begun over the origin."""
        facing = facing_rotation(-self.facing_deg)
        places = (root[:, :3, 3] - root[0, :3, 3] * [1.0, 1.0, 0.0]) @ facing.T
        turned = stacked(places, facing @ root[:, :3, :3])
        return JointMotion(self.walker.model, self._kind, self.plan.times, angles, turned, self.gait.servo)
