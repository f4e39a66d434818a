"""The bench of the page: what it counts, without a browser."""

import json
import socket
import time

import numpy as np
import pytest

from roadmap.errors import BadInput
from sim.bench import view
from sim.bench.browser import Browser, flags_of
from sim.tables.header import header


def test_a_frame_counts_with_the_least_of_its_rounds():
    rounds = [np.array([2.0, 5.0, 1.0]), np.array([3.0, 4.0, 9.0])]
    np.testing.assert_array_equal(view._least(rounds), [2.0, 4.0, 1.0])


def test_messages_and_bytes_are_those_of_a_client_in_a_second():
    clients = view._Clients("http://127.0.0.1:1/")
    clients.scene, clients.messages, clients.bytes = 4_000_000, 40, 8_000
    clients.seconds = 2.0
    rows = {row["name"]: row["value"] for row in view._messages(clients, 200)}
    assert rows == {
        "scene, sent to a client": 2.0,
        "messages to a client": 10.0,
        "bytes to a client": 2.0,
    }
    json.dumps(rows, allow_nan=False)


def test_without_a_browser_one_sentence_says_what_to_install(monkeypatch):
    monkeypatch.setenv("PATH", "/nowhere")
    with pytest.raises(BadInput, match="no browser; install one of chromium"):
        Browser()
    (row,) = view._looked_at(*_page_that_is_never_shown())
    assert row["value"] is None and "no browser" in row["note"]


def _page_that_is_never_shown():
    return None, None, True


def test_no_seconds_are_refused(tmp_path):
    with pytest.raises(BadInput, match="0 s of each run are none"):
        view.run(tmp_path, seconds=0)


def test_whoever_watches_without_drawing_counts_as_one_who_looks():
    """They never said where they look, so the page drew for nobody."""
    viser = pytest.importorskip("viser")
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    server = viser.ViserServer(host="127.0.0.1", port=port, verbose=False)
    try:
        with view._Clients(f"http://127.0.0.1:{port}/"):
            for _ in range(600):  # a minute, on a busy machine
                if len(server.get_clients()) == view.CLIENTS:
                    break
                time.sleep(0.1)
            assert len(server.get_clients()) == view.CLIENTS
    finally:
        server.stop()


def test_the_card_or_the_processor_draws():
    for card in (True, False):
        assert ("--use-angle=vulkan" in flags_of(card)) == card
        assert ("--use-angle=swiftshader" in flags_of(card)) != card


def test_the_card_is_asked_for_and_the_figures_are_written(odm, monkeypatch, tmp_path):
    asked = {}

    def run(map_dir, *, card=False, seconds=5.0, short=False):
        asked.update(map_dir=str(map_dir), card=card, seconds=seconds)
        rows = [view.value_row("page usable after", np.nan, "s", "no browser", most=3)]
        return {"bench": "view", "header": header(), "rows": rows}

    monkeypatch.setattr(view, "run", run)
    file = tmp_path / "view.json"
    words = ("bench", "view", "--map", "m", "--card", "--seconds", "20")
    code, out, err = odm(*words, "--json", str(file))
    assert code == 0 and "page usable after" in out, err
    assert asked == {"map_dir": "m", "card": True, "seconds": 20.0}
    (row,) = json.loads(file.read_text())["rows"]
    assert row["value"] is None and row["asked"] == {"most": 3}
    code, out, _ = odm(*words[:4], "--json")
    assert code == 0 and json.loads(out)["rows"] == [row] and not asked["card"]
