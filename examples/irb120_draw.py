"""Draw a square, a circle and the letter B on the inclined table, as in SimRob's exercises."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import numpy.typing as npt

from simrob_drake import Arm, SimulationResult, load_station
from simrob_drake.results.plots.own import panels, save_figure

TABLE = "inclined_table"  # the work object: positions below are on its surface, in m
DOWN = [0.0, 0.0, np.pi]  # the pencil points into the table
LIFTED = 0.02  # m above the table
SIDE = 0.1  # m


def square(arm: Arm, x: float, y: float) -> list[SimulationResult]:
    """Draw a square whose first corner is (x, y)."""
    corners = np.array([[x, y], [x + SIDE, y], [x + SIDE, y + SIDE], [x, y + SIDE], [x, y]])
    return [
        *pen_down(arm, x, y),
        arm.move_l(on_table(corners[1:]), wobj=TABLE, duration=3.0),
        pen_up(arm),
    ]


def circle(arm: Arm, x: float, y: float, radius: float) -> list[SimulationResult]:
    """Draw a circle about (x, y), of two half ones."""
    via = on_table([[x, y + radius], [x, y - radius]])
    ends = on_table([[x + radius, y], [x - radius, y]])
    return [
        *pen_down(arm, x - radius, y),
        arm.move_c(via, ends, wobj=TABLE, duration=3.0),
        pen_up(arm),
    ]


def letter_b(arm: Arm, x: float, y: float) -> list[SimulationResult]:
    """Draw the letter B: a line and two arcs."""
    middle, top, bulge = y + SIDE / 2, y + SIDE, x + SIDE / 3
    moves = [*pen_down(arm, x, y), arm.move_l(on_table([x, top]), wobj=TABLE, speed=0.15)]
    arcs = on_table([[bulge, (middle + top) / 2], [bulge, (y + middle) / 2]])
    moves.append(arm.move_c(arcs, on_table([[x, middle], [x, y]]), wobj=TABLE, duration=2.5))
    return [*moves, pen_up(arm)]


def pen_down(arm: Arm, x: float, y: float) -> list[SimulationResult]:
    """Go above a point, and down to it."""
    above = arm.move_j([x, y, LIFTED, *DOWN], wobj=TABLE)
    return [above, arm.move_l([x, y, 0.0, *DOWN], wobj=TABLE)]


def pen_up(arm: Arm) -> SimulationResult:
    """Lift the pencil from where its reference is."""
    x, y = arm.pose(arm.reference, wobj=TABLE)[:2]
    return arm.move_l([x, y, LIFTED], wobj=TABLE)


def on_table(points: npt.ArrayLike) -> np.ndarray:
    """Return points (k, 2) on the table as places (k, 3)."""
    rows = np.atleast_2d(np.asarray(points, dtype=float))
    return np.column_stack([rows, np.zeros(len(rows))])


def run(*, mode: str = "kinematic") -> tuple[Arm, list[SimulationResult]]:
    """Draw the three figures and return the arm with all its moves."""
    arm = Arm(load_station("irb120_workcell", {"mode": mode}), tool="pencil")
    moves = square(arm, 0.01, 0.1) + circle(arm, 0.17, 0.15, 0.05) + letter_b(arm, 0.23, 0.1)
    return arm, moves


def drawing(arm: Arm, moves: list[SimulationResult]) -> np.ndarray:
    """Return where the tip of the pencil was, in the frame of the table, shape (k, 3) [m]."""
    table = arm.cell.frame(TABLE)
    return np.vstack([(table.inverse() @ move.pose("tcp")[:, :3].T).T for move in moves])


def main() -> None:
    """Save a picture of the drawing."""
    arm, moves = run()
    tip = drawing(arm, moves)
    on_paper = np.abs(tip[:, 2]) < 1e-3
    figure, ((axes,),) = panels("drawn on the inclined table", size=(7, 4))
    axes.plot(*(1e3 * np.where(on_paper[:, np.newaxis], tip, np.nan)[:, :2].T), linewidth=2)
    axes.set(xlabel="x [mm]", ylabel="y [mm]", aspect="equal")
    file = save_figure(figure, Path("runs/irb120_draw.png"))
    print(f"{len(moves)} moves in {sum(move.stop_time for move in moves):.1f} s, drawn in {file}")


if __name__ == "__main__":
    main()
