"""Programs of robots: moves of axes, gaits, tools and pieces, one after the other.

An *automatic* program has references instead, also called *cells*: postures to which a *sequencer* leads the robot, one
after the other, each when the last one is reached. The sequencer is a controller that is added to the station for one
run.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Self

import yaml
from pydantic import BeforeValidator, PlainSerializer, model_validator

from simrob_drake.base.arguments import as_path, instance
from simrob_drake.base.errors import InvalidParameter, Unsuitable, format_count, shorten
from simrob_drake.base.folders import written_at_once
from simrob_drake.base.messages import message
from simrob_drake.base.packages import Border
from simrob_drake.base.renaming import keep_former_attributes
from simrob_drake.base.sections import Duration, Positive, Strict, validate_section
from simrob_drake.base.yaml_files import parse_yaml, read_yaml
from simrob_drake.parts.controllers import loops_of
from simrob_drake.parts.controllers.postures import Cell, Pace, Sequencer
from simrob_drake.programs.geometry import CellRobot
from simrob_drake.programs.moves.joints import JointMove
from simrob_drake.programs.moves.kinds import AnyMove, check_move
from simrob_drake.programs.moves.move import Move, move_name, reference_name
from simrob_drake.programs.moves.wait import PlayMove
from simrob_drake.programs.timeline import Change
from simrob_drake.results.result import SimulationResult
from simrob_drake.stations.file_paths import changes_with_absolute_paths
from simrob_drake.stations.resolve import check_parts, resolve

NAME = "automatic"
"""Name of the sequencer in the station that runs an automatic program."""


class Automatic(Pace):
    """Options by which a robot goes through the references of a program."""

    timeout: Positive = 15.0
    """Longest time for one cell [s]."""


def pace_of(value: bool | Automatic | Mapping[str, Any]) -> Automatic:
    """Read the options of an automatic program from an argument of a user.

    Args:
        value: the options, a mapping of their keys, or True for the defaults. False has no options: the caller treats
            it before.

    Raises:
        InvalidConfig: the mapping has a wrong entry.
        InvalidParameter: the value is no mapping.
    """
    if value is True:
        return Automatic()
    expected = message(
        "programs.true_or_reach", "True, or a mapping such as {{'tolerance_deg': 3, 'timeout': 20}}"
    )
    if isinstance(value, Automatic):
        return value
    return validate_section(Automatic, dict(instance(value, NAME, Mapping, expected)), NAME)


def run_cells(robot: CellRobot, cells: Sequence[JointMove], pace: Automatic) -> SimulationResult:
    """Run the cells of an automatic program from where a robot is, while other robots hold their positions.

    The run ends when the robot has reached the last cell. Sequencers that the station has for the robot are left out
    during the run.

    Args:
        robot: the robot.
        cells: the cells: targets of the axes, and the duration of the way to them.
        pace: options of the program.

    Returns:
        The result of the run. A cell that is not reached within the time-out ends the run early.

    Raises:
        InvalidParameter: there is no cell, a target is beyond its limits, or the station is kinematic.
        UnknownName: the robot has no axis of a target's name.
        InvalidConfig: the duration of the way to a cell is longer than the time-out.
    """
    if not cells:
        raise Unsuitable(
            message("programs.the_program", "the program"),
            message("programs.without_references", "it has no references"),
            message("programs.with_references", "add some by add_reference()"),
        )
    config = robot.cell.config
    others = {}
    # A second sequencer of the same robot would set the same references.
    for name, controller in config.controllers.items():
        is_own_sequencer = (
            isinstance(controller, Sequencer)
            and (controller.robot or config.only_robot) == robot.name
        )
        if not is_own_sequencer:
            others[name] = controller
    # Controllers act in the order of their priorities. The sequencer sets the reference, on which all others act.
    priorities = [loop.priority or 0 for loop in loops_of(others).values()]
    section = validate_section(
        Sequencer,
        {
            "kind": "sequencer",
            "robot": robot.name,
            "priority": min(priorities, default=0) - 1,
            "cells": [Cell(targets_deg=move.target_deg, duration=move.duration) for move in cells],
            "ends": True,
            **pace.model_dump(),
        },
        NAME,
    )
    # Longest duration of the run [s]. Each cell may be one sample late, and so may the first and the last sample.
    sample = 1 / section.rate
    longest = len(cells) * (pace.timeout + sample) + 2 / section.rate
    station = config.model_copy(update={"controllers": {**others, NAME: section}})
    check_parts(resolve(station))
    # The sequencer's state is deleted afterwards, so that the next sequence begins at its first cell.
    return robot.cell.follow_as(station, {}, longest, forget=NAME)


Reference = Annotated[JointMove, PlainSerializer(JointMove.entry)]


def _expand_bool(value: Any) -> Any:
    """Expand True to a mapping without keys, whose options are the defaults, and False to None.

    Other values are returned unchanged, for pydantic to check.
    """
    if isinstance(value, bool):
        return {} if value else None
    return value


class Program(Strict):
    """Moves of a robot, or cells for a sequencer. A program does not change: methods return a changed copy.

    A move is ``{target_deg, duration}``, ``{walk: {steps, amplitude, gait, ...}}``, ``{act: bow}``, ``{attach: box}``,
    ``{release: box}``, ``{wait: 0.5}`` or ``{play: 5}``; of an arm also ``{move_l: {targets, wobj, speed, ...}}``,
    and in the same way ``move_abs_j``, ``move_j`` and ``move_c``, ``{tool: pencil}`` or ``{together: [...]}``.
    All keys are in the folder of :mod:`simrob_drake.programs.moves.kinds`, those of changes in
    :mod:`simrob_drake.programs.timeline`.
    """

    description: str = ""
    """Description of the program in one line."""
    station: str | None = None
    """Station on which `simrob run` runs the program: a name, or a file relative to the folder of the program."""
    robot: str | None = None
    """Robot of that station. It is needed if there are several. Moves of arms may name other robots."""
    moves: tuple[AnyMove, ...] = ()
    """Moves, one after the other, from where the robot is at the start."""
    references: tuple[Reference, ...] = ()
    """Cells (SimRob's ``joint{k}``) to which a sequencer leads the robot, each for as long as it takes."""
    grid: Duration | None = None
    """Time between the moments at which runs are divided, and from which they can be repeated [s]. If it is not set, it
    is 0.05 for a program with changes."""
    changes: tuple[Annotated[Change, PlainSerializer(Change.entry)], ...] = ()
    """Changes of the station while the moves run: settings, pushes, drags."""
    automatic: Annotated[Automatic | None, BeforeValidator(_expand_bool)] = None
    """Options with which the references run instead of the moves, such as `{tolerance_deg: 3}`, or `true`."""

    @model_validator(mode="after")
    def _something_automatic(self) -> Self:
        """Check that an automatic program has references."""
        # Without references a sequencer has nothing to do: moves alone make no automatic program.
        if self.automatic and not self.references:
            raise ValueError(
                message(
                    "programs.automatic_without_references",
                    "automatic needs references, and the program has none",
                )
            )
        return self

    @property
    def duration(self) -> float:
        """Duration of all moves of joints [s]. Other moves, such as walks, acts and waits, are not included."""
        return float(sum(move.duration for move in self.moves if isinstance(move, JointMove)))

    def __repr__(self) -> str:
        # A long list of keys is cut: `repr` stays on one line.
        moves = ", ".join(move.key for move in self.moves)
        held = f"{format_count(len(self.moves), 'move')}{shorten(f': {moves}') if moves else ''}"
        references = (
            f"; {format_count(len(self.references), 'reference')}" if self.references else ""
        )
        return f"<Program of {held}{references}>"

    __str__ = __repr__

    @property
    def plays_references(self) -> bool:
        """Whether the only move is to play the references of the station, so that messages need not name the move."""
        return len(self.moves) == 1 and isinstance(self.moves[0], PlayMove)

    def with_added_moves(self, *moves: Move) -> "Program":
        """Make a copy with further moves at the end.

        Raises:
            InvalidParameter: a value is no move.
        """
        # `model_copy` checks nothing, so wrong values are refused here.
        _check_moves(*moves)
        return self.model_copy(update={"moves": (*self.moves, *moves)})

    def with_inserted_move(self, index: int, move: Move) -> "Program":
        """Make a copy with a further move at an index. The moves from this index on come after it.

        Args:
            index: index that the move gets, from 0. A negative index counts from the end: -1 inserts the move before
                the last one. The count of moves means the end of the program.
            move: the move.

        Raises:
            InvalidParameter: the index is out of range, or the value is no move.
        """
        _check_moves(move)
        # The end of the program is a valid index here, unlike for moves that exist.
        from_start = self._check_index(index, len(self.moves))
        return self.model_copy(
            update={"moves": (*self.moves[:from_start], move, *self.moves[from_start:])}
        )

    def without_move(self, index: int) -> "Program":
        """Make a copy without the move of an index, which counts from the end if it is negative.

        Raises:
            InvalidParameter: the index is out of range.
        """
        # Counted from the start, because a slice from -1 + 1 = 0 on would be the whole program.
        from_start = self._check_index(index, len(self.moves) - 1)
        return self.model_copy(
            update={"moves": (*self.moves[:from_start], *self.moves[from_start + 1 :])}
        )

    def with_replaced_move(self, index: int, move: Move) -> "Program":
        """Make a copy in which another move replaces that of an index, which counts from the end if it is negative.

        Raises:
            InvalidParameter: the index is out of range, or the value is no move.
        """
        _check_moves(move)
        from_start = self._check_index(index, len(self.moves) - 1)
        return self.model_copy(
            update={"moves": (*self.moves[:from_start], move, *self.moves[from_start + 1 :])}
        )

    def with_automatic(self, pace: bool | Automatic | Mapping[str, Any]) -> "Program":
        """Make a copy that is automatic, with options as of :func:`pace_of`; or not automatic, with False.

        Raises:
            SimrobError: see :func:`pace_of`.
        """
        return self.model_copy(update={"automatic": None if pace is False else pace_of(pace)})

    def on(self, station: str) -> "Program":
        """Make a copy for another station, a name or a file."""
        return self.model_copy(update={"station": station})

    def with_reference(self, cell: JointMove) -> "Program":
        """Make a copy with a further cell at the end of its references.

        Raises:
            InvalidParameter: the value is no move of joints.
        """
        # An arm and a robot with legs share this method, so the cell is checked once, here.
        instance(
            cell,
            "cell",
            JointMove,
            message(
                "programs.a_joint_move",
                "a JointMove, such as JointMove(target_deg={{'waist': 10}})",
            ),
        )
        return self.model_copy(update={"references": (*self.references, cell)})

    def save(self, file: Path | str) -> Path:
        """Write the program as YAML. An existing file is replaced.

        Returns:
            The file.

        Raises:
            OutputError: the file cannot be written. An existing one stays unchanged.
        """
        target = as_path(file, "file")
        # Written to another file first, which then replaces the old one: a full disk destroys nothing.
        written_at_once(target, self.text())
        return target

    def text(self) -> str:
        """Program as YAML. Keys without a value, or with an empty one, are left out."""
        # A file should have only what its author has set.
        content = {key: value for key, value in self.model_dump(mode="json").items() if value}
        # Lists of numbers stay on one line, and the keys in the order of the class, as people write them.
        yaml_options: dict[str, Any] = {
            "sort_keys": False,
            "allow_unicode": True,
            "width": 120,
            "default_flow_style": None,
        }
        return str(yaml.dump(content, Dumper=yaml.CSafeDumper, **yaml_options))

    @classmethod
    def load(cls, file: Path | str) -> "Program":
        """Read a program from a YAML file.

        Files that its changes name are relative to the folder of the program; in the result their paths are absolute.

        Raises:
            InvalidConfig: the file cannot be read, or is damaged. The message names the file, and the move and the key,
                or the line.
            SimrobError: a change names a file that this program may not read.
        """
        source = as_path(file, "file")
        program = cls.of_content(read_yaml(source), source)
        # Only changes of the station can name files.
        if not program.changes:
            return program
        # The border checks that a program from elsewhere reads no files outside its own folder.
        folder = source.absolute().parent
        border = Border(source)
        changes = []
        for change in program.changes:
            if change.set:
                settings = changes_with_absolute_paths(change.set, folder, border)
                changes.append(change.model_copy(update={"set": settings}))
            else:
                changes.append(change)
        return program.model_copy(update={"changes": tuple(changes)})

    @classmethod
    def of_text(
        cls, text: str, where: str = message("programs.the_program", "the program")
    ) -> "Program":
        """Read a program from a YAML text.

        Args:
            text: the text.
            where: name of the program for error messages.

        Raises:
            InvalidConfig: the text is damaged, or an entry is wrong.
            InvalidParameter: the text is no mapping.
        """
        content = parse_yaml(text, where)
        return cls.of_content(
            instance(
                content, where, dict, message("programs.mapping_with_moves", "a mapping with moves")
            ),
            where,
        )

    @classmethod
    def of_content(cls, content: dict[str, Any], source: Path | str) -> "Program":
        """Read a program from the content of a file.

        Args:
            content: the content, before any check.
            source: name of the program, or its file, for error messages.

        Raises:
            InvalidConfig: an entry is wrong. The message names the move and the key.
        """
        # Each move is checked by itself first: its message names the move. That of the whole program could not.
        for index, entry in enumerate(_entries(content, "moves")):
            check_move(entry, move_name(index, len(content["moves"]), str(source)))
        # References are moves of joints only, because a sequencer leads the joints.
        for index, entry in enumerate(_entries(content, "references")):
            check_move(entry, reference_name(index, str(source)), {JointMove.key: JointMove})
        return validate_section(cls, content, source)

    def _check_index(self, index: int, last: int) -> int:
        """Check the index of a move, and count it from the start.

        Args:
            index: the index, as the user gave it. It counts from the end if it is negative.
            last: largest index that is allowed; -1 if the program has no move.

        Returns:
            The index from the start, from 0 to `last`.

        Raises:
            InvalidParameter: the index is out of range, or no integer.
        """
        count = len(self.moves)
        instance(
            index,
            "index",
            int,
            message("programs.number_of_move", "an integer, the index of a move"),
        )
        from_start = index + count if index < 0 else index
        if not 0 <= from_start <= last:
            known = message(
                "programs.known_numbers",
                "from {first} to {last}: the program has {moves} {moves:move|moves}",
                first=-count,
                last=last,
                moves=count,
            )
            raise InvalidParameter(
                "index",
                index,
                known
                if last >= 0
                else message(
                    "programs.no_move_yet", "the index of a move, and the program has none"
                ),
            )
        return from_start


def _entries(content: Mapping[str, Any], key: str) -> list[Any]:
    """Entries of a list in a program's file. Empty if the key is missing, or holds something else than a list."""
    entries = content.get(key)
    # Something else than a list is refused later, with the name of the key.
    return entries if isinstance(entries, list) else []


def _check_moves(*moves: object) -> None:
    """Check that values are moves.

    Raises:
        InvalidParameter: one is not.
    """
    for move in moves:
        instance(
            move,
            "move",
            Move,
            message("programs.a_move", "a move, such as JointMove(target_deg={{'waist': 10}})"),
        )


keep_former_attributes(
    Program,
    added="with_added_moves",
    inserted="with_inserted_move",
    removed="without_move",
    edited="with_replaced_move",
)
