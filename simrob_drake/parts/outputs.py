"""Registry of a station's outputs: ports by name, their columns in results, and the monitors that watch them.

An *output* is a port of a block in the station, such as ``position``. Its *signals* declare the columns that it has in
results, with units and plots. Values of many outputs can be computed in two ways: from their ports, in a context of the
diagram; or by a *rule* from recorded states of the plant, which is faster and needs no context.
"""

from collections.abc import Callable, Iterator, Mapping
from copy import copy
from dataclasses import dataclass
from functools import partial
from typing import Self

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.framework import Context, DiagramBuilder, LeafSystem, OutputPort

from simrob_drake.base.errors import UnknownKey
from simrob_drake.base.frames import Indices, Vector
from simrob_drake.base.lifetime import release_with
from simrob_drake.base.messages import message
from simrob_drake.base.renaming import keep_former_attributes
from simrob_drake.base.signals import Compute, Signal
from simrob_drake.blocks.frame_poses import FramePoses
from simrob_drake.blocks.monitor import Trigger


@dataclass(frozen=True)
class FromState:
    """Rule by which an output of the station is computed from states of the whole plant, without reading its port.

    The rule picks values from a state (nq + nv,) of the plant's positions and velocities, and a function may then
    compute the output from these values.

    Attributes:
        pick: indices of the picked entries of the state, integers of shape (size,); or a matrix (size, nq + nv), whose
            product with the state gives the picked values. Indices save memory in a station of many free pieces.
        finish: computes the output (m, any size) from the picked values (m, size) of m states. If it is None, the
            picked values are the output.
    """

    pick: Vector | Indices
    finish: Callable[[Vector], Vector] | None = None

    def of(self, states: Vector) -> Vector:
        """Compute the output for each of m states.

        Args:
            states: positions and velocities of the whole plant, shape (m, nq + nv).

        Returns:
            The output, shape (m, any size): `size` values for each state if there is no function `finish`.
        """
        values = self._picked_values(states)
        return values if self.finish is None else self.finish(values)

    def _picked_values(self, states: Vector) -> Vector:
        """Pick the values from each of m states, shape (m, nq + nv). The result has the shape (m, size)."""
        if self._picks_entries:
            # The sum with 0 makes 0 of -0, as a product with a matrix does: results are equal to the last bit.
            return np.asarray(states[:, self.pick] + 0.0)
        return np.asarray(states @ self.pick.T)

    def matrix(self, size: int) -> Vector:
        """Matrix (picked values, size) whose product with a state gives the picked values.

        Args:
            size: size of a state, nq + nv.
        """
        if not self._picks_entries:
            return np.asarray(self.pick, dtype=float)
        # Each row has a 1 at the index of its entry.
        matrix = np.zeros((len(self.pick), size))
        matrix[np.arange(len(self.pick)), self.pick] = 1.0
        return matrix

    @property
    def _picks_entries(self) -> bool:
        """Whether `pick` contains indices, not a matrix."""
        return self.pick.ndim == 1


@dataclass(frozen=True)
class _Report:
    """A block that only reports, and that has not joined the diagram.

    Attributes:
        block: the block.
        source: port that the block reads.
    """

    block: LeafSystem
    source: OutputPort


class OutputRegistry(Mapping[str, OutputPort]):
    """The outputs of a station under construction: a mapping of names to output ports.

    Names are ``position``, ``velocity``, ``torque`` (n), ``base_pose``, ``tcp_pose`` (7), ``piece_pose.<piece>`` (7),
    ``piece_velocity.<piece>`` (6), ``force.<sensor>`` (3) and so on. With several robots, the names of a robot's
    outputs have the prefix ``<robot>.``.

    Attributes:
        signals: columns of the outputs in results, with units and plots, in the order of the columns.
        of_state: rules that compute outputs from states of the plant, by the output's name.
        after_run: functions that compute outputs without a port after the run, by the output's name.
        images: what cameras show to blocks of the user's own, by name, such as ``image.<sensor>``.
        monitors: conditions that end a run, by the monitor's name. They watch outputs.
        notes: remarks for results on how a part was made, such as its kind, by the name of the part.
    """

    def __init__(
        self, state: OutputPort, plant: MultibodyPlant, *, defers_reports: bool = False
    ) -> None:
        """Begin without outputs.

        Args:
            state: port with the positions and velocities of the whole plant, size nq + nv.
            plant: the plant.
            defers_reports: whether blocks that only report join the diagram when something reads them, and not before.
                Each block in the diagram makes stepping slower.
        """
        self._state = state
        self._plant = plant
        self._defers_reports = defers_reports
        self._ports: dict[str, OutputPort] = {}
        # Blocks that have not joined the diagram, by the names of their outputs.
        self._reports: dict[str, _Report] = {}
        self.signals: list[Signal] = []
        self.of_state: dict[str, FromState] = {}
        self.after_run: dict[str, Compute] = {}
        self.images: dict[str, OutputPort] = {}
        self.monitors: dict[str, Trigger] = {}
        self.notes: dict[str, dict[str, str]] = {}

    def make_copy(self) -> Self:
        """Copy the registry once the station is built, so that outputs can be added to the copy alone.

        The copy shares with the original what changes only before that: images, monitors, functions for after the run,
        and blocks that have not joined.
        """
        # `copy` alone would share the mappings: what is added to the copy would appear in the original.
        twin = copy(self)
        twin._ports = dict(self._ports)
        twin.signals = list(self.signals)
        twin.of_state = dict(self.of_state)
        twin.notes = dict(self.notes)
        return twin

    def __getitem__(self, output: str) -> OutputPort:
        """Output port by its name.

        Raises:
            UnknownKey: there is no such output.
        """
        if output not in self._ports:
            raise UnknownKey(message("parts.output", "output"), output, self._ports)
        return self._ports[output]

    def __contains__(self, output: object) -> bool:
        return output in self._ports

    def __iter__(self) -> Iterator[str]:
        return iter(self._ports)

    def __len__(self) -> int:
        return len(self._ports)

    def __repr__(self) -> str:
        return f"<{type(self).__name__}: {', '.join(self)}>"

    def add(
        self, output: str, port: OutputPort, *signals: Signal, of_state: FromState | None = None
    ) -> None:
        """Declare an output once: result columns, plots and the block picture read the declaration.

        Args:
            output: name of the output.
            port: its port.
            signals: its columns in results, with units and plots. A signal without columns, such as that of limbs that
                a robot does not have, is left out.
            of_state: rule that computes the output from states of the plant, if there is one.
        """
        # The order of the declarations is that of the result's columns.
        self._ports[output] = port
        self.signals.extend(signal for signal in signals if signal.names)
        if of_state is not None:
            self.of_state[output] = of_state

    def add_report(
        self,
        builder: DiagramBuilder,
        name: str,
        block: LeafSystem,
        source: OutputPort,
        *outputs: str,
    ) -> None:
        """Add a block that only reports: nothing that moves the station needs its outputs.

        The outputs are not declared here: the caller also calls `add` for each of them. If the registry defers reports,
        the block joins the diagram when something reads one of its outputs, see `port`; otherwise it joins at once.

        Args:
            builder: builder of the diagram.
            name: name of the block.
            block: the block, with one input.
            source: port that the block reads.
            *outputs: names of the station's outputs whose values the block gives.
        """
        block.set_name(name)
        report = _Report(block, source)
        for output in outputs:
            self._reports[output] = report
        if not self._defers_reports:
            self._join(builder, block)
        elif isinstance(block, FramePoses):
            # The block refers to the plant. Outside of a diagram nothing else would release the two.
            release_with(self._plant, block)

    def port(self, builder: DiagramBuilder, output: str) -> OutputPort:
        """Find the port of an output for a block to read. The block that gives it joins the diagram if it has not yet.

        Args:
            builder: builder of the diagram.
            output: name of the output.

        Raises:
            KeyError: there is no such output.
        """
        if output in self._reports:
            self._join(builder, self._reports[output].block)
        return self._ports[output]

    def _join(self, builder: DiagramBuilder, block: LeafSystem) -> None:
        """Add a block that only reports to the diagram, and connect its input. Its outputs are not deferred any more.

        Args:
            builder: builder of the diagram.
            block: the block, which has not joined yet.
        """
        # A block may give several outputs, each with an entry that refers to the same block.
        joining_outputs = [
            output for output, report in self._reports.items() if report.block is block
        ]
        source = self._reports[joining_outputs[0]].source
        builder.AddSystem(block)
        builder.Connect(source, block.get_input_port(0))
        for output in joining_outputs:
            del self._reports[output]

    def from_state(self, output: str) -> Callable[[Vector], Vector] | None:
        """Find the function that computes an output (m, size) from states (m, nq + nv) of the plant.

        Returns None if the output's port must be read: it has no rule in `of_state`, and its block is not a
        `FramePoses` that has yet to join the diagram.

        Args:
            output: name of the output.
        """
        if output in self.of_state:
            return self.of_state[output].of
        # There is no report if the block of the output is in the diagram.
        report = self._reports.get(output)
        if report is None or not isinstance(report.block, FramePoses):
            return None
        # A block of poses need not join the diagram: its method `at` computes them from states of the plant. Blocks of
        # other classes join when their port is read.
        return partial(report.block.at, self._ports[output].get_name())

    def value(self, output: str, context: Context) -> Vector:
        """Compute an output in a context, by its rule from the plant's state if there is one, otherwise by its port.

        Args:
            output: name of the output.
            context: context of the whole diagram.

        Returns:
            The values, shape (size,).
        """
        rule = self.from_state(output)
        if rule is None:
            return _evaluate(self._ports[output], context)
        state = _evaluate(self._state, context)
        # The rule takes many states at once, and here one.
        return np.asarray(rule(state[np.newaxis])[0])


def _evaluate(port: OutputPort, context: Context) -> Vector:
    """Evaluate a port in a context of the whole diagram."""
    port_context = port.get_system().GetMyContextFromRoot(context)
    return np.array(port.Eval(port_context))


keep_former_attributes(OutputRegistry, later="after_run", copied="make_copy")
