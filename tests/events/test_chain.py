"""What is hashed, written out a second time with struct and hashlib, and one leaf for ever."""

from __future__ import annotations

import struct
from hashlib import blake2b, sha256
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from events import Chain, ChainBroken, Moment
from events.chain import FIRST_LEAF_BEFORE
from events.records import Stored
from tests.checks import check_equal

FLIGHT_ID = bytes.fromhex("000102030405060708090a0b0c0d0e0f")
SECRET = bytes(range(32))
AT = Moment(flight_ns=0x1122334455667788, mono_ns=0x99AABBCCDDEEFF00, boot=0xDEADBEEF, wall_ns=-2, clock_quality=2)
GOLDEN = Stored(
    seq=0x0102030405060708, cause=-1, at=AT, kind_number=0xABCD, version=7, body=b"a body", leaf=bytes(range(32, 64))
)
GOLDEN_LEAF = "7aab04774bd75b0211953f3f6c27c36a6bf457c0387c6d044d8c415ab326d541"


def leaf_by_hand(flight_id: bytes, secret: bytes, stored: Stored, before: bytes) -> bytes:
    """Return the leaf as the design says it, byte by byte: big-endian, the salt's seq alone little-endian."""
    header = flight_id
    header += stored.seq.to_bytes(8, "big") + stored.cause.to_bytes(8, "big", signed=True)
    header += stored.at.flight_ns.to_bytes(8, "big") + stored.at.mono_ns.to_bytes(8, "big")
    header += stored.at.boot.to_bytes(4, "big") + stored.at.wall_ns.to_bytes(8, "big", signed=True)
    header += bytes([stored.at.clock_quality]) + stored.kind_number.to_bytes(2, "big") + bytes([stored.version])
    header += before
    assert len(header) == 16 + 8 + 8 + 8 + 8 + 4 + 8 + 1 + 2 + 1 + 32
    salt = blake2b(struct.pack("<Q", stored.seq), digest_size=16, key=secret).digest()
    return sha256(b"\x00" + header + sha256(salt + stored.body).digest()).digest()


def leaf_of(
    stored: Stored, before: bytes = FIRST_LEAF_BEFORE, flight_id: bytes = FLIGHT_ID, secret: bytes = SECRET
) -> bytes:
    """Return the leaf that the chain gives."""
    chain = Chain(flight_id, secret, before)
    leaf = chain.extend(stored.seq, stored.cause, stored.at, stored.kind_number, stored.version, stored.body)
    assert chain.leaf == leaf
    return leaf


def test_one_leaf_for_ever() -> None:
    """If this fails, every log that was ever written has become unreadable."""
    check_equal(leaf_of(GOLDEN, GOLDEN.leaf).hex(), GOLDEN_LEAF)
    check_equal(leaf_by_hand(FLIGHT_ID, SECRET, GOLDEN, GOLDEN.leaf).hex(), GOLDEN_LEAF)
    check_equal(FIRST_LEAF_BEFORE, bytes(32))


U64 = st.integers(0, 2**64 - 1)
I64 = st.integers(-(2**63), 2**63 - 1)
MOMENTS = st.builds(Moment, U64, U64, st.integers(0, 2**32 - 1), I64, st.integers(0, 255))
LEAVES = st.binary(min_size=32, max_size=32)
STORED = st.builds(
    Stored, U64, I64, MOMENTS, st.integers(0, 2**16 - 1), st.integers(0, 255), st.binary(max_size=80), LEAVES
)


@settings(max_examples=200, deadline=None)
@given(st.binary(min_size=16, max_size=16), LEAVES, STORED)
def test_the_leaf_is_what_the_design_says(flight_id: bytes, secret: bytes, stored: Stored) -> None:
    """For any record."""
    check_equal(leaf_of(stored, stored.leaf, flight_id, secret), leaf_by_hand(flight_id, secret, stored, stored.leaf))


@settings(max_examples=200, deadline=None)
@given(STORED, STORED)
def test_other_content_has_another_leaf(one: Stored, other: Stored) -> None:
    """Each column by itself is under the hash."""
    leaves = {leaf_of(one)}
    versions = {one}
    for name in ("seq", "cause", "kind_number", "version", "body"):
        versions.add(one._replace(**{name: getattr(other, name)}))
    for name in Moment._fields:
        versions.add(one._replace(at=one.at._replace(**{name: getattr(other.at, name)})))
    leaves |= {leaf_of(version) for version in versions}
    check_equal(len(leaves), len(versions))


@settings(max_examples=100, deadline=None)
@given(STORED.filter(lambda stored: stored.body != b""), st.data())
def test_every_bit_of_the_body_is_under_the_hash(stored: Stored, data: st.DataObject) -> None:
    """Also its length."""
    bit = data.draw(st.integers(0, 8 * len(stored.body) - 1))
    body = bytearray(stored.body)
    body[bit // 8] ^= 1 << bit % 8
    others = [bytes(body), stored.body + b"\x00", stored.body[:-1]]
    check_equal(leaf_of(stored) in {leaf_of(stored._replace(body=other)) for other in others}, False)


def test_flight_secret_and_the_leaf_before_are_under_the_hash() -> None:
    """The same record of another flight, under another salt, or after another record, is another leaf."""
    leaves = {
        leaf_of(GOLDEN),
        leaf_of(GOLDEN, bytes(31) + b"\x01"),
        leaf_of(GOLDEN, flight_id=bytes(16)),
        leaf_of(GOLDEN, secret=bytes(32)),
    }
    check_equal(len(leaves), 4)


def log(number: int = 4) -> list[Stored]:
    """Return records whose chain holds."""
    chain = Chain(FLIGHT_ID, SECRET)
    rows = []
    for seq in range(number):
        at, body = Moment(seq, seq, 1, seq, 2), b"body %d" % seq
        rows.append(Stored(seq, seq - 1, at, 5, 1, body, chain.extend(seq, seq - 1, at, 5, 1, body)))
    return rows


def first_broken(rows: list[Stored]) -> int | None:
    """Return the place of the first record at which the chain breaks."""
    chain = Chain(FLIGHT_ID, SECRET)
    for place, row in enumerate(rows):
        before = chain.leaf
        try:
            chain.check(row)
        except ChainBroken:
            assert chain.leaf == before
            return place
    return None


def test_a_log_that_holds() -> None:
    """Nothing is broken in it."""
    check_equal(first_broken(log()), None)


@pytest.mark.parametrize(
    "change",
    [
        {"body": b"other"},
        {"body": "body 2"},
        {"body": None},
        {"kind_number": 6},
        {"kind_number": 1 << 16},
        {"kind_number": "5"},
        {"cause": 0.5},
        {"version": -1},
        {"seq": -1},
        {"at": Moment(2, 2, 1, 2, 256)},
        {"at": Moment(-1, 2, 1, 2, 2)},
        {"leaf": bytes(32)},
        {"leaf": None},
    ],
)
def test_a_changed_record_breaks_it(change: dict[str, Any]) -> None:
    """Also one whose columns hold what no header can: that is broken too, not an accident."""
    rows = log()
    rows[2] = rows[2]._replace(**change)
    check_equal(first_broken(rows), 2)


def test_order_and_completeness() -> None:
    """A record that is missing, doubled or in another place breaks the chain where it happens."""
    rows = log()
    check_equal(first_broken([rows[0], rows[2], rows[3]]), 1)
    check_equal(first_broken([rows[0], rows[1], rows[1]]), 2)
    check_equal(first_broken([rows[1]]), 0)
    check_equal(first_broken([rows[0], rows[2], rows[1], rows[3]]), 1)


def test_a_misfit_leaves_the_chain_where_it_was() -> None:
    """So that a record that was refused is not in the history of the next."""
    chain = Chain(FLIGHT_ID, SECRET)
    with pytest.raises(struct.error):
        chain.extend(0, -1, Moment(0, 0, 1 << 32, 0, 0), 5, 1, b"")
    check_equal(chain.leaf, FIRST_LEAF_BEFORE)
