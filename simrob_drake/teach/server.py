"""The server of the pendant: one port of this computer, behind the guard."""

from typing import Any

import uvicorn
from fastapi import FastAPI
from nicegui import ui

from simrob_drake.teach.guard import PARAMETER, Guard
from simrob_drake.teach.pages import shell
from simrob_drake.teach.pages.words import words

_HOST = "127.0.0.1"


def serve(session: Any, *, port: int = 8080, language: str = "en") -> None:
    """Show a session's page until the user interrupts."""
    t = words(language)
    ui.page("/", title=t("shell.title"))(lambda: shell.build(session, t))
    app = FastAPI(docs_url=None, redoc_url=None, openapi_url=None)
    ui.run_with(app, show_welcome_message=False)
    guard = Guard(app, port)
    print(f"http://{_HOST}:{port}/?{PARAMETER}={guard.token}", flush=True)
    uvicorn.run(guard, host=_HOST, port=port, log_config=None, ws="wsproto")


if __name__ in {"__main__", "__mp_main__"}:
    serve(None)
