"""Exercise 2, PD servos and their saturation: the station irb120_dynamic moves all joints by 30 degrees in a second.

torque = kp (reference - position) - kd velocity, cut at the limit. Try things with run(), then write the functions.
"""

from simrob_drake import load_station, simulate


def run(**settings):
    """Let the arm move with settings, such as kp=500, kd=20 or torque_limit={"joint_2": 30}."""
    station = load_station(
        "irb120_dynamic", {f"servo.{key}": value for key, value in settings.items()}
    )
    return simulate(station, duration=3.0, progress=False)


def sag(kp):
    """Return by how many degrees joint 2 ends beyond 30 with a gain kp [N·m/rad]. Do not run anything in here."""
    raise NotImplementedError


def gains():
    """Return (kp, kd) for all joints: small errors, hardly any overshoot, and no more than 45 N·m in joint 2."""
    raise NotImplementedError


def torque_limit():
    """Return a limit [N·m] of joint 2: it ends within 1.5 degrees, and not with 5 % less."""
    raise NotImplementedError


def disturbed():
    """Return the name of the joint, besides joint_2, that strays most on its way if all limits are 10 N·m."""
    raise NotImplementedError


if __name__ == "__main__":
    result = run(kp=1000, kd=10)
    print(
        "joint 2 ends at",
        result["q.joint_2"][-1],
        "rad and gives",
        result["tau.joint_2"][-1],
        "N·m",
    )
