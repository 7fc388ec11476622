"""A loop of your own around the servos: keep the tool of a loaded arm at its height, which its servos alone do not."""

from __future__ import annotations

from pydrake.systems.framework import BasicVector, Context, DiscreteValues, LeafSystem

from simrob_drake import load_station, simulate
from simrob_drake.results.block_diagram.picture import save_block_picture
from simrob_drake.results.result import SimulationResult

PERIOD = 0.01  # s, between samples
REACH = 0.592  # m, from the shoulder to the tool: by so much it falls for each radian of joint 2


class KeepHeight(LeafSystem):
    """Lift the shoulder by the integral of the tool's error in height.

    Ports, wired by their names:
        in  ``tcp_pose`` (7): of the tool, x y z [m] and a quaternion.
        out ``reference`` (6): desired joint positions [rad]; ``error`` (1): in height [m].
    """

    def __init__(self, *, height: float, gain: float = 1.0) -> None:
        """Keep the tool at a height [m]; ``gain`` [1/s] says how fast."""
        super().__init__()
        # of which a saved station makes the block again
        self.parameters = {
            "height": height,
            "gain": gain,
        }
        self.units = {"error": "m"}
        self._pose = self.DeclareVectorInputPort("tcp_pose", 7)
        # what it remembers is declared
        self.DeclareStateOutputPort("reference", self.DeclareDiscreteState(6))
        self.DeclareVectorOutputPort("error", 1, self._calc_error)
        self.DeclarePeriodicDiscreteUpdateEvent(PERIOD, 0.0, self._update)

    def _error(self, context: Context) -> float:
        return float(self.parameters["height"] - self._pose.Eval(context)[2])

    def _calc_error(self, context: Context, output: BasicVector) -> None:
        output.SetAtIndex(0, self._error(context))

    def _update(self, context: Context, state: DiscreteValues) -> None:
        state.get_mutable_value()[1] -= (
            PERIOD * self.parameters["gain"] * self._error(context) / REACH
        )


def run(duration: float = 5.0) -> tuple[SimulationResult, SimulationResult]:
    """Let the arm hold its posture without the loop and with it."""
    station = load_station(
        "irb120_dynamic", {"reference": {"kind": "hold", "target_deg": 0}, "duration": duration}
    )
    alone = simulate(station)
    return alone, simulate(station, blocks=[KeepHeight(height=alone["tcp.z"][0])])


def main() -> None:
    """Print how far the tool sags, and save the run with its plots and the block picture."""
    for name, result in zip(("alone", "with the loop"), run(), strict=True):
        print(f"{name}: the tool sags by {1e3 * (result['tcp.z'][0] - result['tcp.z'][-1]):.2f} mm")
    print(save_block_picture(result.config, result.save(recording=False) / "blocks.mmd"))


if __name__ == "__main__":
    main()
