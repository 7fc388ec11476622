"""The process in which a station runs for the pendant: it answers, one after the other, until its parent is gone."""

from __future__ import annotations

import signal
from multiprocessing.connection import Connection
from typing import Any

from simrob_drake.errors import SimrobError
from simrob_drake.teach.bench import Bench
from simrob_drake.teach.conductor import Rewound
from simrob_drake.teach.messages import Inbox, may_be_any_time

Message = tuple[int, str, dict[str, Any]]


def main(pipe: Connection) -> None:
    """Serve a pipe until the other end is closed."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent ends this process
    inbox = Inbox(pipe)
    bench = Bench(inbox, lambda bench: serve(bench, inbox))
    try:
        while True:
            while not (messages := inbox.take()):
                inbox.wait(None)
            for other in messages[1:]:  # a run that the first one begins takes them
                inbox.put_back(other)
            answer(bench, inbox, messages[0])
    except (EOFError, BrokenPipeError, ConnectionResetError):
        return


def serve(bench: Bench, inbox: Inbox) -> None:
    """Do what can be done while a station runs; what cannot ends the run, and is done then."""
    messages = inbox.take()
    for place, message in enumerate(messages):
        if bench.conductor.stopping or not may_be_any_time(getattr(bench, message[1])):
            bench.conductor.stopping = True
            inbox.put_back(message)
            continue
        try:
            answer(bench, inbox, message)
        except Rewound:
            for other in messages[place + 1 :]:
                inbox.put_back(other)
            raise


def answer(bench: Bench, inbox: Inbox, message: Message) -> None:
    """Do what was asked for, and answer with its result or with what is wrong."""
    number, method, arguments = message
    try:
        result = getattr(bench, method)(**arguments)
    except SimrobError as problem:
        inbox.answer(number, wrong=str(problem))
    except Rewound:
        inbox.answer(number)
        raise
    except Exception as problem:
        inbox.answer(number, wrong=f"{type(problem).__name__}: {problem}")
    else:
        inbox.answer(number, result)
