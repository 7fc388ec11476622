"""Exercise 8, the march: the step of the thesis, left and right in turn, and why it is so slow.

Names as in SimRob: Cad hip, Rod knee, Tob ankle, Hom shoulder; D right, I left; F ahead (pitch), L to the side.
"""

from simrob_drake import load_station, simulate

STEP = [
    {"CadIF": 60, "RodI": 60},  # lift the left leg
    {"RodD": 30, "TobD": -30},  # bend the right one: the body comes down and ahead
    {"CadIF": 0, "RodI": 0},  # put the left foot down
    {"RodD": 0, "TobD": 0},  # stand up
]  # deg


def march(moves, seconds=1.0, kd=100):
    """Let the humanoid go through moves, each in so many seconds; kp is 100 N·m/rad."""
    targets = [{"time": (k + 1) * seconds, "target_deg": move} for k, move in enumerate(moves)]
    changes = {"reference": {"kind": "sequence", "targets": targets}, "servo.kd": kd}
    return simulate(
        load_station("humanoid_dynamic", changes), duration=len(moves) * seconds + 1, progress=False
    )


def mirrored(move):
    """Return a move with left and right exchanged."""
    raise NotImplementedError


def moves(steps):
    """Return the moves of a march of so many steps, left first."""
    raise NotImplementedError


def lag(kp, kd):
    """Return by how many seconds a slow joint is late behind a ramp."""
    raise NotImplementedError


def quick():
    """Return (kd, seconds) with which moves(4) go at 45 mm/s or more, upright, and turn by 10 degrees at most."""
    raise NotImplementedError


if __name__ == "__main__":
    result = march(STEP)
    print(result.message, "- ahead by", 1e3 * (result["base.y"][0] - result["base.y"][-1]), "mm")
