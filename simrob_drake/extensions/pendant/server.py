"""The server of the pendant: one port of this computer, behind the guard, for the pages and the view in them."""

import asyncio
import os
import socket
import tempfile
import webbrowser
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from contextvars import copy_context
from html import escape
from pathlib import Path

import uvicorn
from fastapi import FastAPI, Request, Response
from fastapi.responses import FileResponse, StreamingResponse
from nicegui import ui

from simrob_drake.base.errors import OutputError
from simrob_drake.base.folders import writing
from simrob_drake.base.messages import message
from simrob_drake.extensions.pendant.guard import LEADS_TO, Guard
from simrob_drake.extensions.pendant.pages import gallery, shell
from simrob_drake.extensions.pendant.pendant import Pendant
from simrob_drake.extensions.pendant.session import Session
from simrob_drake.results.animation.window import Board, is_short, number_of

PORT = 8100  # where the pendant listens unless something else does
_HOST = "127.0.0.1"
_PORTS = 100
_GRACE = 2  # s for what is under way when the server ends


def serve(
    subject: str | Path,
    folder: Path,
    *,
    port: int | None = None,
    language: str = "en",
    ready: Callable[[str], None] = print,
    browse: bool = False,
    allow_code: bool = False,
    root_path: str | None = None,
    lessons: Path | None = None,
) -> None:
    """Show a robot, a station or a file until the user interrupts.

    Args:
        subject: what is taught first.
        folder: for programs and what is taken away.
        port: to listen at; the first free one from :data:`PORT` unless given.
        language: of the pages.
        ready: is called with an address when the page can be opened, and with another one whenever one was used: each
            opens one browser, once.
        browse: whether the user's browser is opened.
        allow_code: whether stations may name Python code that is run.
        root_path: where a proxy shows the page; see :class:`~simrob_drake.extensions.pendant.guard.Guard`.
        lessons: a folder with more lessons.

    Raises:
        SimrobError: no such subject or language, or root path.
        OutputError: the port is taken.
    """
    listening = bound(port)

    async def run() -> None:
        hand_over = asyncio.get_running_loop().call_soon_threadsafe

        def opened(what: str | Path, robot: str | None) -> Session:
            return Session.open(
                what, folder, robot=robot, hand_over=hand_over, allow_code=allow_code
            )

        pendant = Pendant(opened, subject, language=language, lessons=lessons)
        try:
            server = Server(pendant, listening.getsockname()[1], root_path)
            await server.run_until_stopped(listening, ready, folder if browse else None)
        finally:
            pendant.close()

    with listening, suppress(KeyboardInterrupt):
        asyncio.run(run())


def _picture_of(robot: str) -> Response:
    """Answer with the picture of a robot, or 404 if there is none."""
    picture = gallery.picture_file(robot)
    return Response(status_code=404) if picture is None else FileResponse(picture)


class Server(uvicorn.Server):
    """Serves a pendant behind a guard.

    Attributes:
        guard: gives the addresses that the page is opened by.
    """

    def __init__(self, pendant: Pendant, port: int, root_path: str | None = None) -> None:
        """Prepare what listens at a port, perhaps behind a proxy."""
        app = FastAPI(docs_url=None, redoc_url=None, openapi_url=None)
        app.get(f"/{gallery.PICTURES}/{{robot}}")(_picture_of)
        _serve_view(app, pendant.board)
        shell.install(pendant)
        ui.run_with(app, title="simrob teach", show_welcome_message=False, reconnect_timeout=20.0)
        self.guard = Guard(app, port, root_path)
        self._board = pendant.board
        super().__init__(
            uvicorn.Config(
                self.guard,
                ws="wsproto",
                log_config=None,
                access_log=False,
                proxy_headers=False,
                server_header=False,
                timeout_graceful_shutdown=_GRACE,
            )
        )

    async def run_until_stopped(
        self, listening: socket.socket, ready: Callable[[str], None], folder: Path | None = None
    ) -> None:
        """Serve until the user interrupts, and tell addresses once the page can be opened.

        Args:
            listening: where.
            ready: see :func:`serve`.
            folder: for the file that opens the user's browser; None opens none.
        """
        with ExitStack() as opening:
            file = None
            if folder is not None:
                file = opening.enter_context(leading_to(self.guard.address(opening.close), folder))
            announcing = asyncio.create_task(self._tell(ready, file))
            await self.serve(sockets=[listening])
            announcing.cancel()

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        """End what pages wait for, and the server."""
        self._board.close()
        await super().shutdown(sockets)

    async def _tell(self, ready: Callable[[str], None], file: str | None) -> None:
        while not self.started:
            await asyncio.sleep(0.02)
        loop = asyncio.get_running_loop()
        # The language of the output belongs to the context, which a thread of an executor does not inherit.
        own_context = copy_context()

        def tell() -> None:
            loop.run_in_executor(None, own_context.copy().run, ready, self.guard.address(tell))

        tell()
        if file is not None:
            await asyncio.to_thread(webbrowser.open, file)


def _serve_view(app: FastAPI, board: Board) -> None:
    """Serve a board under ``/view/``."""

    @app.get("/view/")
    def page() -> Response:
        return Response(board.page, media_type="text/html", headers={"Cache-Control": "no-store"})

    @app.get("/view/events")
    def events(after: str = "") -> StreamingResponse:
        news = board.events(number_of(after))
        return StreamingResponse(
            news, media_type="text/event-stream", headers={"Cache-Control": "no-store"}
        )

    @app.post("/view/told", status_code=204)
    async def receive(request: Request) -> None:
        if is_short(request.headers.get("content-length", "")):
            board.hear(await request.body())


def bound(port: int | None) -> socket.socket:
    """Return a socket bound to a port of this computer alone; raises OutputError: the one asked for is taken."""
    for one in [port] if port is not None else [*range(PORT, PORT + _PORTS), 0]:
        listening = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
        # one that was just left is free
        listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            listening.bind((_HOST, one))
            listening.listen()  # another one could be bound there until then
        except OSError:
            listening.close()
            continue
        return listening
    raise OutputError(
        message(
            "pendant.port_is_taken",
            "port {port} is taken; choose another one with --port, or leave that out",
            port=port,
        )
    )


@contextmanager
def leading_to(address: str, folder: Path) -> Iterator[str]:
    """Give the address of a file that leads to another address, and that nobody else can read; in the end it is gone.

    Raises OutputError: the folder cannot be written.
    """
    with writing(folder):
        handle, name = tempfile.mkstemp(prefix="open-", suffix=".html", dir=folder)  # 0600
        with os.fdopen(handle, "w", encoding="utf-8") as file:
            file.write(LEADS_TO.format(escape(address)))
    try:
        yield Path(name).resolve().as_uri()
    finally:
        Path(name).unlink(missing_ok=True)
