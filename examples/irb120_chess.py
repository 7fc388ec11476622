"""Play chess: leave the pencil in the half sphere, move the rook from square (1, 1) to (5, 5), fetch the pencil."""

from __future__ import annotations

import numpy as np

from simrob_drake import Arm, SimulationResult, load_station

HOME = [0, 0, 0, 0, np.pi / 2, 0]  # rad
DOWN = [0.0, 0.0, np.pi]  # the tool points down into a frame whose z points up
ABOVE = 0.08  # m
HELD = 0.04  # m above its square the gripper holds the rook
SET_DOWN = -0.06  # m: so deep the pencil's tip stands in the hole at the top of the sphere


def run(*, mode: str = "kinematic") -> tuple[Arm, list[SimulationResult]]:
    """Play the move and return the arm with all its moves."""
    arm = Arm(load_station("irb120_chess", {"mode": mode}), tool="pencil")
    arm.record()
    moves = [
        arm.move_j([0, 0, ABOVE, *DOWN], wobj="half_sphere.hole_top"),
        arm.move_l([0, 0, SET_DOWN], wobj="half_sphere.hole_top", check=None),  # meshes are filled
    ]
    arm.release("pencil", fixed=True)  # the hole holds it; the gripper is the tool now
    handle = arm.pose()
    moves += [arm.move_l([0, 0, -ABOVE], wobj=arm), arm.move_abs_j(HOME)]

    moves += go_down(arm, "chess_board.square_1_1")
    arm.attach("rook")
    # the rook is the tool now, and its z is up
    moves.append(arm.move_l([0, 0, ABOVE], wobj=arm, speed=0.3))
    moves.append(arm.move_j([0, 0, ABOVE, *upright(arm)], wobj="chess_board.square_5_5"))
    moves.append(arm.move_l([0, 0, 0], wobj="chess_board.square_5_5", speed=0.3))
    arm.release("rook", "chess_board", frame="square_5_5")
    moves += [arm.move_l([0, 0, -ABOVE], wobj=arm, speed=0.3), arm.move_abs_j(HOME)]

    # it closes about the pencil
    moves += [
        arm.move_j([*handle[:2], handle[2] + ABOVE, *handle[3:]]),
        arm.move_l(handle, check=None),
    ]
    arm.attach("pencil")
    return arm, [*moves, arm.move_l([0, 0, -ABOVE], wobj=arm), arm.move_abs_j(HOME)]


def go_down(arm: Arm, square: str) -> list[SimulationResult]:
    """Go above a square and down to the height at which the gripper holds a figure."""
    above = arm.move_j([0, 0, HELD + ABOVE, *DOWN], wobj=square)
    return [above, arm.move_l([0, 0, HELD], wobj=square)]


def upright(arm: Arm) -> np.ndarray:
    """Return the orientation [Rz Ry Rx] of the rook, the tool now, as it stands."""
    return arm.pose(arm.reference, wobj="chess_board.square_5_5")[3:]


def main() -> None:
    """Print where the rook stands now, and save the whole game as one result."""
    arm, moves = run()
    off = (
        arm.cell.frame("rook").translation()
        - arm.cell.frame("chess_board.square_5_5").translation()
    )
    print(f"{len(moves)} moves in {sum(move.stop_time for move in moves):.1f} s")
    print(f"the rook stands {1e3 * np.linalg.norm(off):.3f} mm from the middle of square (5, 5)")
    print("files in", arm.save())


if __name__ == "__main__":
    main()
