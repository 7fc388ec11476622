"""Parts come on a belt that does not stop: a camera finds them, and the arm goes along with the belt to take them.

Where they lie is known to nobody but the seed. The arm reads the depths of the last image and how far the belt has gone
since; what the gripper closes on is then the part.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import numpy.typing as npt
from pydrake.trajectories import PiecewisePolynomial, Trajectory
from scipy.ndimage import label

from simrob_drake import Arm, Workcell
from simrob_drake.parts.sensors.camera import Image
from simrob_drake.programs.plan import Plan

Array = npt.NDArray[np.float64]

STATION = Path(__file__).parent / "stations" / "belt_camera.yaml"
PARTS, APART = 4, 0.06  # how many, and at least so far from each other along the belt [m]
TOP, EDGE = 0.16, 0.05  # height of the belt, and how far from its middle parts lie at most [m]
MIDDLE = 0.37  # x of the belt's middle [m]
SPEED = 0.03  # of the belt [m/s]
GRASP, ABOVE = 0.02, 0.06  # heights of the tool over the belt [m]
COMES, GOES = 1.2, 0.6  # to be above a part, and down to it [s]
FIRST = 0.0  # y from which on the arm takes parts [m]
FEWEST = 40  # pixels of a part
SAME = 0.03  # m between two places of one part, seen twice
EVERY = 0.02  # s between the postures of a motion


def workcell(seed: int, parts: int = PARTS, mode: str = "kinematic") -> Workcell:
    """Return the station with dice on the belt at random places, turned at random."""
    random = np.random.default_rng(seed)
    gaps = APART + random.exponential(0.03, parts)
    settings: dict[str, object] = {"mode": mode}
    for number, back in enumerate(np.cumsum(gaps)):
        across, turn = random.uniform(-EDGE, EDGE), random.uniform(0, np.pi / 2)
        # in the carriage's frame: z ahead, y down
        pose = [
            across,
            TOP - 0.155,
            -back,
            0.0,
            -turn,
            np.pi / 2,
        ]
        place = [float(value) for value in pose]
        settings[f"pieces.part_{number}"] = {"model": "half_die", "parent": "belt", "pose": place}
    return Workcell(STATION, settings)


def find_parts(image: Image) -> Array:
    """Return where an image shows whole parts on the belt: x, y [m] and their turn [rad], shape (k, 3)."""
    cloud = np.full((*image.depth.shape, 3), np.nan)
    cloud[image.has_depth] = image.points()
    on_belt = (
        (np.abs(cloud[..., 0] - MIDDLE) < 0.08)
        & (cloud[..., 2] > TOP + 0.01)
        & (cloud[..., 2] < TOP + 0.06)
    )
    marks, count = label(on_belt)
    border = {*marks[0], *marks[-1], *marks[:, 0], *marks[:, -1]}  # of what is seen in part
    whole = [
        mark
        for mark in range(1, count + 1)
        if mark not in border and (marks == mark).sum() >= FEWEST
    ]
    return np.array([_square(cloud[marks == mark]) for mark in whole]).reshape(-1, 3)


def _square(points: Array) -> Array:
    """Return the middle and the turn of the smallest rectangle around the top face of a part, of points (m, 3)."""
    top = points[points[:, 2] > np.quantile(points[:, 2], 0.9) - 0.006][:, :2]
    angles = np.deg2rad(np.arange(90))
    turned = top @ np.array(
        [[np.cos(angles), -np.sin(angles)], [np.sin(angles), np.cos(angles)]]
    ).transpose(2, 0, 1)
    lower, upper = turned.min(axis=1), turned.max(axis=1)  # (90, 2) each
    best = int((upper - lower).prod(axis=1).argmin())
    c, s = np.cos(angles[best]), np.sin(angles[best])
    return np.array(
        [*(np.array([[c, -s], [s, c]]) @ (lower[best] + upper[best]) / 2), angles[best]]
    )


def belt_motion(begin: float, duration: float) -> Trajectory:
    """Return how the belt goes on from a place [m]."""
    ends = np.array([[begin, begin + SPEED * duration]])
    return PiecewisePolynomial.FirstOrderHold(np.array([0.0, duration]), ends)


def eased(part: Array) -> Array:
    """Return parts of a way by parts of the time, at rest at both ends."""
    return np.asarray(
        np.clip(part, 0, 1) ** 3 * (10 - 15 * np.clip(part, 0, 1) + 6 * np.clip(part, 0, 1) ** 2)
    )


def take_along(arm: Arm, part: Array, wait: float) -> tuple[Trajectory, float]:
    """Return the motion that takes up with a part that is at x, y now and goes on, and how long it takes [s]."""
    whole = wait + COMES + GOES
    times = np.linspace(0.0, whole, int(whole / EVERY) + 1)
    now = arm.pose(arm.reference)
    x, y = np.full_like(times, part[0]), part[1] + SPEED * times
    joins, down = eased((times - wait) / COMES), eased((times - wait - COMES) / GOES)
    turn = (part[2] - now[3] + np.pi / 4) % (
        np.pi / 2
    ) - np.pi / 4  # a die is the same after a quarter of a turn
    poses = np.tile(now, (len(times), 1))
    heights = TOP + ABOVE + (GRASP - ABOVE) * down
    poses[:, :3] += joins[:, np.newaxis] * (np.column_stack([x, y, heights]) - now[:3])
    poses[:, 3] += joins * turn
    postures = arm.joint(poses)
    return PiecewisePolynomial.CubicShapePreserving(times, np.asarray(postures).T, False), whole


def take(cell: Workcell, arm: Arm, part: Array) -> tuple[str, float]:
    """Go along with a part, close the gripper on what is there, and return that and how far it is from the tool [m]."""
    wait = max((FIRST - part[1]) / SPEED - COMES - GOES, 0.0)
    motion, time = take_along(arm, part, wait)
    cell.follow({"arm": motion, "belt": belt_motion(cell.reference("belt")[0], time)}, time)
    tool = arm.pose()
    parts = [name for name in cell.config.pieces if name.startswith("part_")]
    away = {
        name: float(np.linalg.norm(cell.frame(name).translation()[:2] - tool[:2])) for name in parts
    }
    nearest = min(away, key=lambda name: away[name])
    arm.attach(nearest)
    return nearest, away[nearest]


def put_away(cell: Workcell, arm: Arm, part: str, number: int) -> None:
    """Put a part on the pallet while the belt goes on."""
    place = [0.05 + 0.06 * number, 0.4, 0.0576]
    _move(cell, arm.plan.move_l([*arm.pose()[:2], 0.3], duration=0.6))
    _move(cell, arm.plan.move_j([*place[:2], 0.2, 0, 0, 0], duration=1.2))
    # down to the pallet, which it touches
    _move(cell, arm.plan.move_l(place, duration=0.6, check="limits"))
    arm.release(part, "pallet")
    _move(cell, arm.plan.move_l([0, 0, -0.12], wobj=arm, duration=0.5, check="limits"))


def _move(cell: Workcell, plan: Plan) -> None:
    cell.follow(
        {"arm": plan.trajectory, "belt": belt_motion(cell.reference("belt")[0], plan.duration)},
        plan.duration,
    )


def look(cell: Workcell, known: list[Array]) -> None:
    """Let the belt go on for a moment, and put what the camera sees then among the parts that are known.

    They are known by their places on the belt: y is counted from where its carriage is.
    """
    begin = cell.reference("belt")[0]
    seen = cell.follow({"belt": belt_motion(begin, 0.2)}, 0.2)
    for part in find_parts(seen.images["eye"][-1]) - [0.0, cell.position("belt")[0], 0.0]:
        if all(np.linalg.norm(part[:2] - other[:2]) > SAME for other in known):
            known.append(part)


def run(seed: int, parts: int = PARTS, mode: str = "kinematic") -> tuple[Workcell, list[float]]:
    """Take all parts of a belt; return the station, and how far from the tool each was that was taken [m]."""
    cell = workcell(seed, parts, mode)
    arm, known, away = cell.arm("arm"), list[Array](), list[float]()
    cell.record()
    look(cell, known)
    while len(away) < len(known):
        ahead = sorted(known, key=lambda part: -float(part[1]))[len(away)]
        name, distance = take(cell, arm, ahead + np.array([0.0, cell.position("belt")[0], 0.0]))
        put_away(cell, arm, name, len(away))
        away.append(distance)
        look(cell, known)
    return cell, away


def main() -> None:
    """Print how near the tool was to each part, and save the whole as one result."""
    cell, away = run(seed=0)
    print(
        f"{len(away)} of {PARTS} parts taken, the tool {', '.join(f'{1e3 * one:.1f}' for one in away)} mm beside them"
    )
    print("files in", cell.save())


if __name__ == "__main__":
    main()
