"""How the command line is started, and what becomes of what it does not handle itself."""

import gc
import io
import os
import signal
import sys
import traceback
from collections.abc import Callable
from pathlib import Path

from simrob_drake.base.messages import message
from simrob_drake.cli import ExitCode

DEBUG = "SIMROB_DEBUG"  # the environment variable that shows tracebacks


def main() -> None:
    """Run the command line and leave with its exit code."""
    # the matrices of a robot are small: more threads only wait for each other, and take a sixth of the CPU time
    if not {"OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"} & os.environ.keys():
        os.environ["OPENBLAS_NUM_THREADS"] = "1"
    for stream in ("stdout", "stderr"):  # None where the caller has closed them
        setattr(sys, stream, getattr(sys, stream) or Path(os.devnull).open("w", encoding="utf-8"))  # noqa: SIM115
    if isinstance(
        sys.stdout, io.TextIOWrapper
    ):  # what its encoding lacks is escaped, as it is on stderr
        sys.stdout.reconfigure(errors="backslashreplace")
    # else the caller wants it ignored
    interruptible = signal.getsignal(signal.SIGINT) is signal.default_int_handler
    if interruptible:
        signal.signal(signal.SIGINT, _leave)
    gc.disable()  # what is loaded stays: there is no rubbish to look for in it, now or later
    from simrob_drake.cli.app import load, run_command

    load(sys.argv[1:])  # Drake, inside of which an interrupt may come as any error
    gc.freeze()
    gc.enable()

    if interruptible:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    code = run_guarded(run_command, sys.argv[1:])
    if code == ExitCode.INTERRUPTED:
        # who presses it twice waits no longer than for the end
        signal.signal(signal.SIGINT, signal.SIG_IGN)
    sys.exit(code)


def run_guarded(command: Callable[[list[str]], int], arguments: list[str]) -> int:
    """Run a command. An unexpected error is written to the error stream in one line.

    Returns:
        exit code of the command.

    Raises:
        SystemExit: the command itself ends the program.
    """
    try:
        return command(arguments)
    except (
        Exception,
        SystemExit,
    ) as problem:  # Drake's failed assertions come as SystemExit, with a text
        if isinstance(problem, SystemExit) and not isinstance(problem.code, str):
            raise
        from simrob_drake.cli.screen import say_error

        if os.environ.get(DEBUG):
            traceback.print_exception(problem)
        if isinstance(problem, ModuleNotFoundError) and problem.name:
            say_error(_missing_package(problem.name, arguments))
            return ExitCode.BAD_INPUT
        frames = traceback.extract_tb(problem.__traceback__)
        package = Path(__file__).parents[1]
        own = [frame for frame in frames if package in Path(frame.filename).parents]
        where = message("cli.outside", "outside of simrob_drake")
        if own:
            file = Path(own[-1].filename).relative_to(package.parent)
            where = message(
                "cli.file_and_line", "{file}, line {line}", file=file, line=own[-1].lineno
            )
        name = message("cli.check_of_drake", "a check of Drake")
        text = " ".join(str(problem).split())[:1000]
        say_error(
            message(
                "cli.unexpected",
                "unexpected: {name}: {text} ({where}); {variable}=1 shows the traceback",
                name=name if isinstance(problem, SystemExit) else type(problem).__name__,
                text=text or message("cli.without_message", "without a message"),
                where=where,
                variable=DEBUG,
            )
        )
        return ExitCode.BAD_INPUT


def _missing_package(module: str, arguments: list[str]) -> str:
    """Write the message for a module that cannot be imported: what the command needs, and how to install it.

    A module of this package can only lack in a damaged installation.
    """
    command = f"simrob {arguments[0]}" if arguments else "simrob"
    package = module.partition(".")[0]
    if package == "simrob_drake":
        return message(
            "cli.needs_module",
            "{command} needs the module {module}, which this installation lacks: install simrob-drake again",
            command=command,
            module=module,
        )
    return message(
        "cli.needs_package",
        "{command} needs the package {package}, which is not installed: pip install {package}",
        command=command,
        package=package,
    )


def _leave(*_: object) -> None:
    print("simrob: interrupted", file=sys.stderr, flush=True)
    os._exit(ExitCode.INTERRUPTED)


if __name__ == "__main__":
    main()
