"""Start of the command line, and the report of errors that no command handles."""

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

DEBUG = "SIMROB_DEBUG"
"""Environment variable that shows the tracebacks of unexpected errors, if it is not empty."""


def main() -> None:
    """Run the command line, and end the process with its exit code."""
    # The matrices of a robot are small: more threads only wait for each other, and take a sixth of the CPU time.
    if not {"OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"} & os.environ.keys():
        os.environ["OPENBLAS_NUM_THREADS"] = "1"
    # A stream is None if the caller has closed it. All output then goes to nowhere.
    for stream in ("stdout", "stderr"):
        if getattr(sys, stream) is None:
            setattr(sys, stream, Path(os.devnull).open("w", encoding="utf-8"))  # noqa: SIM115
    # Characters that the encoding of the output lacks are written as escapes, as Python does on the error stream.
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="backslashreplace")
    # A caller that wants interrupts to be ignored, such as nohup, has set another handler.
    is_interruptible = signal.getsignal(signal.SIGINT) is signal.default_int_handler
    # While modules are imported, an interrupt could arrive as any error: this handler ends the process at once.
    if is_interruptible:
        signal.signal(signal.SIGINT, _leave)
    # Imported modules stay until the end, so the garbage collector would search them in vain, now and later.
    gc.disable()
    from simrob_drake.cli.app import load, run_command

    load(sys.argv[1:])
    gc.freeze()
    gc.enable()

    if is_interruptible:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    code = run_guarded(run_command, sys.argv[1:])
    if code == ExitCode.INTERRUPTED:
        # A user who presses Ctrl-C several times must not see a traceback of the end of the process.
        signal.signal(signal.SIGINT, signal.SIG_IGN)
    sys.exit(code)


def run_guarded(command: Callable[[list[str]], int], arguments: list[str]) -> int:
    """Run a command. An unexpected error is written to the error stream in one line.

    Returns:
        exit code of the command; BAD_INPUT (2) after an unexpected error.

    Raises:
        SystemExit: the command itself ends the program.
    """
    try:
        return command(arguments)
    except (Exception, SystemExit) as problem:
        # A failed assertion of Drake arrives as a SystemExit with a text. Any other SystemExit is an exit code.
        if isinstance(problem, SystemExit) and not isinstance(problem.code, str):
            raise
        from simrob_drake.cli.screen import say_error

        if os.environ.get(DEBUG):
            traceback.print_exception(problem)
        if isinstance(problem, ModuleNotFoundError) and problem.name:
            say_error(_missing_package(problem.name, arguments))
        else:
            say_error(_unexpected_error(problem))
        return ExitCode.BAD_INPUT


def _unexpected_error(problem: BaseException) -> str:
    """Message about an error that no command handles: its class, its text, and the line of this package."""
    name: str = type(problem).__name__
    if isinstance(problem, SystemExit):
        name = message("cli.check_of_drake", "a check of Drake")
    text: str = " ".join(str(problem).split())[:1000]
    frames = traceback.extract_tb(problem.__traceback__)
    package = Path(__file__).parents[1]
    own_frames = [frame for frame in frames if package in Path(frame.filename).parents]
    where = message("cli.outside", "outside simrob_drake")
    if own_frames:
        # The innermost frame of this package, below which is only code of libraries.
        innermost = own_frames[-1]
        file = Path(innermost.filename).relative_to(package.parent)
        where = message(
            "cli.file_and_line", "{file}, line {line}", file=file, line=innermost.lineno
        )
    return message(
        "cli.unexpected",
        "unexpected error: {name}: {text} ({where}); {variable}=1 shows the traceback",
        name=name,
        text=text or message("cli.without_message", "without a message"),
        where=where,
        variable=DEBUG,
    )


def _missing_package(module: str, arguments: list[str]) -> str:
    """Write the message for a module that cannot be imported: what the command needs, and how to install it.

    A module of this package is missing only in a damaged installation. Of any other module, the name of the top package
    is taken as its name for pip, although a few packages have another one there, such as PyYAML for the module yaml.
    """
    command = f"simrob {arguments[0]}" if arguments else "simrob"
    package = module.partition(".")[0]
    if package == "simrob_drake":
        return message(
            "cli.needs_module",
            "{command} needs the module {module}, which is missing from this installation: "
            "reinstall simrob-drake",
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
    """Handle an interrupt while modules are imported: end the process without any further code."""
    print("simrob: interrupted", file=sys.stderr, flush=True)
    os._exit(ExitCode.INTERRUPTED)


if __name__ == "__main__":
    main()
