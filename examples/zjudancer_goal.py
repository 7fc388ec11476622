"""ZJUDancer walks to a ball and kicks it into a goal: ``python examples/zjudancer_goal.py [SEEDS [FIRST]]``.

Ball and goal lie elsewhere with each seed. The robot looks where they are, walks some steps towards the place from
which it can kick, on its motors, looks again, and kicks. The ball moves by its contacts alone.
"""

from __future__ import annotations

import sys
from math import degrees
from typing import Any

import numpy as np
import numpy.typing as npt

from simrob_drake import LeggedRobot, load_station

Vector = npt.NDArray[np.float64]
WIDTH, FAR = 0.6, 0.7  # of the goal, and from the ball to it [m]
SPEED = 0.7  # of the foot at the ball [m/s]
STANCE = np.array(
    [0.175, 0.06]
)  # the ball before the robot when it kicks, ahead and to the side of a foot [m]
NEAR = np.array([0.015, 0.015, 3.0])  # how exactly: ahead, to the side [m], turned [deg]
STEP = np.array(
    [0.06, 0.02, 5.0]
)  # the most that a step goes ahead and to the side [m], and turns [deg]
LOOKS, STEPS = 8, 6  # most looks in all, and most steps between two
RADIUS = 0.0335  # of the ball [m]


def places(seed: int) -> tuple[Vector, Vector, Vector]:
    """Return where ball and goal are, and the way between, each (2,) [m]; the robot looks along y from the origin."""
    random = np.random.default_rng(seed)
    ball = np.array([random.uniform(-0.3, 0.3), random.uniform(0.5, 0.9)])
    turn = np.deg2rad(random.uniform(-40.0, 40.0))
    way = np.array([-np.sin(turn), np.cos(turn)])
    return ball, ball + FAR * way, way


def robot_before(ball: Vector, goal: Vector, way: Vector) -> LeggedRobot:
    """Return the robot with a ball and the two posts of a goal."""
    across = WIDTH / 2 * np.array([-way[1], way[0]])
    posts = {"right_post": goal - across, "left_post": goal + across}
    surface = {"model": "point", "stiffness": 1.0e4, "dissipation": 0.5}
    pieces: dict[str, Any] = {
        name: {"model": "bar_20", "parent": "world", "pose": [*at, 0, 0, 0, 0]}
        for name, at in posts.items()
    }
    pieces["ball"] = {
        "model": "tennis_ball",
        "free": True,
        "pose": [*ball, RADIUS, 0, 0, 0],
        "contact": surface,
    }
    # their flat front aims best
    feet = {
        "robot.feet": "soles",
        "contact.model": "hydroelastic_with_fallback",
    }
    motors = load_station("zjudancer_walking").servo.motor
    return LeggedRobot(
        load_station("zjudancer_dynamic", {**feet, "servo.motor": motors, "pieces": pieces})
    )


def seen(robot: LeggedRobot, place: Vector) -> Vector:
    """Return a way on the floor, shape (2,) [m], as the robot sees it: ahead and to the left."""
    ahead = robot.base_pose.rotation().matrix()[:2, 1]
    ahead = ahead / np.linalg.norm(ahead)
    return np.array([ahead, [-ahead[1], ahead[0]]]) @ place


def approach(robot: LeggedRobot, way: Vector) -> bool:
    """Walk until the ball is before a foot and the goal behind it; tell whether the robot stands there."""
    for _ in range(LOOKS):
        ball = seen(
            robot, robot.cell.frame("ball").translation()[:2] - robot.base_pose.translation()[:2]
        )
        along = seen(robot, way)
        side = np.copysign(STANCE[1], ball[1])
        stance = ball - STANCE[0] * along - side * np.array([-along[1], along[0]])
        left = np.array([*stance, degrees(np.arctan2(along[1], along[0]))])
        if (np.abs(left) < NEAR).all():
            return True
        steps = int(np.clip(np.ceil((np.abs(left) / STEP).max()), 1, STEPS))
        ahead, aside, turn = (float(part) for part in np.clip(left / steps, -STEP, STEP))
        walk = robot.walk(
            steps, step_length=ahead, sideways=aside, turn_deg=turn, ramp_steps=min(steps - 1, 2)
        )
        if walk.stopped_by:
            return False
    return False


def run(seed: int) -> tuple[bool, float]:
    """Play once; return whether the ball rolled between the posts, and how far beside their middle it crossed [m]."""
    ball, goal, way = places(seed)
    robot = robot_before(ball, goal, way)
    if not approach(robot, way):
        return False, np.nan
    kick = robot.do({"kick": {"ball": "ball", "toward": goal.tolist(), "speed": SPEED}})
    roll = robot.do({"wait": 2.0})
    assert kick is not None
    assert roll is not None
    path = np.vstack([kick.piece_pose("ball"), roll.piece_pose("ball")])[:, :2] - goal
    beyond = np.flatnonzero(path @ way > 0.0)
    aside = float(path[beyond[0]] @ np.array([-way[1], way[0]])) if beyond.size else np.nan
    return bool(kick.stopped_by is None and abs(aside) < WIDTH / 2 - RADIUS), aside


def main(seeds: str = "10", first: str = "0") -> None:
    """Play with some seeds, and print how often the ball was in the goal."""
    goals = 0
    for seed in range(int(first), int(first) + int(seeds)):
        scored, aside = run(seed)
        goals += scored
        print(
            f"seed {seed}: {'goal' if scored else 'no goal'}, {1000 * aside:+.0f} mm beside the middle",
            flush=True,
        )
    print(f"{goals} of {seeds}")


if __name__ == "__main__":
    main(*sys.argv[1:3])
