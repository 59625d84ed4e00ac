"""What a protocol is told beforehand of what radios can do is what they do: links, longest payloads, time divided."""

from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import pytest

from cosim.channels.kinds import ChannelSpec
from cosim.machine import BROADCAST, Address, Connected, Fate, LinkEvent, Outcome, Outgoing, Page, PageFailed, Reception
from cosim.protocol import PayloadBytes, Surroundings
from cosim.simulation import Simulation
from cosim.units import S, Time
from tests.faults.fault_scene import SPEC as DRIVERS
from tests.faults.fault_scene import Coroner, Parameters, scenario

BLUETOOTH, BLE, ADHOC = {"kind": "bluetooth"}, {"kind": "ble"}, {"kind": "adhoc"}
FAST = {"links": 20, "interval_s": 0.03}


WIDE = {"map": "walls", "bounds_m": [0, 0, 60, 20]}


class Witness(Coroner):
    """A referee that keeps what the protocol was told of the run."""

    def __init__(self, parameters: Parameters, setup: Surroundings, surroundings: Surroundings) -> None:
        super().__init__(parameters, setup, surroundings)
        self.told = setup


SPEC = replace(DRIVERS, referee=Witness)


class Host:
    def __init__(self) -> None:
        self.heard: list[tuple[bool, int]] = []
        """(sent to everyone, bytes)"""
        self.events: list[LinkEvent] = []

    def receive(self, data: bytes, reception: Reception, now: Time) -> None:
        self.heard.append((reception.broadcast, len(data)))

    def link(self, event: LinkEvent, now: Time) -> None:
        self.events.append(event)

    def drain(self, now: Time) -> None:
        pass


class Field:
    """Robots beside each other, without machines, and what a protocol is told of their radios."""

    def __init__(self, channel: dict[str, Any], size: int = 2, **team: Any) -> None:
        use = "tests.channels.test_limits:SPEC"
        run = Simulation(scenario(use=use, channel=channel, size=size, team=team, floorplan=WIDE), 1)
        self.kernel, self.channel = run.kernel, run.channel
        assert isinstance(run.referee, Witness)
        self.told = run.referee.told
        self.hosts = [Host() for _ in range(size)]
        for address, host in enumerate(self.hosts):
            self.channel.attach(address, host)
        self.channel.moved(np.array([(1.0 + 0.5 * robot, 5.0) for robot in range(size)]))

    def page(self, *peers: Address) -> None:
        """Have robot 0 ask these for links, and wait until it has an answer of each."""
        for peer in peers:
            self.channel.command(0, Page(peer))
        while len(self.of(0, Connected, PageFailed)) < len(peers):
            self.kernel.run(self.kernel.now + S)

    def of(self, robot: Address, *kinds: type) -> list[Any]:
        return [event for event in self.hosts[robot].events if isinstance(event, kinds)]


@pytest.mark.parametrize(
    ("channel", "unicast", "broadcast"),
    [
        (BLUETOOTH, 339, 339),
        ({**BLUETOOTH, "packet_types": ["DM1"]}, 17, 17),
        ({**BLUETOOTH, "packet_types": ["DM5", "DH3"], "packet_choice": "best"}, 224, 224),
        (BLE, 65_532, 1622),
        ({**BLE, "connection": {"mtu_octets": 23}}, 20, 1622),
        ({**BLE, "connection": {"mtu_octets": 247, "octets": 27}, "broadcast": {"phy": "2M"}}, 244, 1622),
        ({**ADHOC, "rate_mbps": 11, "routing": {"kind": "flooding"}}, 65_507, 65_507),
        ({**ADHOC, "rate_mbps": 11, "routing": {"kind": "aodv"}}, 65_507, 65_507),
        ({**ADHOC, "rate_mbps": 11, "routing": {"kind": "olsr"}}, 65_507, 65_507),
    ],
    ids=str,
)
def test_the_longest_payload_arrives_and_one_byte_more_is_too_long(
    channel: dict[str, Any], unicast: int, broadcast: int
) -> None:
    field = Field(channel)
    assert field.told.payload_bytes == (PayloadBytes(unicast, broadcast),)
    field.page(1)
    field.kernel.run(60 * S)  # routers know each other
    sent = (1, unicast), (1, unicast + 1), (BROADCAST, broadcast), (BROADCAST, broadcast + 1)
    for token, (destination, length) in enumerate(sent):
        field.channel.send(0, Outgoing(destination, bytes(length), token))
    field.kernel.run(field.kernel.now + 120 * S)
    fates = {fate.token: fate.outcome for fate in field.of(0, Fate)}
    assert (fates[1], fates[3]) == (Outcome.TOO_LONG, Outcome.TOO_LONG)
    assert Outcome.TOO_LONG not in (fates[0], fates[2])
    assert sorted(field.hosts[1].heard) == [(False, unicast), (True, broadcast)]


@pytest.mark.parametrize("channel", [{"kind": "ideal"}, {"kind": "optical"}, ADHOC, {**ADHOC, "phy": "ofdm"}], ids=str)
def test_where_no_length_is_told_any_is_carried(channel: dict[str, Any]) -> None:
    field = Field(channel)
    assert (field.told.payload_bytes, field.told.links, field.told.shares) == ((PayloadBytes(),), (None,), (True,))
    field.channel.send(0, Outgoing(1, bytes(1_000_000), 1))
    field.channel.send(0, Outgoing(BROADCAST, bytes(1_000_000), 2))
    field.kernel.run(60 * S)
    assert [fate.outcome for fate in field.of(0, Fate)] == [Outcome.DELIVERED, Outcome.SENT]
    assert field.hosts[1].heard == [(False, 1_000_000), (True, 1_000_000)]


@pytest.mark.parametrize(
    ("channel", "links"), [(BLUETOOTH, 7), (BLE, 8), ({**BLE, "connection": {**FAST, "links": 12}}, 12)], ids=str
)
def test_a_master_gets_so_many_links_and_no_more(channel: dict[str, Any], links: int) -> None:
    field = Field(channel, links + 2)
    assert field.told.links == (links,)
    field.page(*range(1, links + 2))
    assert len(field.of(0, Connected)) == links
    assert [event.peer for event in field.of(0, PageFailed)] == [links + 1]


def test_each_radio_is_told_of_by_its_number() -> None:
    channel = {"kind": "radios", "radios": [{"kind": "ideal"}, {**BLE, "connection": FAST}, BLUETOOTH]}
    told = Field(channel, radios=[0, 1, 2]).told
    assert told.links == (None, 20, 7)
    assert told.payload_bytes == (PayloadBytes(), PayloadBytes(65_532, 1622), PayloadBytes(339, 339))
    assert told.shares == (True, False, True)


def test_a_channel_that_says_nothing_of_it_sets_no_limits() -> None:
    plain = ChannelSpec(*(partial(print),) * 2)  # type: ignore[arg-type]
    assert (plain.links(None), plain.payload_bytes(None), plain.shares(None)) == (None, PayloadBytes(), True)
    assert replace(plain, links=lambda settings: settings).links(3) == 3
