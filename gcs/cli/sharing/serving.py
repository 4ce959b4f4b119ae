"""``gcs replay --serve``: the screens of a recording in a browser on this computer.

textual-serve carries them and starts a replay for each browser; by itself it would serve whoever reaches the port. Here
it listens on the loopback alone, the address has a secret in it, and what a page of another site has a browser ask is
refused: by the Host header, which names such a site where it was made to resolve to the loopback, and by the Origin.
"""

from __future__ import annotations

import asyncio
import contextlib
import re
import secrets
import signal
import socket
from collections.abc import Awaitable, Callable

from aiohttp import web
from textual_serve.server import Server

LOOPBACK = "127.0.0.1"
MAX_BROWSERS = 4
"""Most browsers at a time: each has a replay of its own."""
TOKEN_BYTES = 24
DOWNLOADS = "download"
"""Path under which textual-serve's pages ask for pictures, behind no token: each has a random name of its own, once."""
FOREIGN = re.compile(r"<link[^>]*https?://[^>]*>", re.DOTALL)
"""Addresses that textual-serve's page would have a browser fetch from elsewhere."""
TAKES_KEYS = """<script>
new MutationObserver((_, observer) => {
  const keys = document.querySelector(".xterm-helper-textarea");
  if (keys) { keys.focus(); observer.disconnect(); }
}).observe(document.body, { childList: true, subtree: true });
</script>"""
"""Puts the focus on the terminal once it is there."""
Handler = Callable[[web.Request], Awaitable[web.StreamResponse]]


class _GuardedServer(Server):
    """textual-serve's pages behind a token."""

    def __init__(self, command: str, title: str, port: int, token: str) -> None:
        super().__init__(command, host=LOOPBACK, port=port, title=title)
        self._token = token
        self._browsers = 0

    @property
    def address(self) -> str:
        """Address for a browser."""
        return f"{self.public_url}/{self._token}/"

    async def make_guarded_app(self) -> web.Application:
        """Make the application with all pages below the token."""
        app = web.Application(middlewares=[self._guard])
        app.add_subapp(f"/{self._token}/", await self._make_app())
        app.router.add_get(f"/{DOWNLOADS}/{{key}}", self.handle_download)
        return app

    async def on_startup(self, app: web.Application) -> None:
        """Print nothing."""

    async def handle_index(self, request: web.Request) -> web.Response:
        """The page: it asks nobody else for a font, and takes keys without a click."""
        page = await super().handle_index(request)
        assert isinstance(page, web.Response)
        page.text = FOREIGN.sub("", page.text or "").replace("</body>", f"{TAKES_KEYS}</body>")
        return page

    async def handle_websocket(self, request: web.Request) -> web.WebSocketResponse:
        """Run a replay for one browser.

        Raises:
            HTTPServiceUnavailable: there are enough.
        """
        if self._browsers >= MAX_BROWSERS:
            raise web.HTTPServiceUnavailable(text=f"{MAX_BROWSERS} browsers show it already; close one")
        self._browsers += 1
        try:
            return await super().handle_websocket(request)
        finally:
            self._browsers -= 1

    @web.middleware
    async def _guard(self, request: web.Request, handler: Handler) -> web.StreamResponse:
        """Refuse what does not come from its own pages; pages may ask nobody else."""
        own = f"{LOOPBACK}:{self.port}"
        wants_screens = request.path.endswith("/ws")
        origin = request.headers.get("Origin", "" if wants_screens else f"http://{own}")
        if request.host != own or origin != f"http://{own}":
            raise web.HTTPForbidden(text=f"this is served at http://{own} alone")
        given = request.path.split("/")[1]
        if given != DOWNLOADS and not secrets.compare_digest(given.encode(), self._token.encode()):
            raise web.HTTPNotFound
        response = await handler(request)
        if not response.prepared:
            response.headers.update(
                {
                    "Content-Security-Policy": "default-src 'self'; script-src 'self' 'unsafe-inline'; "
                    f"style-src 'self' 'unsafe-inline'; img-src 'self' data:; connect-src 'self' ws://{own}; "
                    "frame-ancestors 'none'; base-uri 'none'; form-action 'none'",
                    "Referrer-Policy": "no-referrer",
                    "X-Content-Type-Options": "nosniff",
                    "Cache-Control": "no-store",
                }
            )
        return response


def serve_screens(command: str, title: str, port: int, show: Callable[[str], None]) -> None:
    """Serve until Ctrl-C or a signal to end.

    Args:
        title: of the page until the screens are there.
        port: of the loopback; 0: any that is free.
        show: called with the address.

    Raises:
        OSError: the port is not to be had.
    """
    with socket.create_server((LOOPBACK, port)) as listening:
        server = _GuardedServer(command, title, listening.getsockname()[1], secrets.token_urlsafe(TOKEN_BYTES))
        with contextlib.suppress(KeyboardInterrupt):
            asyncio.run(_serve(server, listening, show))


async def _serve(server: _GuardedServer, listening: socket.socket, show: Callable[[str], None]) -> None:
    stop = asyncio.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        asyncio.get_running_loop().add_signal_handler(number, stop.set)
    runner = web.AppRunner(await server.make_guarded_app(), access_log=None, shutdown_timeout=2.0)
    await runner.setup()
    try:
        await web.SockSite(runner, listening).start()
        show(server.address)
        await stop.wait()
    finally:
        await runner.cleanup()
