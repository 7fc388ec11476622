"""A program of a robot: moves by name, of axes, gaits, tools and pieces, that mean the same on every robot; and cells.

A sequencer lies over the reference, beneath the loops that the station has, for one run.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Self

import yaml
from pydantic import BeforeValidator, PlainSerializer, model_validator

from simrob_drake.base.arguments import as_path, instance
from simrob_drake.base.errors import InvalidParameter, counted, shortened
from simrob_drake.base.folders import written_at_once
from simrob_drake.base.messages import message
from simrob_drake.base.packages import Border
from simrob_drake.base.sections import Duration, Positive, Strict, validated
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

NAME = "automatic"  # what the sequencer is called in the station that runs a program


class Automatic(Pace):
    """How a robot goes through the references of a program."""

    timeout: Positive = 15.0
    """How long a cell may take [s]."""


def pace_of(value: bool | Automatic | Mapping[str, Any]) -> Automatic:
    """Return how to go through cells, True for as usual.

    Raises:
        InvalidConfig: a wrong entry of a mapping; InvalidParameter: no mapping at all.
    """
    if value is True:
        return Automatic()
    expected = message("programs.true_or_reach", "True, or a mapping such as {{'tolerance_deg': 3, 'timeout': 20}}")
    if isinstance(value, Automatic):
        return value
    return validated(Automatic, dict(instance(value, NAME, Mapping, expected)), NAME)


def run_cells(robot: CellRobot, cells: Sequence[JointMove], pace: Automatic) -> SimulationResult:
    """Let a robot go through cells from where it is, while others hold their places; the run ends with the last one.

    Sequencers that the station has for the robot do nothing meanwhile. Raises InvalidParameter: no cell, a target
    beyond its limits, or a kinematic station; InvalidConfig: a cell whose way takes longer than the time-out.
    """
    if not cells:
        raise InvalidParameter(
            message("programs.the_program", "the program"),
            message("programs.without_references", "without references"),
            message("programs.with_references", "one with some: add_reference() stores them"),
        )
    own = robot.cell.config
    others = {
        name: one
        for name, one in own.controllers.items()
        if not (isinstance(one, Sequencer) and (one.robot or own.only_robot) == robot.name)
    }
    section = validated(
        Sequencer,
        {
            "kind": "sequencer",
            "robot": robot.name,
            "priority": min((loop.priority or 0 for loop in loops_of(others).values()), default=0) - 1,
            "cells": [Cell(targets_deg=move.target_deg, duration=move.duration) for move in cells],
            "ends": True,
            **pace.model_dump(),
        },
        NAME,
    )
    longest = len(cells) * (pace.timeout + 1 / section.rate) + 2 / section.rate  # with the first sample and the last
    station = own.model_copy(update={"controllers": {**others, NAME: section}})
    check_parts(resolve(station))
    return robot.cell.follow_as(station, {}, longest, forget=NAME)  # the next sequence begins anew


Reference = Annotated[JointMove, PlainSerializer(JointMove.entry)]


def _as_usual(value: Any) -> Any:
    return ({} if value else None) if isinstance(value, bool) else value


class Program(Strict):
    """What a robot is told: moves, and cells for a sequencer. Every change gives a new program.

    A move is ``{target_deg, duration}``, ``{walk: {steps, amplitude, gait, ...}}``, ``{act: bow}``, ``{attach: box}``,
    ``{release: box}``, ``{wait: 0.5}`` or ``{play: 5}``; of an arm also ``{move_l: {targets, wobj, speed, ...}}``,
    likewise ``move_abs_j``, ``move_j`` and ``move_c``, ``{tool: pencil}`` or ``{together: [...]}``.
    The files beside :mod:`simrob_drake.programs.moves.kinds` have all keys, :mod:`simrob_drake.programs.timeline` those
    of changes.
    """

    description: str = ""
    """What it is, in a line."""
    station: str | None = None
    """Where `simrob run` runs it: a station's name, or a file from where the program lies."""
    robot: str | None = None
    """Which robot of that station; needed where there are several. Moves of arms may name others."""
    moves: tuple[AnyMove, ...] = ()
    """One after the other, from where the robot stands at the start."""
    references: tuple[Reference, ...] = ()
    """Cells (SimRob's ``joint{k}``) that a sequencer goes through, each for as long as it takes."""
    grid: Duration | None = None
    """Runs are cut at multiples of this time [s], from each of which they can be repeated; 0.05 with changes."""
    changes: tuple[Annotated[Change, PlainSerializer(Change.entry)], ...] = ()
    """What happens to the station while the moves run: settings, pushes, drags."""
    automatic: Annotated[Automatic | None, BeforeValidator(_as_usual)] = None
    """How references are run instead of moves, in the robot's own time: `{tolerance_deg: 3}`, or `true`."""

    @model_validator(mode="after")
    def _something_automatic(self) -> Self:
        if self.automatic and not self.references:
            raise ValueError(
                message("programs.automatic_without_references", "automatic: references are run, and there are none")
            )
        return self

    @property
    def duration(self) -> float:
        """Of all moves of joints [s]; what walks and acts take depends on the robot."""
        return float(sum(move.duration for move in self.moves if isinstance(move, JointMove)))

    def __repr__(self) -> str:
        moves = ", ".join(move.key for move in self.moves)
        held = f"{counted(len(self.moves), 'move')}{shortened(f': {moves}') if moves else ''}"
        references = f"; {counted(len(self.references), 'reference')}" if self.references else ""
        return f"<Program of {held}{references}>"

    __str__ = __repr__

    @property
    def plays_references(self) -> bool:
        """Whether the only move is to play the references of the station, so that messages need not name the move."""
        return len(self.moves) == 1 and isinstance(self.moves[0], PlayMove)

    def added(self, *moves: Move) -> "Program":
        """Return the program with moves behind it."""
        _check_moves(*moves)
        return self.model_copy(update={"moves": (*self.moves, *moves)})

    def inserted(self, index: int, move: Move) -> "Program":
        """Return the program with a move before the one of number ``index``, counted from 0; its length: at the end.

        Raises:
            InvalidParameter: no such number.
        """
        _check_moves(move)
        place = self._place(index, len(self.moves))
        return self.model_copy(update={"moves": (*self.moves[:place], move, *self.moves[place:])})

    def removed(self, index: int) -> "Program":
        """Return the program without a move; negative numbers count from the end.

        Raises:
            InvalidParameter: no such number.
        """
        place = self._place(index, len(self.moves) - 1)
        return self.model_copy(update={"moves": (*self.moves[:place], *self.moves[place + 1 :])})

    def edited(self, index: int, move: Move) -> "Program":
        """Return the program with another move in place of one.

        Raises:
            InvalidParameter: no such number.
        """
        _check_moves(move)
        place = self._place(index, len(self.moves) - 1)
        return self.model_copy(update={"moves": (*self.moves[:place], move, *self.moves[place + 1 :])})

    def with_automatic(self, pace: bool | Automatic | Mapping[str, Any]) -> "Program":
        """Return the program with another way to be run.

        Raises:
            SimrobError: as :func:`pace_of`.
        """
        return self.model_copy(update={"automatic": None if pace is False else pace_of(pace)})

    def on(self, station: str) -> "Program":
        """Return the program with another station that it is to run on."""
        return self.model_copy(update={"station": station})

    def with_reference(self, cell: JointMove) -> "Program":
        """Return the program with a cell behind the others."""
        instance(
            cell,
            "cell",
            JointMove,
            message("programs.a_joint_move", "a JointMove, such as JointMove(target_deg={{'waist': 10}})"),
        )
        return self.model_copy(update={"references": (*self.references, cell)})

    def save(self, file: Path | str) -> Path:
        """Write the program as YAML, in place of what the file holds, and return the file.

        Raises:
            OutputError: it cannot be written; then what was there stays as it was.
        """
        target = as_path(file, "file")
        written_at_once(target, self.text())
        return target

    def text(self) -> str:
        """Return the program as YAML."""
        content = {key: value for key, value in self.model_dump(mode="json").items() if value}
        how: dict[str, Any] = {"sort_keys": False, "allow_unicode": True, "width": 120, "default_flow_style": None}
        return str(yaml.dump(content, Dumper=yaml.CSafeDumper, **how))

    @classmethod
    def load(cls, file: Path | str) -> "Program":
        """Return the program that a YAML file holds.

        Raises:
            InvalidConfig: a file that cannot be read or is damaged; names the file, the move and the key, or the line.
        """
        source = as_path(file, "file")
        program, folder, border = cls.of_content(read_yaml(source), source), source.absolute().parent, Border(source)
        changes = tuple(
            change.model_copy(update={"set": changes_with_absolute_paths(change.set, folder, border)})
            if change.set
            else change
            for change in program.changes
        )
        return program.model_copy(update={"changes": changes}) if changes else program

    @classmethod
    def of_text(cls, text: str, where: str = message("programs.the_program", "the program")) -> "Program":
        """Return the program that a YAML text holds, likewise; errors call it as ``where`` says."""
        content = parse_yaml(text, where)
        return cls.of_content(
            instance(content, where, dict, message("programs.mapping_with_moves", "a mapping with moves")), where
        )

    @classmethod
    def of_content(cls, content: dict[str, Any], source: Path | str) -> "Program":
        """Return the program of a mapping, likewise; errors call it as ``source`` says."""
        for index, entry in enumerate(_entries(content, "moves")):
            check_move(entry, move_name(index, len(content["moves"]), str(source)))
        for index, entry in enumerate(_entries(content, "references")):
            check_move(entry, reference_name(index, str(source)), {JointMove.key: JointMove})
        return validated(cls, content, source)

    def _place(self, index: int, last: int) -> int:
        count = len(self.moves)
        instance(index, "index", int, message("programs.number_of_move", "the number of a move"))
        place = index + count if index < 0 else index
        if not 0 <= place <= last:
            known = message(
                "programs.known_numbers",
                "from {first} to {last}, the program has {moves} {moves:move|moves}",
                first=-count,
                last=last,
                moves=count,
            )
            raise InvalidParameter(
                "index", index, known if last >= 0 else message("programs.no_move_yet", "of a move; there is none")
            )
        return place


def _entries(content: Mapping[str, Any], key: str) -> list[Any]:
    """Entries of a list in a program's file. Empty if the key is missing, or holds something else than a list."""
    entries = content.get(key)
    return entries if isinstance(entries, list) else []


def _check_moves(*moves: object) -> None:
    for move in moves:
        instance(
            move, "move", Move, message("programs.a_move", "a move, such as JointMove(target_deg={{'waist': 10}})")
        )
