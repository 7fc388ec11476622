"""Use a station inside of your own diagram, through its named ports: here a block of your own sets the reference."""

from __future__ import annotations

import numpy as np
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import BasicVector, Context, DiagramBuilder, LeafSystem
from pydrake.systems.primitives import LogVectorOutput

from simrob_drake import add_station, apply_solver, load_station


class Nod(LeafSystem):
    """Let joint 5 nod: an outer loop would stand here.

    Ports:
        out ``reference`` (6): desired joint positions [rad].
    """

    def __init__(self) -> None:
        """Make the block."""
        super().__init__()
        self.DeclareVectorOutputPort("reference", 6, self._calc_reference)

    def _calc_reference(self, context: Context, output: BasicVector) -> None:
        reference = np.zeros(6)
        reference[4] = 0.3 * np.sin(2.0 * context.get_time())
        output.SetFromVector(reference)


def run(*, duration: float = 2.0) -> tuple[np.ndarray, np.ndarray]:
    """Simulate and return times (m,) [s] and joint positions (m, 6) [rad]."""
    builder = DiagramBuilder()
    station = load_station("irb120_dynamic")
    ports = add_station(builder, station)
    nod = builder.AddNamedSystem("nod", Nod())
    builder.Connect(nod.GetOutputPort("reference"), ports.inputs["reference"])
    logger = LogVectorOutput(ports.outputs["position"], builder, publish_period=0.02)
    simulator = Simulator(builder.Build())
    apply_solver(simulator, station)
    simulator.AdvanceTo(duration)
    log = logger.FindLog(simulator.get_context())
    return log.sample_times(), log.data().T


def main() -> None:
    """Print how far joint 5 nods."""
    _, positions = run()
    print(
        f"joint 5 nods between {np.rad2deg(positions[:, 4].min()):.1f} and {np.rad2deg(positions[:, 4].max()):.1f} deg"
    )


if __name__ == "__main__":
    main()
