"""Key bytes become names, however a line tears them apart."""

import pytest
from hypothesis import given
from hypothesis import strategies as st
from rows import each

from sim.keyboard.bindings import ARM_KEYS, MOVES, OTHERS, SLIDERS, plain
from sim.keyboard.terminal import KeyDecoder

SENT = {
    b"\x1b[A": "up",
    b"\x1b[B": "down",
    b"\x1b[C": "right",
    b"\x1b[D": "left",
    b"\x1bOA": "up",
    b"\x1bOD": "left",
    b"\x1b[1;5C": "right",
    b"\x1b[5~": "pageup",
    b"\x1b[6~": "pagedown",
    b"\x1b[H": "home",
    b"\x1b[1~": "home",
    b"w": "w",
    b"+": "+",
    b" ": " ",
}
UNKNOWN = (b"\x1b[24~", b"\x1bOP", b"\x1b[Z", b"\x00", b"\t", b"\xc3\xa4", b"\x1b[201~")


@each(("data", "name"), SENT.items())
def test_a_key_has_its_name_in_one_piece_and_byte_by_byte(data, name):
    assert KeyDecoder().feed(data) == [name]
    torn = KeyDecoder()
    assert [key for byte in data for key in torn.feed(bytes([byte]))] == [name]


@pytest.mark.parametrize("data", UNKNOWN)
def test_unknown_keys_are_left_out_and_leave_nothing_behind(data):
    assert KeyDecoder().feed(data + b"w" + data + b"\x1b[A") == ["w", "up"]


def test_the_escape_key_does_not_swallow_the_next_one():
    decoder = KeyDecoder()
    assert decoder.feed(b"\x1b") == []
    assert decoder.feed(b"q") == ["q"]
    assert decoder.feed(b"\x1b\x1b\x1b[B") == ["down"]


def test_noise_after_an_escape_ends_some_time():
    decoder = KeyDecoder()
    decoder.feed(b"\x1b[" + b"1;" * 50)
    assert decoder.feed(b"ww")[-1] == "w"


@given(st.lists(st.sampled_from([*SENT, *UNKNOWN]), max_size=12), st.data())
def test_where_the_bytes_are_torn_does_not_matter(pieces, data):
    whole = b"".join(pieces)
    cuts = data.draw(st.lists(st.integers(0, len(whole)), max_size=8))
    bounds = [0, *sorted(cuts), len(whole)]
    decoder, torn = KeyDecoder(), []
    for a, b in zip(bounds[:-1], bounds[1:], strict=True):
        torn += decoder.feed(whole[a:b])
    assert torn == KeyDecoder().feed(whole)
    assert torn == [SENT[piece] for piece in pieces if piece in SENT]


@given(st.binary(max_size=60))
def test_no_bytes_are_too_strange(data):
    decoder = KeyDecoder()
    for key in decoder.feed(data):
        assert key.isprintable()
    decoder.feed(b"\x1b[A")
    assert decoder.feed(b"w") == ["w"]


def test_every_key_does_one_thing():
    others = {word for keys, _ in OTHERS for word in keys.split()}
    assert len(MOVES) == sum(len(s.more) + len(s.less) for s in SLIDERS)
    assert not others & set(MOVES)
    assert {"up", "w", "h", "+", "-"} <= ARM_KEYS


def test_capitals_and_keys_without_shift_mean_the_same():
    assert [plain(key) for key in "W=_ Q"] == ["w", "+", "-", "p", "q"]
