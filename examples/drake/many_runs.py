"""A Runner: a run, a branch with pushes, a run that goes on, and 200 runs by processes."""

from concurrent.futures import ProcessPoolExecutor

import numpy as np

from simrob_drake import Runner, SimulationResult


def drop(height: float) -> SimulationResult:
    """Run the ball from a height [m]."""
    return Runner("bouncing_ball", overrides={"pieces.ball.pose": [0, 0, height, 0, 0, 0]}).run(duration=0.1)


if __name__ == "__main__":
    runner = Runner("humanoid_dynamic", overrides={"duration": 0.6})
    first = runner.run(duration=0.3)
    whole = runner.resume(first, until=0.6)  # as if it had never been stopped
    branch = runner.branch(0.3)
    for force in (5.0, -5.0):  # N
        pushed = branch.run(pushes={"shove": {"start": 0.3, "duration": 0.1, "force": [0, force, 0]}})
        print(f"{force:+.0f} N move it by", (pushed["base.y"][-1] - whole["base.y"][-1]).round(4), "m")
    with ProcessPoolExecutor() as pool:
        heights = [result["piece.ball.z"][-1] for result in pool.map(drop, np.linspace(0.2, 1.0, 200))]
    print(len(heights), "runs; the lowest ball ends at", np.round(min(heights), 3), "m")
