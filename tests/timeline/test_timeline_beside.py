"""A payload of Low Energy that is on the air in several packets is put together from what is beside any of them."""

import random
from collections.abc import Iterator
from typing import Any, Final

import pytest

from cosim.channels.ble.bits.pdu import (
    AuxiliaryPhy,
    AuxPtr,
    DataInfo,
    DataPdu,
    DeviceAddress,
    Extended,
    Llid,
    encode_advertising,
    encode_data,
)
from cosim.channels.ble.broadcasts.extended import pieces
from cosim.channels.ble.dissection import PARTS, Part, dissect, put_together
from cosim.machine import BROADCAST
from cosim.timeline.assembly import lanes_of
from cosim.timeline.beside import beside
from cosim.timeline.detail import Nearby, Row, detail
from cosim.trace import FRAMES, INTERVALS, RECEPTIONS, TRANSMISSIONS, Trace
from cosim.units import MS, US, S
from tests.channels.ble.ble_field import Field

SIZES: Final = (1, 16, 17, 20, 40, 100, 244, 245, 500, 900)
FAR: Final = [(0.0, 0.0), (66.0, 0.0), (0.0, 5.0)]
"""Places of a central, of a peripheral from which many packets come wrong, and of one that is near."""


def decode(body: bytes, sent: Row | None, nearby: Nearby) -> Any:
    """Return the payload of which a transmission carries all or a part, hexadecimal; None if it carries none."""
    if sent is None or sent["kind"] not in PARTS:
        return None
    _, payload = dissect(sent["kind"], body)
    if payload is None:
        before, after = (map(part, rows) for rows in nearby(PARTS[sent["kind"]]))
        payload = put_together(part(sent), before, after)
    return None if payload is None else payload.hex()


def part(row: Row) -> Part:
    return Part(bytes.fromhex(row["body"]), row["retry"])


class Tables:
    """The tables of a trace in memory."""

    def __init__(self, trace: Trace) -> None:
        self._rows: dict[str, list[Row]] = {}
        self._at: dict[tuple[str, int], list[Row]] = {}
        for name in trace.tables:
            columns = trace.columns(name)
            rows = [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)]
            self._rows[name] = sorted(rows, key=lambda row: row[next(iter(row))])
            for row in self._rows[name]:
                self._at.setdefault((name, row[next(iter(row))]), []).append(row)

    def row(self, table: str, number: int) -> Row:
        return self._rows[table][number]

    def at(self, table: str, time: int) -> list[Row]:
        return self._at.get((table, time), [])

    def total(self, table: str, name: str, rows: Any) -> int:
        raise AssertionError


@pytest.fixture(scope="module")
def field() -> Field:
    """Return a run in which payloads of many lengths go both ways over two links, and to everyone."""
    tables = (TRANSMISSIONS, FRAMES, RECEPTIONS, INTERVALS)
    noisy = {"model": "log_distance", "exponent": 3.2}
    field = Field(3, tables=tables, propagation=noisy, idle_frames=True, connection={"octets": 27})
    field.move(FAR)
    field.link(0, 1, 2)
    chance = random.Random(3)
    field.sent = []  # type: ignore[attr-defined]
    for at, size in enumerate(chance.sample(SIZES, len(SIZES))):
        for source, to in ((0, 1), (1, 0), (0, 2), (0, BROADCAST)):
            payload = chance.randbytes(size + (0 if to >= 0 else at))
            field.sent.append((source, to, payload))  # type: ignore[attr-defined]
            field.send(source, to, payload)
        field.until(field.kernel.now + chance.randrange(80) * MS)
    field.until(field.kernel.now + 8 * S)
    return field


def expected(field: Any) -> Iterator[tuple[int, int, str, bytes]]:
    """Yield start, source, kind and payload of each packet that carries a part of one, by the order of sending."""
    rows = sorted(zip(*field.trace.columns(TRANSMISSIONS.name).values(), strict=True), key=lambda row: row[0])
    names = [each.name for each in TRANSMISSIONS.fields]
    carried = [row for row in (dict(zip(names, each, strict=True)) for each in rows) if row["length"]]
    for source, to in ((0, 1), (1, 0), (0, 2)):
        payloads = [payload for one, other, payload in field.sent if (one, other) == (source, to)]
        ends, total = [], 0
        for payload in payloads:
            total += 4 + 3 + len(payload)  # headers of L2CAP and of ATT
            ends.append(total)
        done = last = 0
        for row in carried:
            if (row["source"], row["destination"]) != (source, to):
                continue
            if not row["retry"]:
                last, done = done, done + row["length"]
            which = next(at for at, end in enumerate(ends) if last < end)
            yield row["time_ns"], source, row["kind"], payloads[which]
        assert done == total
    chains: list[list[Any]] = []
    for row in carried:
        if row["destination"] == BROADCAST:
            if row["kind"] == "AUX_ADV_IND":
                chains.append([])
            chains[-1].append(row)
    by_length = {len(payload): payload for _, to, payload in field.sent if to == BROADCAST}
    for chain in chains:
        payload = by_length[sum(row["length"] for row in chain)]
        yield from ((row["time_ns"], row["source"], row["kind"], payload) for row in chain)


def test_each_packet_tells_the_payload_of_which_it_carries_a_part(field: Any) -> None:
    lanes, codes = lanes_of(field.trace)
    tables = Tables(field.trace)
    wanted = {row[:3]: row[3].hex() for row in expected(field)}
    kinds = [name for _, name in codes.kinds]
    seen, again = 0, 0
    for lane in lanes:
        if lane.named.what not in ("sent", "received"):
            continue
        for start, kind, row in zip(
            lane.boxes.starts.tolist(), lane.boxes.kinds, lane.boxes.rows.tolist(), strict=True
        ):
            told = detail(tables, lane, row, decode, lambda sent, kinds: beside(lanes, codes, tables, sent, kinds))
            source = told["fields"]["source"]
            assert told["decoded"] == wanted.get((start, source, kinds[kind])), (start, kinds[kind])
            seen += told["decoded"] is not None
            again += told["decoded"] is not None and told["transmission"]["retry"]
    assert seen > 2 * len(wanted) * 0.8
    assert again > 50


SENT: Final = [(0, "DATA", 1), (0, "DATA", 2), (0, "EMPTY", 1), (1, "DATA", 0), (0, "DATA", 1), (0, "CONTROL", 1)] * 3
"""Sender, type and receiver of transmissions, one a microsecond."""


def test_what_is_beside_is_of_the_same_sender_and_receiver_and_of_the_wanted_types_in_order() -> None:
    trace = Trace([TRANSMISSIONS])
    for at, (source, kind, to) in enumerate(SENT):
        trace.row(TRANSMISSIONS, at * US, source, kind, to, 0, 0, False, False, True, "", 300, 4, 0, 0)
    lanes, codes = lanes_of(trace)
    tables = Tables(trace)
    for at, (source, kind, to) in enumerate(SENT):
        for wanted in ({kind}, {"DATA", "CONTROL"}, {"RTS"}):
            found = beside(lanes, codes, tables, tables.row("transmissions", at), wanted)
            alike = [other for other, row in enumerate(SENT) if (row[0], row[2]) == (source, to) and row[1] in wanted]
            expected = [other for other in alike if other < at][::-1], [other for other in alike if other > at]
            assert tuple([row["time_ns"] // US for row in rows] for rows in found) == expected
    assert [*map(list, beside([], codes, tables, tables.row("transmissions", 0), {"DATA"}))] == [[], []]


# ---------------------------------------------------------------- what cannot be put together

ANN: Final = DeviceAddress(0x112233445566, random=True)
PAYLOAD: Final = bytes(range(100))
MESSAGE: Final = (3 + len(PAYLOAD)).to_bytes(2, "little") + b"\x04\x00\x1b\x03\x00" + PAYLOAD


def on_link(llid: Llid, payload: bytes, again: bool = False, link: bytes = b"LINK") -> Part:
    return Part(link + encode_data(DataPdu(llid, payload=payload)) + b"crc", again)


PIECES: Final = [
    on_link(Llid.START, MESSAGE[:27]),
    on_link(Llid.CONTINUATION, MESSAGE[27:54]),
    on_link(Llid.CONTINUATION, MESSAGE[54:81]),
    on_link(Llid.CONTINUATION, MESSAGE[81:]),
]


def around(at: int, parts: list[Part]) -> bytes | None:
    return put_together(parts[at], reversed(parts[:at]), parts[at + 1 :])


def test_pieces_of_a_message_are_put_together_whatever_is_between_them() -> None:
    first, second, third, last = PIECES
    other = on_link(Llid.CONTINUATION, b"other", link=b"link")
    copy = third._replace(again=True)
    for parts in ([*PIECES], [other, first, second, other, third, copy, copy, last, first]):
        for at, each in enumerate(parts[: parts.index(last) + 1]):
            assert around(at, parts) == (None if each is other else PAYLOAD)


@pytest.mark.parametrize("left_out", range(4))
def test_a_message_of_which_a_piece_is_missing_says_nothing(left_out: int) -> None:
    parts = [each for at, each in enumerate(PIECES) if at != left_out]
    assert [around(at, parts) for at in range(3)] == [None] * 3
    parts.append(PIECES[0])  # the next one begins
    assert around(0, parts) is None


def test_what_follows_a_whole_message_is_none_of_it() -> None:
    assert around(4, [*PIECES, PIECES[3]]) is None


def on_chain(data: bytes, first: bool, more: bool, set_id: int = 3) -> Part:
    aux = AuxPtr(7, 600 * US, AuxiliaryPhy.LE_1M) if more else None
    pdu = Extended(advertiser=ANN if first else None, data_info=DataInfo(5, set_id), aux=aux, data=data)
    return Part(bytes.fromhex("d6be898e") + encode_advertising(pdu) + b"crc", again=True)


def test_a_chain_is_put_together_from_any_of_its_packets_and_not_with_those_of_another_set() -> None:
    payload = random.Random(1).randbytes(600)
    data = pieces(payload)
    chain = [on_chain(each, at == 0, at < len(data) - 1) for at, each in enumerate(data)]
    other = on_chain(data[1], False, True, set_id=4)
    for at in range(3):
        assert around(at, [*chain, *chain]) == payload
        assert around(3 + at, [*chain, *chain]) == payload
    assert around(0, chain[:2]) is None
    assert around(1, [chain[2], chain[1]]) is None
    assert around(0, [chain[0], other, chain[2]]) is None
    assert around(0, [chain[0], chain[0], chain[1], chain[2]]) is None  # its sender was switched off after the first
