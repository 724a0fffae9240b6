"""The HTTP side of the page: a few fixed answers, one stream of events, and buttons only where they are allowed."""

import json
import time
from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from importlib.resources import files
from pathlib import Path

from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.middleware import Middleware
from starlette.requests import Request
from starlette.responses import JSONResponse, PlainTextResponse, Response
from starlette.routing import Route
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from runtime.commands import LONGEST_BYTES, Command
from runtime.errors import InfantError
from runtime.page.hub import Hub
from runtime.page.run_list import RunList
from runtime.page.viewers import Client, Viewers
from runtime.publish.commands import Answer
from runtime.publish.pace import Allowance

REQUESTS_HZ, COMMANDS_HZ = 30.0, 2.0  # of one address
MOST_ADDRESSES = 1000
HEADERS = {
    "content-security-policy": "default-src 'none'; script-src 'self'; style-src 'self'; connect-src 'self'; "
    "img-src 'self' data:; base-uri 'none'; form-action 'none'; frame-ancestors 'none'",
    "x-content-type-options": "nosniff",
    "referrer-policy": "no-referrer",
    "cross-origin-resource-policy": "same-origin",
    "cache-control": "no-store",
}
ASSETS = {
    "/": ("index.html", "text/html"),
    "/page.js": ("page.js", "text/javascript"),
    "/page.css": ("page.css", "text/css"),
}
ASKED_BY_PAGE = "x-infant"  # a page of another origin cannot send this header without being asked for leave

Commander = Callable[[Command, str], Answer]


@dataclass(frozen=True, slots=True)
class PageOptions:
    """What a page serves. hosts: names under which it may be asked; command: None where there are no buttons;
    end: closes the connection of a client."""

    hosts: frozenset[str]
    runs: Path
    command: Commander | None = None
    end: Callable[[Client], None] = lambda _client: None


def page_app(hub: Hub, options: PageOptions) -> Starlette:
    """The application; it holds no state of its viewers but how many there are."""
    viewers = Viewers(hub.messages, options.end)
    routes = [Route(path, partial(_asset, path), methods=["GET"]) for path in ASSETS]
    routes += [
        Route("/events", viewers.stream, methods=["GET"]),
        Route("/runs", partial(_runs, RunList(options.runs)), methods=["GET"]),
        Route("/allowed", partial(_allowed, options), methods=["GET"]),
    ]
    if options.command is not None:
        routes.append(Route("/command", partial(_command, options.command), methods=["POST"]))
    return Starlette(routes=routes, middleware=[Middleware(Guard, hosts=options.hosts)])


class Guard:
    """Refuses other names of the host (DNS rebinding) and too many questions; adds the headers of security."""

    def __init__(self, app: ASGIApp, hosts: frozenset[str]) -> None:
        self._app, self._hosts = app, hosts
        self._allowances: OrderedDict[tuple[str, bool], Allowance] = OrderedDict()

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """One request."""
        if scope["type"] != "http":
            return
        request = Request(scope)
        host = request.headers.get("host", "").rpartition(":")[0] or request.headers.get("host", "")
        refusal: Response | None = None
        if host not in self._hosts:
            refusal = PlainTextResponse("this page is not served under that name\n", 421)
        elif not self._allowance(request).take(time.monotonic_ns()):
            refusal = PlainTextResponse("too many requests; try again in a second\n", 429)

        async def with_headers(message: Message) -> None:
            if message["type"] == "http.response.start":
                message["headers"] += [(name.encode(), value.encode()) for name, value in HEADERS.items()]
            await send(message)

        await (refusal or self._app)(scope, receive, with_headers)

    def _allowance(self, request: Request) -> Allowance:
        key = (request.client.host if request.client else "", request.method == "POST")
        allowance = self._allowances.pop(key, None) or Allowance(COMMANDS_HZ if key[1] else REQUESTS_HZ)
        self._allowances[key] = allowance
        if len(self._allowances) > MOST_ADDRESSES:
            self._allowances.popitem(last=False)
        return allowance


async def _asset(path: str, _request: Request) -> Response:
    name, media_type = ASSETS[path]
    return Response(files("runtime.page").joinpath("assets", name).read_bytes(), media_type=media_type)


async def _runs(runs: RunList, _request: Request) -> Response:
    return JSONResponse(await run_in_threadpool(runs.told))


async def _allowed(options: PageOptions, _request: Request) -> Response:
    return JSONResponse({"commands": options.command is not None})


async def _command(send: Commander, request: Request) -> Response:
    """Mark or stop, as the rover's own access rules allow."""
    if request.headers.get(ASKED_BY_PAGE) != "1":
        return PlainTextResponse("only the page itself may send commands\n", 403)
    body = b""
    async for part in request.stream():
        body += part
        if len(body) > 2 * LONGEST_BYTES:
            return PlainTextResponse("a reason has at most 1000 characters\n", 413)
    try:
        asked = json.loads(body)
        command, reason = Command(asked["command"]), str(asked["reason"])
    except (ValueError, KeyError, TypeError, RecursionError):
        return PlainTextResponse("expected a command and a reason\n", 400)
    if command not in (Command.MARK, Command.STOP):
        return PlainTextResponse("only mark and stop can be sent from here\n", 403)
    try:
        answer = await run_in_threadpool(send, command, reason)
    except InfantError as error:
        return JSONResponse({"accepted": False, "reason": str(error)}, 502)
    return JSONResponse({"accepted": answer.accepted, "reason": answer.reason})
