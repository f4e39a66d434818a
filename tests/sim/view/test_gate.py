"""The gate: who may come in, and what a flood does to the others."""

import asyncio
import socket
import threading

import pytest

from roadmap.errors import BadInput
from sim.view.gate import Gate, is_local, listening, token_for

INSIDE = b"HTTP/1.1 200 OK\r\nContent-Length: 6\r\n\r\ninside"


class Inner:
    """Stands for viser: answers every connection, and then echoes."""

    def __init__(self):
        self.socket = listening("127.0.0.1", 0)
        self.port = self.socket.getsockname()[1]
        self.loop = asyncio.new_event_loop()
        self.thread = threading.Thread(target=self.run, daemon=True)
        self.thread.start()

    def run(self):
        self.loop.run_until_complete(
            asyncio.start_server(self.answer, sock=self.socket)
        )
        self.loop.run_forever()

    async def answer(self, reader, writer):
        await reader.readuntil(b"\r\n\r\n")
        writer.write(INSIDE)
        while data := await reader.read(65536):
            writer.write(data)
        writer.close()

    def close(self):
        self.loop.call_soon_threadsafe(self.loop.stop)
        self.thread.join(2)


@pytest.fixture(scope="module")
def inner():
    made = Inner()
    yield made
    made.close()


@pytest.fixture
def gate(inner):
    made = Gate(listening("127.0.0.1", 0), inner.port, "127.0.0.1", "")
    yield made
    made.close()


@pytest.fixture
def wide(inner):
    made = Gate(listening("127.0.0.1", 0), inner.port, "0.0.0.0", "secret")
    yield made
    made.close()


def ask(gate, path="/", host=None, **headers):
    """Return the first answer to a request."""
    lines = {"Host": host or f"127.0.0.1:{gate.port}"}
    lines |= {k.replace("_", "-"): v for k, v in headers.items()}
    head = "".join(f"{k}: {v}\r\n" for k, v in lines.items())
    with socket.create_connection(("127.0.0.1", gate.port), 5) as line:
        line.sendall(f"GET {path} HTTP/1.1\r\n{head}\r\n".encode())
        line.settimeout(5)
        return line.recv(65536).decode()


def test_who_opens_the_page_here_is_let_in(gate):
    assert ask(gate).endswith("inside")
    assert ask(gate, host=f"localhost:{gate.port}").endswith("inside")
    assert gate.address == f"http://127.0.0.1:{gate.port}/"


@pytest.mark.parametrize("host", ["evil.example", "10.0.0.7:8080", ""])
def test_another_name_for_this_machine_is_not(gate, host):
    answer = ask(gate, host=host or "[")
    assert "403" in answer.split("\r\n")[0] and "inside" not in answer


def test_a_page_of_another_site_is_not(gate):
    evil = ask(gate, Origin="http://evil.example", Upgrade="websocket")
    assert "403" in evil and "another site" in evil
    own = ask(gate, Origin=f"http://127.0.0.1:{gate.port}", Upgrade="websocket")
    assert own.endswith("inside")


def test_opened_wider_it_wants_the_token_once_and_then_the_cookie(wide):
    assert "secret" in wide.address
    assert "wants a token" in ask(wide, host="robot.lab:80")
    assert "wants a token" in ask(wide, "/?token=guess", host="robot.lab:80")
    answer = ask(wide, "/?token=secret", host="robot.lab:80")
    assert answer.startswith("HTTP/1.1 303") and "HttpOnly" in answer
    cookie = answer.split("Set-Cookie: ")[1].split(";")[0]
    assert ask(wide, host="robot.lab:80", Cookie=cookie).endswith("inside")
    wrong = ask(wide, host="robot.lab:80", Cookie="odm_view=guess")
    assert "wants a token" in wrong


@pytest.mark.parametrize(
    "said", [b"", b"nonsense\r\n\r\n", b"GET / HTTP/1.1\r\n" + b"x" * 100_000]
)
def test_who_says_nonsense_or_leaves_troubles_nobody(gate, said):
    with socket.create_connection(("127.0.0.1", gate.port), 5) as line:
        line.sendall(said)
    assert ask(gate).endswith("inside")


def test_who_floods_waits_and_the_others_do_not(gate):
    with socket.create_connection(("127.0.0.1", gate.port), 5) as flood:
        flood.sendall(f"GET / HTTP/1.1\r\nHost: 127.0.0.1:{gate.port}\r\n\r\n".encode())
        flood.setblocking(False)
        sent = 0
        try:
            for _ in range(2000):
                sent += flood.send(bytes(65536))
        except BlockingIOError:
            pass
        assert sent < 100_000_000
        assert ask(gate).endswith("inside")


def test_it_closes_without_a_word_while_clients_are_there(inner, caplog):
    gate = Gate(listening("127.0.0.1", 0), inner.port, "127.0.0.1", "")
    head = f"GET / HTTP/1.1\r\nHost: 127.0.0.1:{gate.port}\r\n\r\n".encode()
    with socket.create_connection(("127.0.0.1", gate.port), 5) as line:
        line.sendall(head)
        assert line.recv(65536).startswith(b"HTTP/1.1 200")
        gate.close()
        assert line.recv(65536) in (b"", b"inside")  # the rest, if it came apart
    assert [r.getMessage() for r in caplog.records] == []


def test_a_port_that_is_taken_is_refused_in_one_sentence():
    with listening("127.0.0.1", 0) as first:
        port = first.getsockname()[1]
        with pytest.raises(BadInput, match=f"port {port} of 127.0.0.1 is taken; give"):
            listening("127.0.0.1", port)


@pytest.mark.parametrize("port", [-1, 70_000])
def test_what_is_no_port_is_refused(port):
    with pytest.raises(BadInput, match="is no port; give 1 to 65535"):
        listening("127.0.0.1", port)


def test_an_address_of_another_machine_is_refused():
    with pytest.raises(BadInput, match="no address of this machine"):
        listening("192.0.2.1", 0)


def test_what_is_local_and_what_is_not():
    assert all(map(is_local, ["127.0.0.1", "localhost", "::1", "127.9.9.9"]))
    assert not any(map(is_local, ["0.0.0.0", "10.0.0.1", "robot", "", "::"]))
    assert len(token_for("0.0.0.0", None)) >= 20 and token_for(
        "0.0.0.0", None
    ) != token_for("0.0.0.0", None)
