"""The page as an application: routes to handlers, events, and the server that carries it."""

from __future__ import annotations

import asyncio
import contextlib
import functools
import json
import socket
from collections.abc import AsyncIterator, Callable
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from nearlift.errors import NearliftError, UsageError
from nearlift.serve import answers, pages
from nearlift.serve.bench import ServedWorkspace
from nearlift.serve.gate import Gate

if TYPE_CHECKING:
    from pathlib import Path

    from starlette.requests import Request
    from starlette.responses import Response
    from starlette.types import ASGIApp

    from nearlift.serve.live import Live

#: Bytes of a form; seconds between looks at what is to be told, and between signs of life.
MOST_FORM, PERIOD_S, ALIVE_S = 2 << 20, 0.2, 15.0
#: Connections at a time; further ones are told to come again.
CLIENTS = 64


Events = AsyncIterator[tuple[str, object]]


def application(workspace: ServedWorkspace) -> ASGIApp:
    """Every route of the page."""
    from starlette.applications import Starlette
    from starlette.routing import Route

    site = Site(workspace)
    routes = [
        Route(path, functools.partial(site.handle, handler), methods=[method])
        for (method, path), handler in pages.PAGES.items()
    ]
    routes += [
        Route("/file/{path:path}", site.file),
        Route("/static/{name}", site.static),
        Route("/favicon.ico", site.icon),
        Route("/events/work", site.work),
        Route("/events/live", site.live),
        Route("/upload", site.upload, methods=["POST"]),
    ]
    return Starlette(routes=routes)


class Site:
    """Requests to what answers them."""

    def __init__(self, workspace: ServedWorkspace) -> None:
        self.workspace = workspace
        #: What is watched, and by how many pages.
        self.watched: dict[Path, tuple[Live, int]] = {}

    async def handle(self, handler: pages.Handler, request: Request) -> Response:
        """A page or a form."""
        text = str(request.url.query)
        if request.method == "POST":
            content = bytearray()
            async for part in request.stream():
                content += part
                if len(content) > MOST_FORM:
                    return _response(
                        answers.PageAnswer(body=b"too large\n", kind=answers.TEXT, status=413)
                    )
            text = content.decode("utf-8", "replace")
        return await self._answered(lambda: handler(self.workspace, answers.PageQuery.parsed(text)))

    async def file(self, request: Request) -> Response:
        """A product."""
        return await self._answered(pages.file, self.workspace, request.path_params["path"])

    async def static(self, request: Request) -> Response:
        """A style sheet or the script."""
        return await self._answered(pages.static, request.path_params["name"])

    async def icon(self, request: Request) -> Response:
        """None: a browser asks for one beside texts and pictures, and would log its absence."""
        return _response(answers.PageAnswer(status=204))

    async def work(self, request: Request) -> Response:
        """What a command says, while it says it."""
        try:
            command = self.workspace.work(request.query_params.get("key", ""))
        except NearliftError as refusal:
            return _response(pages.refused(self.workspace, refusal))

        async def events() -> Events:
            count = 0
            while True:
                ended = command.ended
                lines, count = command.since(count)
                if lines:
                    yield "lines", lines
                if ended is not None:
                    yield "ended", {"code": ended, "result": command.result}
                    return
                yield "", None

        return _stream(events())

    async def live(self, request: Request) -> Response:
        """Trials as they land, and looks as they end."""
        from starlette.concurrency import run_in_threadpool

        from nearlift.serve.live import Live, looks, watching

        try:
            place = await run_in_threadpool(
                self.workspace.campaign, request.query_params.get("campaign", "")
            )
        except NearliftError as refusal:
            return _response(pages.refused(self.workspace, refusal))

        async def events() -> Events:
            recording, pages_of = self.watched.get(place.root, (Live(place), 0))
            self.watched[place.root] = recording, pages_of + 1
            epoch = turn = -1
            said: dict[str, int] = {}
            refusal = None
            try:
                while True:
                    await run_in_threadpool(recording.look)
                    if (recording.epoch, recording.turn, recording.refusal) != (
                        epoch,
                        turn,
                        refusal,
                    ):
                        trials, epoch, turn = await run_in_threadpool(recording.since, epoch, turn)
                        refusal = trials["refusal"]
                        yield "trials", trials
                    work = watching(self.workspace, place)
                    if work is not None:
                        lines, said[work.key] = work.since(said.get(work.key, 0))
                        for look in looks(lines):
                            yield "look", look
                    yield "", None
            finally:
                recording, pages_of = self.watched[place.root]
                self.watched[place.root] = recording, pages_of - 1
                if pages_of == 1:
                    del self.watched[place.root]

        return _stream(events())

    async def upload(self, request: Request) -> Response:
        """A dropped record."""
        from nearlift.serve.draft import receive

        try:
            query = answers.PageQuery.parsed(str(request.url.query))
            await receive(self.workspace, query.one("name"), query.one("file"), request.stream())
        except NearliftError as refusal:
            refused = answers.as_json({"refusal": f"{refusal.what}; {refusal.remedy}"})
            return _response(replace(refused, status=409))
        return _response(answers.as_json({}))

    async def _answered(self, make: Callable[..., answers.PageAnswer], *given: Any) -> Response:
        from starlette.concurrency import run_in_threadpool

        try:
            return _response(await run_in_threadpool(make, *given))
        except NearliftError as refusal:
            return _response(await run_in_threadpool(pages.refused, self.workspace, refusal))


def _response(answer: answers.PageAnswer) -> Response:
    from starlette.responses import Response

    return Response(answer.body, answer.status, dict(answer.headers), answer.kind)


def _stream(events: Events) -> Response:
    from starlette.responses import StreamingResponse

    return StreamingResponse(_sent(events), media_type="text/event-stream")


async def _sent(events: Events) -> AsyncIterator[str]:
    """Events as text; one without a name only lets time pass, and a comment now and then shows
    that the line is alive.
    """
    quiet = 0.0
    async for name, content in events:
        if name:
            quiet = 0.0
            yield f"event: {name}\ndata: {json.dumps(content)}\n\n"
            continue
        await asyncio.sleep(PERIOD_S)
        quiet += PERIOD_S
        if quiet > ALIVE_S:
            quiet = 0.0
            yield ": \n\n"


def listening(port: int) -> socket.socket:
    """A socket of this machine alone.

    Raises
    ------
    UsageError
        The port is taken.
    """
    listener = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    try:
        listener.bind(("127.0.0.1", port))
    except OSError as fault:
        listener.close()
        raise UsageError(
            f"--port {port}", f"cannot be had: {fault.strerror}", "leave --port out: any free one"
        ) from None
    return listener


def serve(workspace: ServedWorkspace, port: int, say: Callable[[str], None]) -> None:
    """Until it is interrupted; `told` the link once it can be opened."""
    import uvicorn

    with listening(port) as listener:
        gate = Gate(application(workspace), listener.getsockname()[1])
        server = uvicorn.Server(
            uvicorn.Config(
                gate,
                lifespan="off",
                log_level="critical",
                access_log=False,
                server_header=False,
                http="h11",
                ws="none",
                loop="asyncio",
                limit_concurrency=CLIENTS,
                timeout_graceful_shutdown=1,
            )
        )
        listener.listen(CLIENTS)
        try:
            with contextlib.suppress(KeyboardInterrupt):
                say(gate.link)
                server.run(sockets=[listener])
        finally:
            workspace.close()
