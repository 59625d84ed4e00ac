"""What channels tell of the payloads that radios hold, against what hosts send and hear, and what was on the air."""

from collections import Counter
from typing import Any

import numpy as np
import pytest

from cosim.channels.adhoc.channel import AdhocChannel
from cosim.channels.adhoc.settings import AdhocSettings
from cosim.channels.base import Channel
from cosim.channels.bluetooth.device import BluetoothChannel
from cosim.channels.bluetooth.settings import BluetoothSettings
from cosim.channels.ideal import IdealChannel, IdealSettings
from cosim.channels.vision import OpticalChannel, OpticalSettings
from cosim.geometry.segments import packed_walls, segment_grid
from cosim.kernel import Kernel
from cosim.machine import BROADCAST, Address, Fate, Flush, LinkEvent, Outgoing, Page, Reception
from cosim.payloads import HELD, NEVER, OFF
from cosim.randomness import Streams
from cosim.trace import PAYLOADS, TRANSMISSIONS, UNSENT, Table, Trace
from cosim.units import MS, S, Time

ROBOTS = 4
LINKED, FAR, DEAD, END = 30 * S, 33 * S, 34 * S, 35 * S
"""When links are there, one robot moves out of reach, another is switched off, and the run is over."""
KINDS = ("ideal", "optical", "adhoc", "rts", "bluetooth", "flushed")


def made(kind: str, kernel: Kernel, trace: Trace) -> Channel:
    """Return a channel of four robots."""
    streams, common = Streams(1), (kernel, trace, ROBOTS)
    match kind:
        case "ideal":
            return IdealChannel(IdealSettings(delay_s=0.003, range_m=10.0, loss=0.2), *common, streams)
        case "optical":
            no_walls = packed_walls(segment_grid(np.empty((0, 4))))
            return OpticalChannel(OpticalSettings(rate_bps=40_000, range_m=10.0), *common, no_walls)
        case "adhoc" | "rts":
            threshold = {"rts_threshold": 10} if kind == "rts" else {}
            settings = AdhocSettings.model_validate({"range_m": 10.0, "phy": "dsss", "rate_mbps": 1.0} | threshold)
            return AdhocChannel(settings, *common, streams)
        case _:
            flush = {"flush_s": 0.02} if kind == "flushed" else {}
            return BluetoothChannel(BluetoothSettings.model_validate({"range_m": 10.0} | flush), *common, streams)


class Hosts:
    """The hosts of all robots: each sends payloads, no two alike, at random, and notes what becomes of them."""

    def __init__(self, kind: str, tables: tuple[Table, ...] = (PAYLOADS, TRANSMISSIONS, UNSENT)) -> None:
        self.kernel, self.trace = Kernel(), Trace(tables)
        self.channel = made(kind, self.kernel, self.trace)
        self.sent: dict[int, tuple[Time, Address, Address, bytes]] = {}
        self.over: dict[int, tuple[Time, str]] = {}
        for address in range(ROBOTS):
            self.channel.attach(address, self)
        places = np.array([(0.0, 0.0), (2.0, 0.0), (0.0, 2.0), (2.0, 2.0)])
        self.channel.moved(places)
        for peer in range(1, ROBOTS):
            self.kernel.at(peer * 6 * S, lambda peer=peer: self.channel.command(0, Page(peer)))
        stream = np.random.default_rng(5)
        for time in sorted(stream.integers(LINKED, END, 400).tolist()):
            source, length = int(stream.integers(ROBOTS)), int(stream.integers(12, 120))
            to = int(stream.choice([0] if source else [BROADCAST, 1, 2, 3]))
            self.kernel.at(time, lambda source=source, to=to, length=length: self.send(source, to, length))
        if kind != "ideal":  # which holds nothing when it is switched off: what it has sent arrives
            for early in range(1, 6):
                self.kernel.at(DEAD - early * MS // 2, lambda: self.send(2, 0, 100))
        self.kernel.at(FAR, lambda: self.channel.moved(np.array([*places[:3], (2.0, 92.0)])))
        self.kernel.at(DEAD, lambda: self.channel.power(2, False))
        self.kernel.at(DEAD + 1, lambda: self.channel.command(0, Flush(1)))

    def send(self, source: Address, to: Address, length: int) -> None:
        if source == 2 and self.kernel.now >= DEAD:
            return
        token = len(self.sent)
        payload = token.to_bytes(length, "big")
        self.sent[token] = self.kernel.now, source, to, payload
        self.channel.send(source, Outgoing(to, payload, token))

    def receive(self, data: bytes, reception: Reception, now: Time) -> None:
        pass

    def link(self, event: LinkEvent, now: Time) -> None:
        if isinstance(event, Fate):
            self.over[int(event.token)] = now, event.outcome.value

    def drain(self, now: Time) -> None:
        pass

    def run(self) -> None:
        self.kernel.run(END)
        self.channel.close(END)

    def rows(self, table: Table) -> list[dict[str, Any]]:
        columns = self.trace.columns(table.name)
        return [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)]


@pytest.mark.parametrize("kind", KINDS)
def test_rows_are_what_hosts_have_sent_and_heard_of_and_what_was_first_on_the_air(kind: str):
    hosts = Hosts(kind)
    hosts.run()
    refused = {(row["time_ns"], row["source"]) for row in hosts.rows(UNSENT)}
    firsts: dict[bytes, Time] = {}
    for row in sorted(hosts.rows(TRANSMISSIONS), key=lambda row: row["time_ns"]):
        firsts.setdefault(bytes.fromhex(row["body"]), row["time_ns"])
    silent = "flushed" if kind in ("bluetooth", "flushed") else OFF
    expected = []
    for token, (time, source, to, payload) in hosts.sent.items():
        if (time, source) not in refused:
            unheard = (DEAD, silent) if source == 2 else (END, HELD)
            heard = hosts.over.get(token, unheard)
            expected.append((time, source, to, len(payload), firsts.get(payload, NEVER), *heard))
    assert sorted(tuple(row.values()) for row in hosts.rows(PAYLOADS)) == sorted(expected)
    outcomes = Counter(row["outcome"] for row in hosts.rows(PAYLOADS))
    assert outcomes["delivered"] > 50
    assert outcomes["sent"] > 10
    assert len(outcomes) > 2
    assert kind == "ideal" or sum(row["source"] == 2 and row["end_ns"] == DEAD for row in hosts.rows(PAYLOADS)) > 2


@pytest.mark.parametrize("kind", KINDS)
def test_what_is_held_under_way_is_what_is_accepted_and_not_over(kind: str):
    hosts, seen = Hosts(kind), []
    for time in range(LINKED + 7, END, 37 * MS):
        hosts.kernel.run(time)
        seen.append((time, sorted(row[:4] for row in hosts.channel.held(time))))
    hosts.run()
    rows = hosts.rows(PAYLOADS)
    for time, held in seen:
        lasting = [tuple(row.values())[:4] for row in rows if row["time_ns"] < time <= row["end_ns"]]
        told = lasting if kind != "ideal" else [row for row in lasting if row[2] != BROADCAST]  # told at once
        assert held == sorted(told)
    assert sum(len(held) for _, held in seen) > 3


@pytest.mark.parametrize("kind", KINDS)
def test_to_ask_for_them_changes_nothing(kind: str):
    asked, not_asked = Hosts(kind), Hosts(kind, (TRANSMISSIONS,))
    for hosts in (asked, not_asked):
        hosts.run()
    assert asked.over == not_asked.over
    assert asked.kernel.executed == not_asked.kernel.executed
    assert asked.rows(TRANSMISSIONS) == not_asked.rows(TRANSMISSIONS)
