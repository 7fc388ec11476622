"""Lesson 4, a humanoid steps: moves by joint angles, the step of the thesis, a walk, and a robot that falls."""

from __future__ import annotations

from simrob_drake import LeggedRobot


def main() -> None:
    """Raise the arms, step, and walk; lift a leg without leaning, and keep the walk."""
    robot = LeggedRobot("humanoid_dynamic")
    robot.add_move({"left_shoulder_pitch": 40, "right_shoulder_pitch": 40}, duration=0.5)
    robot.step()
    print(f"the step took it {-1e3 * robot.base_pose.translation()[1]:.0f} mm ahead")
    walk = LeggedRobot("roid1_dynamic").walk(4)
    print(f"four steps took roid1 {1e3 * walk.summary()['locomotion']['ahead']:.0f} mm ahead")
    lifted = LeggedRobot("zjudancer_dynamic").test_move(
        {"left_hip_pitch": 90, "left_knee": 90}, duration=2.0
    )
    print(f"a leg up, without leaning first: {lifted.message}")
    walk.save("runs/lesson_4", force=True)


if __name__ == "__main__":
    main()
