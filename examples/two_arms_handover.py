"""Two arms share a station: the left one takes a bar and hands it to the right one, which stands it on its head."""

from __future__ import annotations

import numpy as np

from simrob_drake import SimulationResult, Workcell, load_station

HOME = [0, 0, 0, 0, np.pi / 2, 0]  # rad
LENGTH = 0.148  # m, of the bar, whose frame lies in its upper end with z upwards
GRIP = 0.02  # m from the end, where a gripper holds it
LIFT = 0.1  # m
TO_THE_RIGHT = [0.0, np.pi / 2, 0.0]  # a tool that points along x of the world
DOWN = [0.0, 0.0, np.pi]
MEETING = [-0.08, 0.0, 0.42]  # m, the left gripper
GOAL = [0.5, 0.3, 0.0]  # m, the bar's upper end, then below


def run(*, mode: str = "kinematic") -> tuple[Workcell, list[SimulationResult]]:
    """Hand the bar over, and return the station with all moves."""
    cell = Workcell(load_station("two_arms", {"mode": mode}))
    left, right = cell.arm("left"), cell.arm("right")
    cell.record()
    moves = [
        left.move_j([0, 0, LIFT, *DOWN], wobj="bar"),
        left.move_l([0, 0, -GRIP], wobj="bar", speed=0.3),
    ]
    left.attach("bar")
    left.tool("left_gripper")  # its moves are those of the gripper, not of the bar's end
    moves.append(left.move_l([0, 0, -LIFT], wobj=left, speed=0.3))
    moves.append(left.move_j([*MEETING, *TO_THE_RIGHT], duration=1.5))

    moves.append(right.move_j([0, 0, -LENGTH - LIFT, 0, 0, 0], wobj="bar", duration=1.5))
    moves.append(right.move_l([0, 0, -LENGTH + GRIP], wobj="bar", speed=0.3))
    right.attach("bar")
    moves.append(left.move_l([0, 0, -LIFT], wobj=left, speed=0.3))

    over = right.plan.move_j([*GOAL[:2], LIFT, *DOWN], duration=2.0)
    moves.append(cell.run(over, left.plan.move_abs_j(HOME)))  # both at the same time
    moves.append(right.move_l(GOAL, speed=0.3))
    right.release("bar", fixed=True)  # it stands on its head
    return cell, [
        *moves,
        right.move_l([0, 0, -LIFT], wobj=right, speed=0.3),
        right.move_abs_j(HOME),
    ]


def main() -> None:
    """Print where the bar is now, and save the whole as one result."""
    cell, moves = run()
    x, y, z = cell.frame("bar").translation()
    print(f"{len(moves)} moves in {sum(move.stop_time for move in moves):.1f} s")
    print(f"the bar's upper end is now the lower one, at x = {x:.3f}, y = {y:.3f}, z = {z:.3f} m")
    print("files in", cell.save())


if __name__ == "__main__":
    main()
