"""The command that opens the teach pendant: teach."""

from pathlib import Path
from typing import Annotated, Any, Literal

import typer

from simrob_drake.base.extras import importing_extra
from simrob_drake.base.messages import message, set_output_language
from simrob_drake.cli.language import LANGUAGE_VARIABLE
from simrob_drake.cli.options import AllowCode, with_mesh_path
from simrob_drake.cli.screen import say


@with_mesh_path
def teach(
    subject: Annotated[
        str,
        typer.Argument(
            metavar="ROBOT|STATION|FILE",
            help=message(
                "pendant.help_teach_subject",
                "A name of `simrob list`, a station's YAML, or a URDF.",
            ),
        ),
    ] = "irb120_teach",
    port: Annotated[
        int | None,
        typer.Option(
            min=0,
            max=65535,
            help=message(
                "pendant.help_teach_port",
                "Port of the page; the first free one from 8100 by default.",
            ),
        ),
    ] = None,
    no_browser: Annotated[
        bool,
        typer.Option(
            "--no-browser",
            help=message("pendant.help_teach_no_browser", "Tell the address, and open no browser."),
        ),
    ] = False,
    folder: Annotated[
        Path,
        typer.Option(
            help=message(
                "pendant.help_teach_folder", "Folder for what is taught, and for downloads."
            )
        ),
    ] = Path("taught"),
    language: Annotated[
        Literal["en", "es"],
        typer.Option(
            envvar=LANGUAGE_VARIABLE,
            help=message("pendant.help_teach_language", "Language of the page."),
        ),
    ] = "en",
    allow_code: AllowCode = False,
    lessons: Annotated[
        Path | None,
        typer.Option(
            help=message(
                "pendant.help_teach_lessons", "A folder with lessons, beside those that there are."
            )
        ),
    ] = None,
    root_path: Annotated[
        str | None,
        typer.Option(
            help=message(
                "pendant.help_teach_root_path",
                "Where a proxy shows the page: a path, or the whole address. Opens no browser.",
            )
        ),
    ] = None,
) -> None:
    """Open a page in the browser to teach, push, tune and watch a robot; it needs the extra `gui`.

    For example:

        simrob teach
        simrob teach humanoid
    """
    set_output_language(language)
    with importing_extra(message("pendant.teach_pendant", "the teach pendant"), "gui"):
        import nicegui  # noqa: F401
    from simrob_drake.extensions.pendant.server import serve

    # It is shown with the first address only: a server that starts again has another one.
    more = [
        message(
            "pendant.kept_in", "what is taught is kept in {folder}; end with Ctrl+C", folder=folder
        ),
    ]

    def ready(url: str) -> None:
        say(message("pendant.taught_at", "{subject} is taught at {url}", subject=subject, url=url))
        while more:
            say(more.pop())

    browse = not (no_browser or root_path)
    how: dict[str, Any] = {
        "port": port,
        "language": language,
        "browse": browse,
        "allow_code": allow_code,
    }
    serve(subject, folder, ready=ready, root_path=root_path, lessons=lessons, **how)
    say(message("pendant.ended", "ended; what was taught is in {folder}", folder=folder))
