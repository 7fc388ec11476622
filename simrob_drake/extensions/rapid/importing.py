"""A RAPID program as a program of this package: what its main procedure does, move by move."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, TypeAlias

from simrob_drake.base.arguments import as_path
from simrob_drake.base.errors import nearest
from simrob_drake.base.messages import message
from simrob_drake.extensions.rapid.controller import Controller
from simrob_drake.extensions.rapid.expressions import Call, Expressions, Location
from simrob_drake.extensions.rapid.functions import FUNCTIONS
from simrob_drake.extensions.rapid.instructions import FUNCTIONS_OF_CONTROLLER, INSTRUCTIONS
from simrob_drake.extensions.rapid.signals import Signals
from simrob_drake.extensions.rapid.syntax import (
    Datum,
    LineRemark,
    Module,
    Node,
    RapidError,
    Routine,
    RoutineParameter,
    neighbours,
    nodes,
    read_modules,
)
from simrob_drake.extensions.rapid.values import LeftOut, NoData, Value, WrongType
from simrob_drake.programs.arm import Workcell
from simrob_drake.programs.plan import CHECKED, Check
from simrob_drake.programs.program import Program
from simrob_drake.stations.station import StationLike

_DEEPEST = 40  # routines that wait for each other
_MOST_STATEMENTS = 1_000_000
_MOST_AFTER_LOSS = 100  # rounds of a loop, whose end may hang on what was left out
_CONDITIONS = (
    "if",
    "compact_if",
    "while",
)  # whose unknown names are mostly signals of the controller


_Argument: TypeAlias = tuple[RoutineParameter, Datum, Location | None]
"""A parameter with its data, and where what is assigned to it goes in the end."""


class Ended(Exception):
    """The program ends itself."""


class _Returned(Exception):
    """A routine ends, and gives a value if it is a function."""


class _Jump(Exception):
    """A statement GOTO."""


class Interpreter(Expressions):
    """Does a program."""

    def __init__(
        self,
        modules: Iterable[Module],
        instructions: Mapping[str, Callable[[Call], None]],
        functions: Mapping[str, Callable[[Call], Value]],
        signal: Callable[[str], float | None],
        cycles: int,
    ) -> None:
        """Read what modules declare; what instructions and functions do is by name in lower case.

        A loop WHILE TRUE is done ``cycles`` times; ``signal`` gives a signal's value.
        """
        super().__init__(modules, {**FUNCTIONS, **functions}, signal)
        own = {
            "goto": self._goto,
            "callbyvar": self._call_by_var,
            "exit": self._end,
            "exitcycle": self._end,
        }
        self._instructions = {**instructions, **own}
        self._cycles, self._depth, self._done = cycles, 0, 0

    def run(self, main: str = "main") -> None:
        """Do a procedure of the program; raises RapidError: something that cannot be; names the file and the line."""
        self.remarks += self._faults
        routine = self._scope.find(main)
        if not isinstance(routine, Routine):
            routine = self._only_procedure(main)
        try:
            self._run(routine, [])
        except Ended:
            return
        except RecursionError:
            raise RapidError(
                message("rapid.first_line", "{file}: line 1", file=self._scope.file),
                message("rapid.nested_too_deeply", "is nested too deeply"),
            ) from None

    def _only_procedure(self, main: str) -> Routine:
        """Return the only procedure of the last module that needs nothing and that none of it calls."""
        own = [routine for routine in self._scope.names() if isinstance(routine, Routine)]
        called = {
            str(call.children[0]).lower() for routine in own for call in nodes(routine.body, "call")
        }
        rows = [
            one
            for one in own
            if not one.gives and not one.parameters and one.name.lower() not in called
        ]
        problem = message("rapid.no_proc", "there is no PROC {main}()", main=main)
        if len(rows) != 1:
            found = ", ".join(f"{one.name}()" for one in rows)
            raise RapidError(
                message("rapid.first_line", "{file}: line 1", file=self._scope.file),
                problem
                + (
                    message(
                        "rapid.call_one_in_main", ", but {found}: call one in a main", found=found
                    )
                    if found
                    else ""
                ),
            )
        self.remarks.append(
            LineRemark(
                self._scope.file,
                1,
                message(
                    "rapid.proc_is_done",
                    "{problem}: {name}() is done",
                    problem=problem,
                    name=rows[0].name,
                ),
                lost=False,
            )
        )
        return rows[0]

    def _block(self, lines: list[Node]) -> None:
        row = 0
        while row < len(lines):
            try:
                self._do(lines[row])
                row += 1
            except _Jump as jump:
                labels = [
                    line.data == "label" and line.children[0].lower() == jump.args[0]
                    for line in lines
                ]
                if True not in labels:
                    raise
                row = labels.index(True)

    def _do(self, node: Node) -> None:
        self._done += 1
        with self._naming_line(node):
            if self._done > _MOST_STATEMENTS:
                raise WrongType(
                    message(
                        "rapid.endless_statements",
                        "the program does not end within {most} statements",
                        most=_MOST_STATEMENTS,
                    )
                )
            try:
                getattr(self, f"_do_{node.data}")(*node.children)
            except WrongType as problem:
                if not isinstance(problem, LeftOut) and not any(
                    remark.lost for remark in self.remarks
                ):
                    raise  # else it may be so because of what was left out
                if node.data == "return":
                    raise _Returned(problem) from problem
                asks = node.data in _CONDITIONS and isinstance(problem, NoData)
                hint = (
                    message(
                        "rapid.name_signal_in_table",
                        "; if it is a signal, name it in a table, --io",
                    )
                    if asks
                    else ""
                )
                self.remark(
                    node,
                    message(
                        "rapid.problem_left_out",
                        "{problem}{hint}; left out",
                        problem=problem,
                        hint=hint,
                    ),
                )
                if node.data == "assignment":
                    self._forget(node.children[0], problem)

    def _forget(self, target: Node, problem: WrongType) -> None:
        """Have data hold nothing, since what they were to hold is not known: what needs them is left out, too."""

        def unknown() -> Value:
            raise problem

        while target.data != "name":
            target = target.children[0]
        found = self._find(target.children[0])
        if isinstance(found, Datum) and not found.constant:
            found.held, found.first = None, unknown

    def _do_data(self, *parts: Node) -> None:
        for item in parts[3:]:
            name, datum = self._datum(self._scope, (parts, item))
            if not self.types.known(datum.kind):
                raise WrongType(
                    message("rapid.unknown_type", "the type {kind} is not known", kind=parts[2])
                )
            _ = datum.value
            self._locals[name.lower()] = datum

    def _do_assignment(self, target: Node, expression: Node) -> None:
        place = self.place(target)
        place.set(self.types.fitted(place.kind, self.value(expression), place.dimensions))

    def _do_call(self, name: Node, arguments: Node | None) -> None:
        found, call = self._find(name), self._call_of(name, name, arguments)
        if isinstance(found, Routine):
            self._called(found, call)
        elif name.lower() in self._instructions:
            self._instructions[name.lower()](call)
        else:
            self.remark(
                name,
                message(
                    "rapid.unknown_instruction",
                    "{name} is not known, and left out{hint}",
                    name=name,
                    hint=self._hint(name, self._instructions),
                ),
            )

    def _do_late_call(self, name: Node, arguments: Node | None) -> None:
        routine = self._procedure(self.typed(name, "string"))
        self._called(routine, self._call_of(routine.name, name, arguments))

    def _call_by_var(self, call: Call) -> None:
        routine = self._procedure(f"{call.value(0, 'string')}{call.value(1, 'num'):g}")
        self._called(routine, self._call_of(routine.name, call.node, None))

    def _procedure(self, name: str) -> Routine:
        routine = self._find(name)
        if not isinstance(routine, Routine):
            raise WrongType(
                message("rapid.no_procedure", "there is no procedure '{name}'", name=name)
            )
        return routine

    def _do_return(self, expression: Node | None) -> None:
        raise _Returned(None if expression is None else self.value(expression))

    def _do_connect(self, target: Node, trap: Node) -> None:
        self.remark(
            trap,
            message(
                "rapid.trap_left_out", "interrupts are not done: TRAP {trap} is left out", trap=trap
            ),
        )

    def _do_label(self, name: Node) -> None:
        pass

    def _do_if(self, *parts: Node) -> None:
        for condition, block in zip(parts[:-1:2], parts[1:-1:2], strict=True):
            if self.typed(condition, "bool"):
                return self._block(block.children)
        otherwise = parts[-1]
        return self._block(otherwise.children) if otherwise is not None else None

    def _do_compact_if(self, condition: Node, statement: Node) -> None:
        if self.typed(condition, "bool"):
            self._do(statement)

    def _do_for(self, name: Node, begin: Node, end: Node, step: Node | None, block: Node) -> None:
        at, last = self.typed(begin, "num"), self.typed(end, "num")
        by = self.typed(step, "num") if step is not None else (1.0 if at <= last else -1.0)
        if by == 0:
            raise WrongType(message("rapid.step_of_zero", "a STEP of 0, which never ends"))
        hidden = self._locals.get(name.lower())
        while (last - at) * by >= 0:
            self._locals[name.lower()] = Datum("num", held=at)
            self._block(block.children)
            at += by
        self._locals.pop(name.lower(), None)
        if hidden:
            self._locals[name.lower()] = hidden

    def _do_while(self, condition: Node, block: Node) -> None:
        endless, rounds = condition.data == "name" and condition.children[0].lower() == "true", 0
        while self.typed(condition, "bool"):
            if endless and rounds == self._cycles:
                times = (
                    "once"
                    if rounds == 1
                    else message("rapid.times", "{rounds} times", rounds=rounds)
                )
                self.remark(
                    condition,
                    message(
                        "rapid.while_true",
                        "WHILE TRUE is done {times}, then the program ends: see --cycles",
                        times=times,
                    ),
                    lost=False,
                )
                raise Ended
            self._block(block.children)
            rounds += 1
            if rounds == _MOST_AFTER_LOSS and any(remark.lost for remark in self.remarks):
                self.remark(
                    condition,
                    message(
                        "rapid.loop_is_left",
                        "a loop that does not end within {rounds} rounds is left: see what is lost",
                        rounds=rounds,
                    ),
                )
                return
            self._done += 1
            if self._done > _MOST_STATEMENTS:
                raise WrongType(
                    message(
                        "rapid.endless_loop",
                        "a loop that does not end within {most} rounds",
                        most=_MOST_STATEMENTS,
                    )
                )

    def _do_test(self, expression: Node, *cases: Node) -> None:
        value = self.value(expression)
        for case in cases[:-1]:
            choices, block = case.children
            if any(self._applied("=", value, self.value(choice)) for choice in choices.children):
                return self._block(block.children)
        otherwise = cases[-1]
        return self._block(otherwise.children) if otherwise is not None else None

    def _goto(self, call: Call) -> None:
        raise _Jump(str(call.argument(0).children[0]).lower(), self.where(call.node))

    def _end(self, call: Call) -> None:
        raise Ended

    def _called(self, routine: Routine, call: Call) -> Any:
        return self._run(routine, self._bound(routine, call))

    def _bound(self, routine: Routine, call: Call) -> list[_Argument]:
        """Return the parameters of a routine with what a call gives for them, and where shared ones come from."""
        needed = [parameter for parameter in routine.parameters if not parameter.optional]
        if len(needed) != call.count:
            raise WrongType(
                message(
                    "rapid.arguments_of_routine",
                    "{routine} with {count} arguments, of {needed} that it has,",
                    routine=routine.name,
                    count=call.count,
                    needed=len(needed),
                )
            )
        passed = list(zip(needed, call.arguments, strict=True))
        known = {
            parameter.name: parameter for parameter in routine.parameters if parameter.optional
        }
        for name, node in call.options.items():
            if name not in known:
                raise WrongType(
                    message(
                        "rapid.no_option",
                        "{routine} has no option '{name}'{suggestion}",
                        routine=routine.name,
                        name=name,
                        suggestion=nearest(name, known),
                    )
                )
            passed.append((known[name], node))
        return [self._argument(parameter, node) for parameter, node in passed]

    def _argument(self, parameter: RoutineParameter, node: Node | None) -> _Argument:
        if node is None:
            return parameter, Datum("bool", held=True), None
        if parameter.kind.startswith("signal"):
            return parameter, Datum(parameter.kind, held=self.signal(node)), None
        value = self.types.fitted(parameter.kind, self.value(node), parameter.dimensions)
        place = self.place(node) if parameter.shared else None
        return parameter, Datum(parameter.kind, parameter.dimensions, held=value), place

    def _run(self, routine: Routine, bound: list[_Argument]) -> Any:
        if self._depth == _DEEPEST:
            raise WrongType(
                message(
                    "rapid.calls_itself",
                    "{routine} is called {deepest} deep: it calls itself without an end",
                    routine=routine.name,
                    deepest=_DEEPEST,
                )
            )
        self._depth += 1
        value = None
        with self._in(routine.scope, {parameter.name: datum for parameter, datum, _ in bound}):
            try:
                self._block([line for line in routine.body.children if line.data != "handler"])
            except _Returned as returned:
                value = returned.args[0]
            except _Jump as jump:
                raise RapidError(
                    jump.args[1],
                    message(
                        "rapid.no_label",
                        "there is no label '{label}' in {routine}",
                        label=jump.args[0],
                        routine=routine.name,
                    ),
                ) from None
        self._depth -= 1
        if isinstance(value, WrongType):
            raise value
        for _, datum, place in bound:
            if place is not None:
                place.set(datum.value)
        if routine.gives:
            if value is None:
                raise WrongType(
                    message(
                        "rapid.without_return",
                        "FUNC {routine} ends without RETURN",
                        routine=routine.name,
                    )
                )
            dimensions = (
                1 if isinstance(value, list) and routine.gives not in self.types.records else 0
            )
            return self.types.fitted(routine.gives, value, dimensions)
        return None


@dataclass(frozen=True)
class Imported:
    """A program, and what its user should know of it."""

    program: Program  # the moves
    remarks: tuple[LineRemark, ...]  # about lines of the modules, in their order
    time: float  # that the program takes [s]
    lines: Mapping[int, str]  # the file and line of the last target of moves, by their number

    @property
    def lost(self) -> list[LineRemark]:
        """What was not understood, and so is not done."""
        return [remark for remark in self.remarks if remark.lost]


def import_rapid(
    files: Path | str | Sequence[Path | str],
    station: StationLike,
    *,
    robot: str | None = None,
    signals: Signals | Path | str | None = None,
    cycles: int = 1,
    check: Check = CHECKED,
) -> Imported:
    """Do a RAPID program's main procedure without a run, and return the moves that it makes on a station.

    ``files`` are of its modules, or a `.pgf`; the only robot need not be named; ``signals`` are what inputs and outputs
    mean, or a table's file; a loop WHILE TRUE is done ``cycles`` times; ``check`` is looked at before each move beside
    its reach. Raises RapidError: what cannot be understood or done; names the file and the line.
    """
    sources = [files] if isinstance(files, (Path, str)) else files
    paths = [as_path(file, "file") for file in sources]
    modules = [module for path in paths for module in read_modules(path)]
    near, remarks_of_near = neighbours(paths, modules)
    table = (
        signals
        if isinstance(signals, Signals)
        else Signals()
        if signals is None
        else Signals.load(signals)
    )
    cell = Workcell(station)
    controller = Controller(
        cell, robot, table, cell.run_plans if table.sensors else cell.stand, check
    )
    interpreter = Interpreter(
        [*near, *modules],
        {name: partial(instruction, controller) for name, instruction in INSTRUCTIONS.items()},
        {name: partial(function, controller) for name, function in FUNCTIONS_OF_CONTROLLER.items()},
        lambda name: table.value(name, controller.time, controller.seen),
        cycles,
    )
    interpreter.run()
    controller.finish()
    if not any(move.takes_time for move in controller.moves):
        lost = [remark for remark in interpreter.remarks if remark.lost]
        left_out = (
            message(
                "rapid.lines_left_out",
                "; {count} lines were left out, the first: {first}",
                count=len(lost),
                first=lost[0],
            )
            if lost
            else ""
        )
        raise RapidError(
            message("rapid.first_line", "{file}: line 1", file=modules[0].file),
            message("rapid.no_move", "its main makes no move{left_out}", left_out=left_out),
        )
    name = None if cell.config.only_robot else controller.robot
    program = Program(
        description=f"Of the RAPID module {modules[0].name}",
        robot=name,
        moves=tuple(controller.moves),
    )
    remarks = sorted(
        [*remarks_of_near, *interpreter.remarks], key=lambda remark: (remark.file, remark.line)
    )
    return Imported(program, tuple(remarks), controller.time, controller.lines)
