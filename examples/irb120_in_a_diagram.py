"""Use a station inside of your own diagram, through its named ports: here a block of your own sets the reference."""

from __future__ import annotations

import numpy as np
from pydrake.systems.framework import BasicVector, Context, DiagramBuilder, LeafSystem

from simrob_drake import SimulationResult, add_station, load_station, simulate_diagram


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


def run(*, duration: float = 2.0) -> SimulationResult:
    """Simulate; the result has signals, plots and a recording, and could be saved, as that of any station."""
    builder = DiagramBuilder()
    ports = add_station(builder, load_station("irb120_dynamic", {"monitors": {"joint_limit": {}}}))
    nod = builder.AddNamedSystem("nod", Nod())
    builder.Connect(nod.GetOutputPort("reference"), ports.inputs["reference"])
    return simulate_diagram(builder.Build(), ports, duration=duration, progress=False)


def main() -> None:
    """Print how far joint 5 nods."""
    result = run()
    nods = np.rad2deg(result["q.joint_5"])
    print(result.message)
    print(f"joint 5 nods between {nods.min():.1f} and {nods.max():.1f} deg")


if __name__ == "__main__":
    main()
