"""Exercise 4, a floor from a bounce: a ball of 0.9048 kg falls 0.1 m onto a floor; find stiffness and dissipation.

The floor pushes with k x (1 + d x') while the ball is pressed in by x, and never pulls.
"""

MASS = 0.9048  # kg
GRAVITY = 9.80665  # m/s^2


def sink(k):
    """Return how deep the ball sinks at rest [m] with a stiffness k [N/m]."""
    raise NotImplementedError


def contact_time(k):
    """Return how long the ball touches the floor when it falls 0.1 m, without dissipation [s]; 5 % will do."""
    raise NotImplementedError


def identify(times, heights):
    """Return (k [N/m], d [s/m]) from a measured bounce.

    times, heights: 150 samples of the ball's lowest point [s], [m], with 0.5 mm of noise; it is let go at time 0.
    """
    raise NotImplementedError


def dissipation_for(height):
    """Return d [s/m] with which the ball rises to a height [m] after the first bounce, on a floor of 4000 N/m."""
    raise NotImplementedError


if __name__ == "__main__":
    print(
        "on 1000 N/m the ball sinks by",
        sink(1000),
        "m and touches the floor for",
        contact_time(1000),
        "s",
    )
