"""Exercise 7, standing on two feet: how hard a humanoid may be pushed before it tips over its toes or its heels.

It looks along -y: a push ahead is along -y. It is pushed at the centre of mass of its trunk.
"""

from simrob_drake import load_station, simulate

MASS, GRAVITY = 2.292, 9.80665  # kg, m/s^2
COM_HEIGHT, PUSH_HEIGHT, ANKLE_HEIGHT = 0.228, 0.319, 0.030  # m over the floor
INERTIA = 0.037  # kg m^2 about the centre of mass, for tipping ahead or back
TOES = {
    "spheres_B": 0.079,
    "spheres_C": 0.132,
}  # m, from the centre of mass to the front of the feet
HEELS = {"spheres_B": 0.030, "spheres_C": 0.049}  # m, to their back


def stands(force, seconds, feet="spheres_B", lean=0.0):
    """Tell whether the robot stands after a push: force [N] along y (ahead is negative), with ankles turned [deg]."""
    ankles = {"right_ankle_pitch": lean, "left_ankle_pitch": lean}
    push = {"kind": "push", "start": 2.0, "duration": seconds, "force": [0, force, 0]}
    changes = {
        "robot.feet": feet,
        "reference": {"kind": "move", "target_deg": ankles, "duration": 1.0},
    }
    station = load_station("humanoid_dynamic", {**changes, "forces.push": push})
    return simulate(station, duration=2.0 + seconds + 2.0, progress=False).ending == "completed"


def steady_push(ahead, feet):
    """Return the force [N] that just tips the robot if it lasts; ahead: True or False (back)."""
    raise NotImplementedError


def short_push(seconds, feet):
    """Return the force [N] back that just tips the robot if it lasts so many seconds."""
    raise NotImplementedError


def lean():
    """Return the angle of both ankles [deg] with which it withstands steady pushes ahead and back alike (spheres_B)."""
    raise NotImplementedError


if __name__ == "__main__":
    print("1 N back for 3 s:", "stands" if stands(1.0, 3.0) else "falls")
