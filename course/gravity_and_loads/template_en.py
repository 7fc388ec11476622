"""Exercise 3, gravity and loads: what joints 2 and 3 of an IRB120 must give against gravity, and what they can carry.

All other joints are at zero. A load is a point 0.05 m before the flange. At zero the upper arm stands upright and the
forearm points ahead; both joints turn about y, so that a positive angle lowers what is ahead of them.
"""

GRAVITY = 9.80665  # m/s^2
# mass [kg], and centre of mass ahead of and above the joint that carries the part, at zero [m]
UPPER_ARM = (3.909, 0.00078, 0.10124)  # of joint 2; joint 3 is 0.270 above joint 2
FOREARM = [
    (2.944, 0.02281, 0.05791),
    (1.328, 0.2247, 0.07041),
    (0.546, 0.30091, 0.07006),
    (0.137, 0.36694, 0.07),
]
FLANGE = (0.374, 0.07)  # of joint 3


def gravity(q2, q3, load):
    """Return (torque of joint 2, torque of joint 3) in N·m that hold the arm with a load in kg."""
    raise NotImplementedError


def aware(load):
    """Return a mass [kg] that gravity() must believe in so that joint 2 ends half a degree beyond its reference."""
    raise NotImplementedError


def weakest(load):
    """Return (q2, q3) in rad where joint 2 has to give the most; q3 from -110 to 70 degrees."""
    raise NotImplementedError


def payload(limit):
    """Return the largest load [kg] that joint 2 holds with q2 = 90 and q3 = -70 degrees, with a limit in N·m."""
    raise NotImplementedError


if __name__ == "__main__":
    print(
        "at 30 degrees without a load:",
        gravity(0.5236, 0, 0),
        "and it should be about -14.98 and -6.46 N·m",
    )
