"""A password before a page: every request, and the page's websocket, is let through to it only with one.

viser has no way of its own to tell people apart. So it listens on this machine alone, and this stands before it, with
HTTP's basic authentication. Whoever gave the password once gets a cookie, since not every browser sends a password
with a websocket. Nothing is encrypted.
"""

import asyncio
import base64
import hashlib
import hmac
import secrets
import threading
from typing import Any

_HEAD, _SECONDS = 64 * 1024, 10.0  # bytes of a request's head, and s for it to come, at most
_WRONG = 1.0  # s that a wrong password costs, one after the other, whoever asks
_CHUNK = 64 * 1024


class Guard:
    """Listens at `host`:`port` (0: any that is free) and lets those with the `password` through to the page at `inner`,
    a port of 127.0.0.1. The user's name does not matter.

    **Raises** `OSError` for an address that cannot be had.
    """

    def __init__(self, host: str, port: int, inner: int, password: str):
        self._inner, self._password, self._token = inner, _digest(password), secrets.token_urlsafe(32)
        self._loop = asyncio.new_event_loop()
        self._guess = asyncio.Lock()
        self._tasks: set[Any] = set()
        self._server = self._loop.run_until_complete(asyncio.start_server(self._serve, host, port, limit=_HEAD))
        self.port: int = self._server.sockets[0].getsockname()[1]
        self._cookie = f"jaxrmp_{self.port}"
        self._thread = threading.Thread(target=self._loop.run_forever, name="guard", daemon=True)
        self._thread.start()

    def stop(self) -> None:
        """Listen no more, and end what is connected."""
        self._loop.call_soon_threadsafe(self._end)
        self._thread.join(timeout=5.0)

    def _end(self) -> None:
        self._server.close()
        for task in self._tasks:
            task.cancel()
        self._loop.call_later(0.1, self._loop.stop)

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        task = asyncio.current_task()
        self._tasks.add(task)
        try:
            head = await asyncio.wait_for(reader.readuntil(b"\r\n\r\n"), _SECONDS)
            await self._answer(head.decode("latin-1"), reader, writer)
        except (OSError, TimeoutError, asyncio.IncompleteReadError, asyncio.LimitOverrunError, asyncio.CancelledError):
            pass  # whoever it was is gone, sent no request, or the page has ended
        finally:
            self._tasks.discard(task)
            writer.close()

    async def _answer(self, head: str, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        request, *lines = head.split("\r\n")
        pairs = [(name.strip().lower(), value.strip()) for name, _, value in (line.partition(":") for line in lines)]
        headers = dict(pairs)
        method, _, rest = request.partition(" ")
        path = rest.partition(" ")[0]
        known = self._has_cookie(headers.get("cookie", ""))
        if not known and not await self._has_password(headers.get("authorization", "")):
            return await _reply(writer, "401 Unauthorized", 'WWW-Authenticate: Basic realm="jaxrmp", charset="UTF-8"')
        if method != "GET":
            return await _reply(writer, "405 Method Not Allowed", "Allow: GET")
        socket = headers.get("upgrade", "").lower() == "websocket"
        if socket and headers.get("origin", "//" + headers.get("host", "")).partition("//")[2] != headers.get("host"):
            return await _reply(writer, "403 Forbidden")  # another site's page in the browser of somebody who may
        if not known and not socket:
            cookie = f"Set-Cookie: {self._cookie}={self._token}; HttpOnly; SameSite=Strict; Path=/"
            # In full, so that a name and password that stood in the address stand there no more: viser fails on them.
            back = f"http://{headers.get('host', '')}{path if path.startswith('/') else '/'}"
            return await _reply(writer, "303 See Other", f"Location: {back}", cookie)
        ours = ("authorization", "cookie", "connection")
        kept = [line for line, (name, _) in zip(lines, pairs, strict=True) if name and name not in ours]
        upgrade = f"Connection: {'Upgrade' if socket else 'close'}"  # one request a connection: each is looked at
        inside, out = await asyncio.open_connection("127.0.0.1", self._inner)
        try:
            out.write("\r\n".join([request, *kept, upgrade, "", ""]).encode("latin-1"))
            ways = [asyncio.ensure_future(_pipe(inside, writer))]
            if socket:
                ways.append(asyncio.ensure_future(_pipe(reader, out)))
            try:
                await asyncio.wait(ways, return_when=asyncio.FIRST_COMPLETED)
            finally:
                for way in ways:
                    way.cancel()
        finally:
            out.close()

    def _has_cookie(self, cookies: str) -> bool:
        found = [pair.strip().partition("=") for pair in cookies.split(";")]
        given = [value for name, _, value in found if name == self._cookie]
        return any(hmac.compare_digest(value.encode("latin-1"), self._token.encode()) for value in given)

    async def _has_password(self, authorization: str) -> bool:
        kind, _, encoded = authorization.partition(" ")
        if kind.lower() != "basic":
            return False
        try:
            given = base64.b64decode(encoded, validate=True).decode()
        except ValueError:
            given = ":"
        async with self._guess:
            right = hmac.compare_digest(_digest(given.partition(":")[2]), self._password)
            if not right:
                await asyncio.sleep(_WRONG)
        return right


def _digest(password: str) -> bytes:
    return hashlib.sha256(password.encode()).digest()


async def _reply(writer: asyncio.StreamWriter, status: str, *headers: str) -> None:
    lines = [
        f"HTTP/1.1 {status}",
        *headers,
        "Content-Length: 0",
        "Cache-Control: no-store",
        "Connection: close",
        "",
        "",
    ]
    writer.write("\r\n".join(lines).encode("latin-1"))
    await writer.drain()


async def _pipe(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
    while chunk := await reader.read(_CHUNK):
        writer.write(chunk)
        await writer.drain()
