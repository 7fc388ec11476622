"""Solution of exercise 1 of the course, kinematics of an arm, with a figure of how near it is to singular postures."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from simrob_drake.results.plots.own import panels, save_figure

Vector = NDArray[np.float64]
AXES = "zyyxyx"  # that joints turn about, at zero
OFFSETS = np.array(
    [[0, 0, 0], [0, 0, 0.29], [0, 0, 0.27], [0, 0, 0.07], [0.302, 0, 0], [0.072, 0, 0]]
)  # m
LIMITS = np.deg2rad([[-165, -110, -110, -160, -120, -400], [165, 110, 70, 160, 120, 400]])
ELBOW = np.arctan2(0.070, 0.302)  # rad, between the forearm and the line from joint 3 to joint 5


def turn(axis: str, angle: float) -> Vector:
    """Return a rotation matrix about x, y or z."""
    c, s = np.cos(angle), np.sin(angle)
    i = "xyz".index(axis)
    j, k = (i + 1) % 3, (i + 2) % 3
    matrix = np.eye(3)
    matrix[[j, j, k, k], [j, k, j, k]] = c, -s, s, c
    return matrix


def frames(q: Vector) -> tuple[Vector, Vector, Vector]:
    """Return the joints' places (6, 3) and axes (6, 3), and the flange's place (3,)."""
    place, axes, places, ways = np.zeros(3), np.eye(3), [], []
    for axis, offset, angle in zip(AXES, OFFSETS, q, strict=True):
        place = place + axes @ offset
        places.append(place)
        ways.append(axes[:, "xyz".index(axis)])
        axes = axes @ turn(axis, angle)
    return np.array(places), np.array(ways), place


def tool_position(q: Vector) -> Vector:
    """Return the flange's place [m]: joint 6 turns about the line that it lies on."""
    return frames(q)[2]


def jacobian(q: Vector) -> Vector:
    """Return axis x lever for every joint."""
    places, axes, flange = frames(q)
    return np.cross(axes, flange - places).T


def posture(place: Vector, q: Vector) -> Vector:
    """Return a posture by least squares, near the start."""
    start = np.clip(q, *(LIMITS * 0.999))
    return np.asarray(
        least_squares(lambda q: tool_position(q) - place, start, jac=jacobian, bounds=LIMITS).x
    )


def flipped(q: Vector) -> Vector:
    """Turn joint 4 by half a turn, joint 5 the other way, joint 6 by half a turn."""
    half = np.where(q > 0, -np.pi, np.pi)
    return np.array([*q[:3], q[3] + half[3], -q[4], q[5] + half[5]])


def singular() -> Vector:
    """Stretch the arm: upper arm, forearm and flange on one line."""
    return np.array([0, 0, ELBOW - np.pi / 2, 0, -ELBOW, 0])


def picture(file: Path) -> Path:
    """Draw the least singular value over joint 3, stretched and with a bent wrist."""
    figure, ((axes,),) = panels("How near the arm is to losing a direction", size=(7, 3.5))
    angles = np.linspace(*LIMITS[:, 2], 200)
    for wrist, words in (
        (-ELBOW, "flange on the line of the forearm"),
        (np.pi / 2, "wrist bent by 90°"),
    ):
        values = [
            np.linalg.svd(jacobian(np.array([0, 0, q3, 0, wrist, 0])), compute_uv=False)
            for q3 in angles
        ]
        axes.plot(np.rad2deg(angles), [value[-1] / value[0] for value in values], label=words)
    axes.set_xlabel("joint 3 [°]")
    axes.set_ylabel("least over largest singular value")
    return save_figure(figure, file)


def main() -> None:
    """Print where the flange is, and draw."""
    print("the flange at zero:", tool_position(np.zeros(6)))
    print("stretched, it can reach", np.round(tool_position(singular()), 4))
    print(picture(Path("runs/course/kinematics.png")))


if __name__ == "__main__":
    main()
