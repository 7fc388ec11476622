"""The application ``simrob`` to which all commands belong, and the function that runs it and reports its errors.

Typer makes commands from functions. To start fast, the application begins with commands that have only a name and a
help, which are read without an import of their modules (see :mod:`simrob_drake.cli.command_table`). When a command is
called, :func:`whole_command` imports its function and makes the command with its options. All classes here change
typer's helps and errors to texts of this project in the language of the output.
"""

import inspect
import os
import sys
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from importlib import import_module
from pathlib import Path
from typing import Annotated, Any

import typer
from typer.core import TyperCommand, TyperGroup
from typer.exceptions import TyperException

import simrob_drake
from simrob_drake.base.errors import InvalidParameter, SimrobError, UnknownName, shorten
from simrob_drake.base.messages import message, message_of, set_output_language, translate
from simrob_drake.cli import ExitCode
from simrob_drake.cli.command_table import (
    CommandEntry,
    all_commands,
    command_function,
    core_commands,
    extensions_left_out,
    find_command,
    subcommand_functions,
)
from simrob_drake.cli.help import (
    command_message,
    prepare_for_help,
    translate_frames,
    with_translated_options,
    write_usage,
)
from simrob_drake.cli.language import requested_language
from simrob_drake.cli.screen import Interrupted, console, say_error, say_warning
from simrob_drake.cli.usage_errors import command_name, unexpected_arguments, usage_problem


def _typer(**options: Any) -> typer.Typer:
    """Make an application of typer, with further options of ``typer.Typer``."""
    # In markdown, brackets around units such as [m/s] are no mark-up, as they would be in rich's own language.
    # Unexpected errors are shown in one line by `run_guarded` of the module __main__, so typer must not show them.
    return typer.Typer(rich_markup_mode="markdown", pretty_exceptions_enable=False, **options)


class _Command(TyperCommand):
    """A command whose help is in the language of the output, and shows a type only for options with a value.

    Its methods override those of typer.
    """

    def get_params(self, ctx: Any) -> list[Any]:
        return prepare_for_help(super().get_params(ctx))

    def format_usage(self, ctx: Any, formatter: Any) -> None:
        write_usage(self, ctx, formatter)

    def format_help(self, ctx: Any, formatter: Any) -> None:
        translate_frames()
        super().format_help(ctx, formatter)

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Read the arguments of the command.

        Returns:
            the arguments that are left, which only completion of a command line by a shell has.

        Raises:
            TyperException: an argument is wrong or missing.
            SimrobError: there are too many arguments.
        """
        # Typer would refuse arguments that are too many with a text of its own, so they are refused below.
        ctx.allow_extra_args = True
        try:
            rest = super().parse_args(ctx, args)
        except TyperException as problem:
            if getattr(problem, "ctx", None) is None:
                # Errors of the parser name no command, and their message needs its options.
                vars(problem)["ctx"] = ctx
            raise
        # A shell that completes a command line parses it before it is complete, and wants no errors.
        if rest and not ctx.resilient_parsing:
            raise SimrobError(unexpected_arguments(command_name(ctx), rest))
        return rest


class _Group(TyperGroup):
    """A command with commands below it, such as ``simrob course``. Its help is like that of :class:`_Command`."""

    def get_params(self, ctx: Any) -> list[Any]:
        return prepare_for_help(super().get_params(ctx))

    def format_usage(self, ctx: Any, formatter: Any) -> None:
        write_usage(self, ctx, formatter)

    def format_help(self, ctx: Any, formatter: Any) -> None:
        translate_frames()
        super().format_help(ctx, formatter)

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """Find the command that is called, by its name, the first of the arguments.

        Raises:
            UnknownName: there is no such command.
            TyperException: the first argument is an option, which must come after a command.
        """
        try:
            return super().resolve_command(ctx, args)
        except TyperException:
            # `usage_problem` makes the message about an option.
            if args[0].startswith("-"):
                raise
            raise UnknownName(
                message("cli.command", "command"), args[0], self.list_commands(ctx)
            ) from None


class _Commands(_Group):
    """Group of all commands. Until a command is called, only its name and its help are loaded."""

    def __init__(self, **options: Any) -> None:
        """Begin with the commands of the core.

        Those of extensions are added when all commands are listed, or when the core has no command of a name.

        Args:
            **options: options of typer's group.
        """
        # Typer passes an empty mapping of commands, since none was added to the application.
        named = {name: _named_command(name, entry) for name, entry in core_commands().items()}
        super().__init__(**{**options, "commands": named})

    def get_params(self, ctx: Any) -> list[Any]:
        """List the parameters of ``simrob`` itself, with the help of ``--version`` in the language of the output."""
        parameters = super().get_params(ctx)
        for parameter in parameters:
            if parameter.name == "show":  # the option --version, see `version`
                parameter.help = translate(_HELP_OF_VERSION)
        return parameters

    def format_help(self, ctx: Any, formatter: Any) -> None:
        # This object is made once, so it takes the language of the output when the help is written.
        self.help = translate(_HELP)
        super().format_help(ctx, formatter)

    def list_commands(self, ctx: Any) -> list[str]:
        """Names of all commands in the order of the help."""
        self._add_extensions()
        return list(all_commands())

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        """Find a command by name. Returns None if there is none.

        The command may have only a name and a help, see :func:`_named_command`.
        """
        # The search for extensions takes time, so it is only made for a name that the core does not have.
        if cmd_name not in self.commands:
            self._add_extensions()
        return super().get_command(ctx, cmd_name)

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """Find the command that is called, and import its function to have its options.

        The message about an unknown command also names the extensions that are left out: one of them may have it.

        Returns:
            name of the command, the command (None if typer only completes a command line for a shell), and the
            arguments after its name.

        Raises:
            UnknownName: there is no such command.
            SimrobError: there is no such command, and an extension that is left out may have it.
            BrokenExtension: an extension adds the command, and it cannot be imported.
        """
        try:
            name, command, rest = super().resolve_command(ctx, args)
        except UnknownName as problem:
            left_out = extensions_left_out()
            if not left_out:
                raise
            raise SimrobError(
                message(
                    "cli.command_may_be_left_out",
                    "{problem}. Extensions that are left out: {names}; simrob extensions lists the reasons.",
                    problem=problem,
                    names=", ".join(left_out),
                )
            ) from None
        if command is None:
            return name, None, rest
        # The command that was found has only a name and a help, see `_named_command`.
        return name, whole_command(str(name)), rest

    def invoke(self, ctx: Any) -> Any:
        """Run the command that is called.

        Raises:
            Interrupted: the user interrupted the command.
        """
        try:
            return super().invoke(ctx)
        except KeyboardInterrupt:
            # Typer alone would end the program without a message.
            raise Interrupted(message("cli.interrupted", "interrupted")) from None

    def _add_extensions(self) -> None:
        """Add the commands of installed extensions to the group, with only a name and a help."""
        for name, entry in all_commands().items():
            # A command of the core keeps its place, and is not made a second time.
            if name not in self.commands:
                self.commands[name] = _named_command(name, entry)


def _named_command(name: str, entry: CommandEntry) -> TyperCommand:
    """Make a command for the list of commands in the help. It has a name, a help and a title, but cannot be run."""
    return TyperCommand(name, help=translate(entry.help), rich_help_panel=translate(entry.title))


def whole_command(name: str) -> Any:
    """Make a command of ``simrob``, with all of its options and the commands below it.

    Args:
        name: name of the command, of one word.

    Returns:
        the command, as typer runs it.

    Raises:
        UnknownName: there is no such command.
        BrokenExtension: an extension adds the command, and it cannot be imported.
    """
    entry = find_command(name)
    if entry is None:
        raise UnknownName(message("cli.command", "command"), name, all_commands())
    # Typer makes a command of a function only as a part of an application, so this one is for the command alone.
    application = _typer(add_completion=False)
    function = command_function(entry)
    help_text = _help_of(name, function, entry.package)
    subcommands = subcommand_functions(name)
    if not subcommands:
        add_command = application.command(name, cls=_Command, help=help_text)
        add_command(with_translated_options(function))
        return typer.main.get_command(application)

    # Here the function of the command does not run alone: typer calls it before that of the command below. Its
    # docstring is the help that is shown if no command below is given.
    add_callback = application.callback(cls=_Group, no_args_is_help=True, help=help_text)
    add_callback(with_translated_options(function))
    for subcommand, subfunction in subcommands.items():
        subcommand_help = _help_of(f"{name} {subcommand}", subfunction, entry.package)
        add_command = application.command(subcommand, cls=_Command, help=subcommand_help)
        add_command(with_translated_options(subfunction))
    return typer.main.get_command(application)


def _help_of(name: str, function: Callable[..., Any], package: str) -> str:
    """Make the help of a command, in the language of the output, from the docstring of its function.

    Args:
        name: name of the command, of one or two words.
        function: the function.
        package: first word of the message's id: "cli", or the name of an extension.
    """
    return translate(command_message(name, inspect.getdoc(function) or "", package))


_LONGEST_PATH = 1000
"""Largest count of characters of a path in a message. The end of a longer path is cut off."""

_HELP = message("cli.help_simrob", "Build, control, program and watch robot stations.")
_HELP_OF_VERSION = message("cli.help_version_show", "Show the version and exit.")


app = _typer(
    cls=_Commands,
    help=_HELP,
    no_args_is_help=True,
    context_settings={"help_option_names": ["-h", "--help"]},
)


def load(arguments: list[str]) -> None:
    """Import the module of the command that the arguments call, before the command is run.

    The caller turns the garbage collector off during the imports, which saves time. Nothing is raised: a problem
    occurs again, and is reported, when the command is run.

    Args:
        arguments: arguments of ``simrob``, the name of the command first.
    """
    entry = find_command(arguments[0]) if arguments else None
    if entry is None:
        return
    # The module of an extension may raise anything.
    with suppress(Exception, SystemExit):
        import_module(entry.module)


def run_command(arguments: list[str]) -> int:
    """Run a command, and write errors that a user can cause to the error stream, in one line.

    Args:
        arguments: arguments of ``simrob``, the name of the command first.

    Returns:
        exit code of the command, see :class:`~simrob_drake.cli.ExitCode`.
    """
    # The language is needed before the arguments are parsed: errors of parsing and helps are in this language, too.
    set_output_language(requested_language(arguments))
    try:
        _check_surroundings(arguments)
        with _own_warnings():
            # Typer's standalone mode would write errors itself, and end the program.
            code = app(arguments, prog_name="simrob", standalone_mode=False)
        # A broken pipe or a full disk may show only when the buffer is written. Here the error is still handled.
        sys.stdout.flush()
    # The reader of the output, such as `head`, has closed it: that is no error.
    except BrokenPipeError:
        _discard_output()
        return ExitCode.DONE
    # An error of the system that no code expected, such as a full disk.
    except OSError as problem:
        _discard_output()
        say_error(_system_problem(problem))
        return ExitCode.BAD_INPUT
    except SimrobError as problem:
        say_error(problem.message)
        return ExitCode.BAD_INPUT
    except TyperException as problem:
        text = usage_problem(problem)
        # The text is empty if typer has shown a help instead.
        if text:
            say_error(text)
        return ExitCode.BAD_INPUT
    except Interrupted as interrupt:
        say_error(message_of(interrupt))
        return ExitCode.INTERRUPTED
    # Many commands return None, and `typer.Exit` gives 0.
    return code if isinstance(code, int) else ExitCode.DONE


def _system_problem(problem: OSError) -> str:
    """Describe an error of the operating system: the file, if there is one, and the system's text."""
    reason = problem.strerror or str(problem)
    if not problem.filename:
        return reason
    return f"{shorten(str(problem.filename), _LONGEST_PATH)}: {reason}"


@contextmanager
def _own_warnings() -> Iterator[None]:
    """Context manager that shows each warning of this package in one line. Others are shown as usual in Python."""
    # On leaving, `catch_warnings` sets `warnings.showwarning` back.
    with warnings.catch_warnings():
        python_show = warnings.showwarning

        def show(message: Warning | str, category: type[Warning], *place: Any, **more: Any) -> None:
            """Show a warning; the parameters are those of ``warnings.showwarning``."""
            # The class of a warning decides whether it is one of this package, wherever it is raised.
            if category.__module__.startswith(f"{simrob_drake.__name__}."):
                label = getattr(category, "label", "warning")
                say_warning(str(message), label)
            else:
                python_show(message, category, *place, **more)

        warnings.showwarning = show
        yield


def _check_surroundings(arguments: list[str]) -> None:
    """Check the conditions that all commands need.

    Args:
        arguments: arguments of ``simrob``.

    Raises:
        InvalidParameter: an argument is no text in UTF-8, or the working folder does not exist any more.
    """
    for argument in arguments:
        # Python decodes each byte that is no UTF-8 as a surrogate (PEP 383), which cannot be written again as text.
        has_surrogate = any("\ud800" <= letter <= "\udfff" for letter in argument)
        if has_surrogate:
            raise InvalidParameter(
                "argument",
                ascii(argument),
                message("cli.text_in_utf8", "text in UTF-8, including the names of files"),
            )
    try:
        os.getcwd()
    except OSError as problem:
        raise InvalidParameter(
            message("cli.working_folder", "working folder"),
            "gone",
            message("cli.existing_folder", "an existing folder; change to another one"),
        ) from problem


def _discard_output() -> None:
    """Send all further output to nowhere, after the output stream has failed.

    Otherwise Python would write the rest of the buffer when it ends, and show the same error again.
    """
    sys.stdout = Path(os.devnull).open("w", encoding="utf-8")  # noqa: SIM115


@app.callback(invoke_without_command=True)
def version(
    show: Annotated[bool, typer.Option("--version", help=_HELP_OF_VERSION, is_eager=True)] = False,
) -> None:
    """Show the version if the option ``--version`` is given. Typer calls this function before each command."""
    if show:
        console.print(simrob_drake.__version__)
        raise typer.Exit
