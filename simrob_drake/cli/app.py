"""The application to which all commands belong: how it is run, and how it reports errors.

A command is imported when it is called; see :mod:`simrob_drake.cli.command_table`.
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
from simrob_drake.base.errors import InvalidParameter, SimrobError, UnknownName, shortened
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
    shown_parameters,
    translate_frames,
    with_translated_options,
    write_usage,
)
from simrob_drake.cli.language import requested_language
from simrob_drake.cli.screen import Interrupted, console, say_warning, tell
from simrob_drake.cli.usage_errors import command_name, unexpected_arguments, usage_problem


def _typer(**more: Any) -> typer.Typer:
    # markdown: what stands in brackets is a unit, and no markup
    return typer.Typer(rich_markup_mode="markdown", pretty_exceptions_enable=False, **more)


class _Command(TyperCommand):
    """A command whose help shows the types of values alone, in the language of the output."""

    def get_params(self, ctx: Any) -> list[Any]:
        return shown_parameters(super().get_params(ctx))

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
        ctx.allow_extra_args = True  # otherwise typer refuses them with a text of its own
        try:
            rest = super().parse_args(ctx, args)
        except TyperException as problem:
            if getattr(problem, "ctx", None) is None:
                # Errors of the parser name no command, and their message needs its options.
                vars(problem)["ctx"] = ctx
            raise
        if rest and not ctx.resilient_parsing:
            raise SimrobError(unexpected_arguments(command_name(ctx), rest))
        return rest


class _Group(TyperGroup):
    """Commands below one name, whose help shows the types of values alone, in the language of the output."""

    def get_params(self, ctx: Any) -> list[Any]:
        return shown_parameters(super().get_params(ctx))

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
            if args[0].startswith("-"):
                raise
            raise UnknownName(message("cli.command", "command"), args[0], self.list_commands(ctx)) from None


class _Commands(_Group):
    """All commands, which typer knows by name and help alone until one is called."""

    def __init__(self, **options: Any) -> None:
        """Begin with the commands of the core. Those of extensions are added when they are asked for."""
        named = {name: _named_command(name, entry) for name, entry in core_commands().items()}
        super().__init__(**{**options, "commands": named})

    def get_params(self, ctx: Any) -> list[Any]:
        parameters = super().get_params(ctx)
        for parameter in parameters:
            if parameter.name == "show":
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

        The commands of extensions are added only for a name that is not known yet: to find them takes time.
        """
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
                    "{problem}. Extensions that are left out: {names}; simrob extensions says why.",
                    problem=problem,
                    names=", ".join(left_out),
                )
            ) from None
        # The command that was found has a name and a help alone, see `_named_command`.
        return name, command and whole_command(str(name)), rest

    def invoke(self, ctx: Any) -> Any:
        """Run the command that is called. Typer alone would leave without a message on an interrupt by the user."""
        try:
            return super().invoke(ctx)
        except KeyboardInterrupt:
            raise Interrupted(message("cli.interrupted", "interrupted")) from None

    def _add_extensions(self) -> None:
        """Add the commands of installed extensions, with name and help alone, see `_named_command`."""
        for name, entry in all_commands().items():
            if name not in self.commands:
                self.commands[name] = _named_command(name, entry)


def _named_command(name: str, entry: CommandEntry) -> TyperCommand:
    """Make a command for the list of commands: with name, help and title, without function and options."""
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
    application = _typer(add_completion=False)  # of this command alone
    function = command_function(entry)
    help_text = _help_of(name, function, entry.package)
    below = subcommand_functions(name)
    if below:
        # Here the function of the command does not run alone: typer calls it before that of the command below. Its
        # docstring is the help that is shown if no command below is given.
        callback = application.callback(cls=_Group, no_args_is_help=True, help=help_text)
        callback(with_translated_options(function))
        for subcommand, own_function in below.items():
            own_help = _help_of(f"{name} {subcommand}", own_function, entry.package)
            application.command(subcommand, cls=_Command, help=own_help)(with_translated_options(own_function))
    else:
        application.command(name, cls=_Command, help=help_text)(with_translated_options(function))
    return typer.main.get_command(application)


def _help_of(name: str, function: Callable[..., Any], package: str) -> str:
    """Help of a command in the language of the output, see :func:`command_message`."""
    return translate(command_message(name, inspect.getdoc(function) or "", package))


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

    Nothing is raised: a problem occurs again, and is reported, when the command is run.

    Args:
        arguments: arguments of ``simrob``, the name of the command first.
    """
    entry = find_command(arguments[0]) if arguments else None
    if entry is not None:
        with suppress(Exception, SystemExit):  # a module of another package may raise anything
            import_module(entry.module)


def run_command(arguments: list[str]) -> int:
    """Run a command and return its exit code; errors of the user go to the error stream in one line."""
    set_output_language(requested_language(arguments))
    try:
        _check_surroundings(arguments)
        with _own_warnings():
            code = app(arguments, prog_name="simrob", standalone_mode=False)
        sys.stdout.flush()
    except BrokenPipeError:  # who read the output, such as `head`, has enough of it
        _write_no_more()
        return ExitCode.DONE
    except OSError as problem:  # a full disk, a folder that is gone: what is expected is told where it happens
        _write_no_more()
        why = problem.strerror or str(problem)
        tell(f"{shortened(str(problem.filename), 1000)}: {why}" if problem.filename else why)
        return ExitCode.BAD_INPUT
    except SimrobError as problem:
        tell(problem.message)
        return ExitCode.BAD_INPUT
    except TyperException as problem:
        text = usage_problem(problem)
        if text:
            tell(text)
        return ExitCode.BAD_INPUT
    except Interrupted as interrupt:
        tell(message_of(interrupt))
        return ExitCode.INTERRUPTED
    return code if isinstance(code, int) else ExitCode.DONE


@contextmanager
def _own_warnings() -> Iterator[None]:
    """Tell the package's own warnings in one line each, while the work goes on; others as Python does."""
    with warnings.catch_warnings():
        otherwise = warnings.showwarning

        def show(message: Warning | str, category: type[Warning], *place: Any, **more: Any) -> None:
            if category.__module__.startswith(f"{simrob_drake.__name__}."):
                label = getattr(category, "label", "warning")
                say_warning(str(message), label)
            else:
                otherwise(message, category, *place, **more)

        warnings.showwarning = show
        yield


def _check_surroundings(arguments: list[str]) -> None:
    """Check what each command needs, or raise InvalidParameter: arguments that are text, and a working folder."""
    for argument in arguments:
        if not argument.isascii() and any("\ud800" <= letter <= "\udfff" for letter in argument):
            raise InvalidParameter(
                "argument", ascii(argument), message("cli.text_in_utf8", "text in UTF-8, names of files, too")
            )
    try:
        os.getcwd()
    except OSError as problem:
        raise InvalidParameter(
            message("cli.working_folder", "working folder"),
            "gone",
            message("cli.existing_folder", "one that is there; change to another"),
        ) from problem


def _write_no_more() -> None:
    """Write nothing more to an output that does not take it, as Python does with what is left at its end."""
    sys.stdout = Path(os.devnull).open("w", encoding="utf-8")  # noqa: SIM115


@app.callback(invoke_without_command=True)
def version(
    show: Annotated[bool, typer.Option("--version", help=_HELP_OF_VERSION, is_eager=True)] = False,
) -> None:
    """Say which version this is."""
    if show:
        console.print(simrob_drake.__version__)
        raise typer.Exit
