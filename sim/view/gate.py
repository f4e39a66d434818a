"""The gate of the page: who may come in, and how much he may say.

viser itself listens where nobody else can reach it, at a port of its own on this
machine. The gate looks at the head of every connection (host, origin, token) and hands
on the bytes of those it lets in.
"""

import asyncio
import hmac
import ipaddress
import secrets
import socket
import threading
from http.cookies import SimpleCookie
from urllib.parse import parse_qs, urlsplit

from roadmap.errors import BadInput

LOCAL = "127.0.0.1"
PORT = 8080
MOST_CLIENTS = 32  # connections at a time
_MOST_HEAD = 16_384  # bytes
_HEAD_S = 10.0  # a head has to be there by then [s]
_RATE = 2_000_000  # bytes a second that a client may say
_CHUNK = 65_536
_COOKIE = "odm_view"


def is_local(host: str) -> bool:
    """Return whether an address can be reached from this machine alone."""
    try:
        return host == "localhost" or ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


def token_for(host: str, token: str | None) -> str:
    """Return the token, None: a new one where others come; "" may not serve these."""
    if token is None:
        return "" if is_local(host) else secrets.token_urlsafe(16)
    if not token and not is_local(host):
        raise BadInput(
            f"--host {host} can be reached by others; give a --token that is not empty"
        )
    return token


def address_of(host: str, port: int, token: str) -> str:
    """Return what to open in a browser for a page at an address of this machine."""
    shown = f"[{host}]" if ":" in host else host
    if host in ("0.0.0.0", "::"):
        shown = socket.gethostname()
    return f"http://{shown}:{port}/{f'?token={token}' if token else ''}"


def listening(host: str, port: int) -> socket.socket:
    """Return a socket that listens at an address of this machine, on a free port."""
    if not isinstance(port, int) or not 0 <= port <= 65_535:
        raise BadInput(f"--port {port} is no port; give 1 to 65535, or 0 for any")
    try:
        family = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0][0]
        made = socket.socket(family, socket.SOCK_STREAM)
    except OSError as error:
        raise BadInput(
            f"--host {host} is no address ({error.strerror}); give 127.0.0.1, or "
            "0.0.0.0 for all of this machine's"
        ) from error
    made.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        made.bind((host, port))
        made.listen(64)
    except OSError as error:
        made.close()
        if isinstance(error, PermissionError):
            why = f"port {port} is not for users; give --port 1024 or more"
        elif error.errno == 98:  # EADDRINUSE
            why = f"port {port} of {host} is taken; give another --port, 0 for any"
        else:
            why = f"--host {host} is no address of this machine; give 127.0.0.1"
        raise BadInput(why) from error
    made.setblocking(False)
    return made


class Gate:
    """Stands before viser and lets in whom it should.

    A page of another site that is open in the same browser is not let in: `Host` and
    `Origin` are compared. Opened wider than this machine, it asks for the token: in the
    address once, then as a cookie.

    Args:
        listener: Where it listens.
        inner_port: Of viser, on this machine.
        host: The address that was asked for.
        token: What a client has to know; "" is nothing.
    """

    def __init__(
        self, listener: socket.socket, inner_port: int, host: str, token: str
    ) -> None:
        self.port = listener.getsockname()[1]
        self.host, self.token = host, token
        self._listener, self._inner = listener, inner_port
        self._loop = asyncio.new_event_loop()
        self._clients = 0
        self._thread = threading.Thread(target=self._run, daemon=True, name="gate")
        self._thread.start()

    @property
    def address(self) -> str:
        """What to open in a browser."""
        return address_of(self.host, self.port, self.token)

    def close(self) -> None:
        """Let nobody in any more."""
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join(2.0)
        self._listener.close()

    def _run(self) -> None:
        asyncio.set_event_loop(self._loop)
        self._loop.run_until_complete(
            asyncio.start_server(self._come, sock=self._listener)
        )
        self._loop.run_forever()
        tasks = asyncio.all_tasks(self._loop)
        for task in tasks:
            task.cancel()
        self._loop.run_until_complete(asyncio.gather(*tasks, return_exceptions=True))
        self._loop.close()

    async def _come(
        self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter
    ) -> None:
        self._clients += 1
        try:
            if self._clients > MOST_CLIENTS:
                await _say(writer, 503, "too many clients; close a page")
                return
            await self._meet(reader, writer)
        except (OSError, TimeoutError, asyncio.IncompleteReadError, ValueError):
            pass  # whoever leaves leaves
        except asyncio.CancelledError:
            pass  # the gate closes; asyncio would log it as an error of ours
        except asyncio.LimitOverrunError:
            await _say(writer, 431, "too long a head")
        finally:
            self._clients -= 1
            writer.close()

    async def _meet(
        self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter
    ) -> None:
        async with asyncio.timeout(_HEAD_S):
            head = await reader.readuntil(b"\r\n\r\n")
        if len(head) > _MOST_HEAD:
            await _say(writer, 431, "too long a head")
            return
        path, headers = _parsed(head)
        refusal = self._refusal(headers)
        if refusal:
            await _say(writer, 403, refusal)
            return
        if self.token:
            query = path.partition("?")[2]
            given = parse_qs(query).get("token", [""])[0]
            if _equal(given, self.token):
                cookie = f"{_COOKIE}={self.token}; HttpOnly; SameSite=Lax; Path=/"
                await _say(writer, 303, "", f"Location: /\r\nSet-Cookie: {cookie}\r\n")
                return
            if not _equal(_cookie(headers), self.token):
                why = "this page wants a token; open the address that odm printed"
                await _say(writer, 403, why)
                return
        await self._hand_on(head, reader, writer)

    def _refusal(self, headers: dict[str, str]) -> str:
        """Return why a head is not let in, "" where it is."""
        host = headers.get("host", "")
        name = _host_name(host)
        if is_local(self.host) and not is_local(name):
            return f"this page is not {host}; open http://{self.host}:{self.port}/"
        origin = headers.get("origin")
        if origin is not None and origin.partition("://")[2] != host:
            return "another site's page may not talk to this one"
        return ""

    async def _hand_on(
        self, head: bytes, reader: asyncio.StreamReader, writer: asyncio.StreamWriter
    ) -> None:
        """Hand bytes to and fro until one side leaves."""
        inside, out = await asyncio.open_connection(LOCAL, self._inner)
        out.write(head)
        tasks = [
            asyncio.create_task(_pump(reader, out, _RATE)),
            asyncio.create_task(_pump(inside, writer, None)),
        ]
        try:
            await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
        finally:
            for task in tasks:
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)
            out.close()


async def _pump(
    reader: asyncio.StreamReader, writer: asyncio.StreamWriter, rate: float | None
) -> None:
    """Hand bytes on, no more than `rate` a second; who says more has to wait."""
    while data := await reader.read(_CHUNK):
        writer.write(data)
        await writer.drain()
        if rate is not None and len(data) > 4096:
            await asyncio.sleep(len(data) / rate)


def _parsed(head: bytes) -> tuple[str, dict[str, str]]:
    """Return the path and the headers, by lower-case name, of a head of HTTP."""
    first, *lines = head.decode("latin-1").split("\r\n")
    words = first.split(" ")
    pairs = (line.partition(":") for line in lines if line)
    headers = {name.strip().lower(): value.strip() for name, _, value in pairs}
    return (words[1] if len(words) > 1 else "/"), headers


def _host_name(host: str) -> str:
    """Return the name in a `Host` header, "" for none."""
    try:
        return urlsplit(f"//{host}").hostname or ""
    except ValueError:
        return ""


def _cookie(headers: dict[str, str]) -> str:
    found = SimpleCookie()
    try:
        found.load(headers.get("cookie", ""))
    except Exception:
        return ""
    return found[_COOKIE].value if _COOKIE in found else ""


def _equal(a: str, b: str) -> bool:
    return hmac.compare_digest(a.encode(), b.encode())


async def _say(
    writer: asyncio.StreamWriter, code: int, text: str, more: str = ""
) -> None:
    body = f"{text}\n".encode() if text else b""
    head = (
        f"HTTP/1.1 {code} odm\r\nContent-Type: text/plain; charset=utf-8\r\n"
        f"Content-Length: {len(body)}\r\nConnection: close\r\n{more}\r\n"
    )
    writer.write(head.encode() + body)
    await writer.drain()
