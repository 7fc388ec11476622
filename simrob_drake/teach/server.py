"""The server of the pendant: one port of this computer, behind the guard, for the pages and the view in them."""

import asyncio
import socket
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import uvicorn
from fastapi import FastAPI, Request, Response
from fastapi.responses import StreamingResponse
from nicegui import ui

from simrob_drake.errors import OutputError
from simrob_drake.results.animation.window import Board, is_short
from simrob_drake.teach.guard import PARAMETER, Guard
from simrob_drake.teach.pages import shell
from simrob_drake.teach.pendant import Pendant
from simrob_drake.teach.session import Session

PORT = 8100
"""Where the pendant listens unless something else does."""
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
) -> None:
    """Show a robot, a station or a file until the user interrupts.

    Args:
        subject: what is taught first.
        folder: for programs and what is taken away.
        port: to listen at; the first free one from :data:`PORT` unless given.
        language: of the pages.
        ready: is called with the address when the page can be opened.

    Raises:
        SimrobError: no such subject or language.
        OutputError: the port is taken.
    """
    listening = bound(port)

    async def run() -> None:
        hand_over = asyncio.get_running_loop().call_soon_threadsafe

        def opened(what: str | Path, robot: str | None) -> Session:
            return Session.open(what, folder, robot=robot, hand_over=hand_over)

        pendant = Pendant(opened, subject, language=language)
        try:
            server = Server(pendant, listening.getsockname()[1])
            await server.run_until_stopped(listening, ready)
        finally:
            pendant.close()

    with listening, suppress(KeyboardInterrupt):
        asyncio.run(run())


class Server(uvicorn.Server):
    """Serves a pendant behind a guard.

    Attributes:
        url: where the page is, with the token.
    """

    def __init__(self, pendant: Pendant, port: int) -> None:
        """Prepare what listens at a port."""
        app = FastAPI(docs_url=None, redoc_url=None, openapi_url=None)
        _serve_view(app, pendant.board)
        shell.install(pendant)
        ui.run_with(app, title="simrob teach", show_welcome_message=False, reconnect_timeout=20.0)
        guard = Guard(app, port)
        self._board = pendant.board
        self.url = f"http://{_HOST}:{port}/?{PARAMETER}={guard.token}"
        super().__init__(
            uvicorn.Config(
                guard,
                ws="wsproto",
                log_config=None,
                access_log=False,
                proxy_headers=False,
                server_header=False,
                timeout_graceful_shutdown=_GRACE,
            )
        )

    async def run_until_stopped(self, listening: socket.socket, ready: Callable[[str], None]) -> None:
        """Serve until the user interrupts, and tell the address once the page can be opened."""
        telling = asyncio.create_task(self._tell(ready))
        await self.serve(sockets=[listening])
        telling.cancel()

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        """End what pages wait for, and the server."""
        self._board.close()
        await super().shutdown(sockets)

    async def _tell(self, ready: Callable[[str], None]) -> None:
        while not self.started:
            await asyncio.sleep(0.02)
        await asyncio.to_thread(ready, self.url)


def _serve_view(app: FastAPI, board: Board) -> None:
    """Serve a board under ``/view/``."""

    @app.get("/view/")
    def page() -> Response:
        return Response(board.page, media_type="text/html", headers={"Cache-Control": "no-store"})

    @app.get("/view/events")
    def events() -> StreamingResponse:
        return StreamingResponse(board.events(), media_type="text/event-stream", headers={"Cache-Control": "no-store"})

    @app.post("/view/told", status_code=204)
    async def told(request: Request) -> None:
        if is_short(request.headers.get("content-length", "")):
            board.hear(await request.body())


def bound(port: int | None) -> socket.socket:
    """Return a socket that is bound to a port of this computer alone.

    Raises:
        OutputError: the one asked for is taken.
    """
    for one in [port] if port is not None else [*range(PORT, PORT + _PORTS), 0]:
        listening = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
        listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)  # one that was just left is free
        try:
            listening.bind((_HOST, one))
            listening.listen()  # another one could be bound there until then
        except OSError:
            listening.close()
            continue
        return listening
    raise OutputError(f"port {port} is taken; choose another one with --port, or leave that out")
