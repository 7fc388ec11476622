"""Take a parcel from a stand with both hands, carry it to the left, and leave it there: hands by inverse kinematics."""

from __future__ import annotations

import numpy as np

from simrob_drake import LeggedRobot
from simrob_drake.base.frames import Vector

PITCH = 50.0
"""Angle of the arms at the parcel [deg]."""
LIFT = 20.0
"""By how much the arms rise with it [deg]."""
SHIFT = 0.03
"""How far to the left it goes [m]."""
HALF_WIDTH = 0.07
"""Of the hands from the parcel's middle while they hold it [m]."""
BENT = 0.03
"""How much nearer the hands are than stretched arms would have them [m]."""
OPEN = 0.03
"""By how much each hand is further out before and after it [m]."""


def hands(robot: LeggedRobot, middle: float, gap: float = 0.0) -> dict[str, float]:
    """Return the angles [deg] that hold both hands beside a place x [m] before the robot, each a gap away from it.

    An arm's three lower joints turn about parallel axes: they choose place and turn of the hand in the plane of the
    arm, so that the hand, and what it carries, need not turn on its way to the side.
    """
    targets = {}
    for side, sign in (("right", -1.0), ("left", 1.0)):
        stretched = np.zeros(len(robot.axes))
        stretched[robot.axes.index(f"{side}_shoulder_pitch")] = np.deg2rad(PITCH)
        pose: Vector = robot.pose(f"{side}_hand", stretched)
        pose[0] = middle + sign * (HALF_WIDTH + gap)
        pose[1:3] += BENT * np.array([np.sin(np.deg2rad(PITCH)), np.cos(np.deg2rad(PITCH))])
        start = stretched + np.deg2rad(20)
        q = robot.joint(f"{side}_hand", pose, "world", start=start)
        targets |= {
            robot.axes[axis]: float(np.rad2deg(q[axis]))
            for axis in robot.chain(f"{side}_hand").order
        }
    return targets


def run() -> LeggedRobot:
    """Take the parcel and leave it."""
    robot = LeggedRobot("humanoid_box")
    raised = {"right_shoulder_pitch": PITCH + LIFT, "left_shoulder_pitch": PITCH + LIFT}
    robot.add_move(hands(robot, 0.0, OPEN) | {"neck_pitch": 20}, 1.0)
    robot.add_move(hands(robot, 0.0), 0.5)
    robot.attach("parcel", store=True)
    robot.add_move(raised, 0.6)
    robot.add_move(hands(robot, SHIFT) | raised, 0.8)
    robot.add_move(hands(robot, SHIFT), 0.6)
    robot.release("parcel", store=True)
    robot.add_move(hands(robot, SHIFT, OPEN), 0.5)
    robot.add_move(dict.fromkeys(robot.program.moves[0].target_deg, 0.0), 1.0)
    return robot


def main() -> None:
    """Print where the parcel was and is."""
    before = LeggedRobot("humanoid_box").cell.frame("parcel").translation()
    robot = run()
    x, y, z = 1e3 * (robot.cell.frame("parcel").translation() - before)
    print(f"the parcel went {x:.1f} mm to the left, {y:.1f} mm back, {z:.1f} mm up")
    print(
        f"{len(robot.program.moves)} moves, {robot.program.duration:g} s, {robot.save('runs/humanoid_box.yaml')}"
    )


if __name__ == "__main__":
    main()
