"""A belt brings a rook; the arm beside it takes the rook and stands it on the pallet, while the belt runs back."""

from __future__ import annotations

import numpy as np

from simrob_drake import SimulationResult, Workcell

DOWN = [0.0, 0.0, np.pi]  # the gripper points down
HEIGHT = 0.035  # m above its frame, where the gripper holds the rook
ABOVE = 0.1  # m
PLACE = [0.1, 0.4, 0.0626]  # m on the pallet; a figure's foot is 5 mm below its frame


def run() -> tuple[Workcell, list[SimulationResult]]:
    """Bring, take and place the rook, and return the station with all moves."""
    cell = Workcell("belt_pick")
    belt, arm = cell.arm("belt"), cell.arm("arm")
    cell.record()
    moves = [belt.move_abs_j([0.6], duration=1.5)]  # m
    moves.append(arm.move_j([0, 0, HEIGHT + ABOVE, *DOWN], wobj="rook"))
    moves.append(arm.move_l([0, 0, HEIGHT], wobj="rook"))
    arm.attach("rook")
    # up from there: the rook, whose z is up, is the tool now
    moves.append(arm.move_l([0, 0, ABOVE], wobj=arm))

    over = arm.plan.move_j([*PLACE[:2], PLACE[2] + ABOVE, 0, 0, 0], duration=1.5)
    moves.append(cell.run(over, belt.plan.move_abs_j([0.0])))  # both at the same time
    moves.append(arm.move_l(PLACE))
    arm.release("rook", "pallet")
    return cell, [*moves, arm.move_l([0, 0, -ABOVE], wobj=arm)]


def main() -> None:
    """Print where the rook stands, and save the whole as one result; belt_pick.yaml says it as a program's file."""
    cell, moves = run()
    off = cell.frame("rook").translation() - PLACE
    print(f"{len(moves)} moves in {sum(move.stop_time for move in moves):.1f} s")
    print(
        f"the rook hangs on the {cell.config.pieces['rook'].parent}, {1e6 * np.linalg.norm(off):.3f} µm off its place"
    )
    print("files in", cell.save())


if __name__ == "__main__":
    main()
