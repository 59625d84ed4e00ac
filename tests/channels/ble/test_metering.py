"""What LE radios do, ns by ns: closed forms, packets counted one by one, and the same whenever somebody asks."""

from collections.abc import Iterator
from typing import Any

import pytest

from cosim.channels.ble.advertising import LONGEST_DELAY, Advertiser
from cosim.channels.ble.scanning import ScanWindows
from cosim.channels.clock import NativeClock
from cosim.channels.energy import IDLE, OFF, RECEIVE, SLEEP, TRANSMIT, Use
from cosim.errors import UserError
from cosim.machine import BROADCAST, Scan
from cosim.trace import TRANSMISSIONS
from cosim.units import MS, US, S, Time
from tests.channels.ble import test_oracle_channel, test_resting
from tests.channels.ble.ble_field import Field, News
from tests.oracles.campaign import Seeded
from tests.oracles.le_air import Air, Packet
from tests.oracles.le_cases import KINDS, Power, draw_case

SELDOM = {"interval_s": 10.24, "window_s": 0.0025}
"""Windows that are almost never open."""
INTERVAL = 100 * MS
T_IFS, POLL, LEAD, ADVERTISEMENT = 150 * US, 80 * US, 40 * US, 224 * US
"""The last is the ADV_IND of "robot 0": 8 + 32 + 8 x (2 + 6 + 3 + 9 - 2 + 3) us."""


def used(field: Field, address: int) -> dict[Use, Time]:
    accounts = field.channel.accounts
    assert accounts is not None
    return dict(sorted(accounts.uses(address, field.kernel.now).items()))


def state(field: Field, address: int, wanted: str) -> Time:
    return sum(time for use, time in used(field, address).items() if use.state == wanted)


def starts(advertiser: Advertiser, until: Time) -> Iterator[Time]:
    """Yield when the packets of *advertiser* begin before *until*, event by event from the first one on."""
    local, number = advertiser.first, 0
    assert advertiser.delays is not None
    while (begin := advertiser.clock.at_local(local)) < until:
        yield begin
        for turn in (1, 2):
            yield advertiser.clock.at_local(local + turn * advertiser.spacing)
        local += advertiser.interval + advertiser.delays.below(LONGEST_DELAY + 1, number)
        number += 1


def opened(windows: ScanWindows, until: Time) -> Iterator[tuple[Time, Time]]:
    """Yield the windows that open before *until*, from time 0 on and as far as they have come."""
    clock, opens = windows.clock, windows.offset
    while clock.at_local(opens + windows.window) < 0:
        opens += windows.interval
    while (begin := clock.at_local(opens)) < until:
        yield max(0, begin), min(clock.at_local(opens + windows.window), until)
        opens += windows.interval


@pytest.mark.parametrize("interval_s", [0.02, 0.1, 1.28])
def test_an_advertiser_sends_its_packets_and_listens_after_each(interval_s: float):
    field = Field(1, energy="states", advertise={"interval_s": interval_s}, listen=SELDOM)
    advertiser = field.channel.devices[0].station.beacon.advertiser
    assert advertiser is not None
    field.until(60 * S + 123_457)
    now = field.kernel.now
    packets = [start for start in starts(advertiser, now) if start < now]
    sent = sum(min(ADVERTISEMENT, now - start) for start in packets)
    heard = sum(max(0, min(T_IFS + LEAD, now - start - ADVERTISEMENT)) for start in packets)
    assert 3 * now // from_s(interval_s + 0.01) - 3 <= len(packets) <= 3 * now // from_s(interval_s) + 3
    assert state(field, 0, TRANSMIT) == sent
    assert state(field, 0, RECEIVE) == heard
    busy = [(start, start + ADVERTISEMENT + T_IFS + LEAD) for start in packets]
    assert state(field, 0, IDLE) == sum(
        end - begin - sum(max(0, min(end, over) - max(begin, start)) for start, over in busy)
        for begin, end in opened(field.channel.devices[0].station.windows, now)
    )
    assert sum(used(field, 0).values()) == now


def from_s(seconds: float) -> Time:
    return round(seconds * S)


def test_a_radio_that_always_listens_never_sleeps():
    field = Field(1, energy="nrf52840")
    field.until(30 * S)
    sent, idle, received = (state(field, 0, each) for each in (TRANSMIT, IDLE, RECEIVE))
    assert state(field, 0, SLEEP) == 0
    assert sent + idle + received == 30 * S
    joules = 3.0 * (6.40e-3 * sent + 6.26e-3 * (idle + received)) / S
    assert field.channel.summary()["radio_energy_j"] == pytest.approx(joules, rel=1e-12)


def linked(latency: int, **more: Any) -> Field:
    """Return two devices that do nothing but poll each other, by clocks that do not drift."""
    connection = {"interval_s": INTERVAL / S, "latency": latency, "supervision_s": 8.0}
    field = Field(2, energy="states", connection=connection, listen=SELDOM, clock_ppm=0, **more)
    field.link(0, 1)
    field.do(0, Scan(False))
    field.do(1, Scan(False))
    field.until(11 * S)
    return field


@pytest.mark.parametrize("latency", [0, 4])
def test_a_link_at_rest_costs_its_polls_for_an_hour(latency: int):
    field = linked(latency)
    before = [used(field, address) for address in (0, 1)]
    events = field.kernel.executed
    field.until(field.kernel.now + 3_600 * S)
    polls = 3_600 * S // (INTERVAL)
    answers = polls // (1 + latency)
    widening = 16_000 + -(-(20 + 20) * (1 + latency) * INTERVAL // 1_000_000)
    central, peripheral = (
        {use.state: time - before[address].get(use, 0) for use, time in used(field, address).items()}
        for address in (0, 1)
    )
    assert field.kernel.executed - events < 5  # nothing happens meanwhile
    assert central[TRANSMIT] == polls * POLL
    assert central[RECEIVE] == answers * (T_IFS + POLL) + (polls - answers) * (T_IFS + LEAD)
    assert peripheral[TRANSMIT] == answers * POLL
    assert peripheral[RECEIVE] == answers * (widening + POLL + T_IFS)
    for done in (central, peripheral):
        assert sum(done.values()) == 3_600 * S
        assert 0 < done[IDLE] <= 353 * 2_500 * US < done[SLEEP]


def test_a_peripheral_whose_central_is_gone_listens_until_it_gives_up():
    field = linked(0)
    before = state(field, 1, RECEIVE)
    field.channel.power(0, False)
    while field.kernel.now < 30 * S:  # in the midst of windows, too
        field.until(min(30 * S, field.kernel.now + 9_970 * US))
        used(field, 1)
    listened = state(field, 1, RECEIVE) - before
    most = 8 * S // INTERVAL  # events in a supervision timeout: each is listened for longer than the one before
    widened = [16_000 + 4_000 * event for event in range(1, most + 1)]
    last = widened.pop() + POLL  # the timeout began when a poll had been heard to its end
    assert listened == sum(2 * each + LEAD for each in widened) + last
    assert state(field, 0, OFF) == 30 * S - 11 * S
    assert sum(used(field, 0).values()) == sum(used(field, 1).values()) == 30 * S


@pytest.mark.parametrize("phy", ["1M", "2M", "coded"])
def test_broadcasts_cost_their_packets(phy: str):
    name = "Coded S=8" if phy == "coded" else phy
    field = Field(3, tables=(TRANSMISSIONS,), energy="states", broadcast={"phy": phy})
    for address in range(3):
        field.do(address, Scan(False))
    for number in range(20):
        field.until(number * S + 1)
        field.send(number % 2, BROADCAST, bytes(40 * number))
    field.until(30 * S)
    sent = {each: [0, 0] for each in range(3)}
    told = field.trace.columns(TRANSMISSIONS.name)
    for source, kind, duration in zip(told["source"], told["kind"], told["duration_ns"], strict=True):
        sent[source][kind != "ADV_EXT_IND"] += duration
    for address in range(3):
        uses = used(field, address)
        pointers, carriers = sent[address]
        followed = sum(sent[other][1] for other in range(3) if other != address)
        if phy == "1M":
            assert uses.get(Use(TRANSMIT, "1M"), 0) == pointers + carriers
            assert uses.get(Use(RECEIVE, "1M"), 0) == followed // 3  # the first of three events, heard by all
        else:
            assert uses.get(Use(TRANSMIT, "1M"), 0) == pointers
            assert uses.get(Use(TRANSMIT, name), 0) == carriers
            assert uses.get(Use(RECEIVE, name), 0) == followed // 3
        assert sum(uses.values()) == 30 * S


# ---------------------------------------------------------------- campaigns


def campaign(monkeypatch: pytest.MonkeyPatch, seed: int, idle_frames: bool, asks: bool) -> tuple[list[News], Any]:
    """Run a script of hosts; *asks*: somebody asks for what a device has done now and then."""
    made: list[Field] = []

    class Asked(Field):
        def __init__(self, *arguments: Any, **settings: Any) -> None:
            listen = SELDOM if seed % 2 else {}
            super().__init__(*arguments, energy="states", listen=listen, **settings)
            self.choice = Seeded(seed)
            made.append(self)

        def until(self, time: Time) -> None:
            now = self.kernel.now
            while asks and (now := now + self.choice.integer(1, 300 * MS)) < time:
                super().until(now)
                used(self, self.choice.integer(0, len(self.channel.devices) - 1))
            super().until(time)

    monkeypatch.setattr(test_resting, "Field", Asked)
    news, _ = test_resting.run(seed, idle_frames)
    return news, [used(made[0], address) for address in range(made[0].channel.size)]


@pytest.mark.parametrize("seed", range(4))
def test_polls_that_are_skipped_count_as_those_that_are_sent(monkeypatch: pytest.MonkeyPatch, seed: int):
    news, skipped = campaign(monkeypatch, seed, idle_frames=False, asks=False)
    again, sent = campaign(monkeypatch, seed, idle_frames=True, asks=False)
    assert news == again
    assert skipped == sent
    assert all(sum(uses.values()) == 40 * S for uses in sent)


@pytest.mark.parametrize("step", [7 * MS, 60 * S])
def test_advertisements_that_broadcasts_have_kept_from_the_air_do_not_count(step: Time):
    field = Field(1, energy="states", advertise={"interval_s": 0.02}, tables=(TRANSMISSIONS,))
    for number in range(100):
        field.send(0, BROADCAST, bytes(1_500))
        while field.kernel.now < (number + 1) * 50 * MS:
            field.until(min(field.kernel.now + step, (number + 1) * 50 * MS))
            if step < S:
                used(field, 0)
    field.until(60 * S)
    told = field.trace.columns(TRANSMISSIONS.name)
    whole = state(field, 0, TRANSMIT) - sum(told["duration_ns"])
    beacon = field.channel.devices[0].station.beacon
    assert beacon.advertiser is not None
    due = len([start for start in starts(beacon.advertiser, 60 * S) if start < 60 * S])
    assert whole % ADVERTISEMENT == 0
    assert 50 < due - whole // ADVERTISEMENT < due // 2


@pytest.mark.parametrize("seed", range(4))
def test_to_ask_changes_nothing(monkeypatch: pytest.MonkeyPatch, seed: int):
    assert campaign(monkeypatch, seed, False, asks=True) == campaign(monkeypatch, seed, False, asks=False)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("seed", [3, 4])
def test_radios_send_for_as_long_as_those_of_a_plain_model(monkeypatch: pytest.MonkeyPatch, kind: str, seed: int):
    sent: list[Packet] = []
    fields: list[Field] = []
    put = Air.put

    class Metered(Field):
        def __init__(self, *arguments: Any, **settings: Any) -> None:
            super().__init__(*arguments, energy="states", **settings)
            fields.append(self)

    monkeypatch.setattr(test_oracle_channel, "Field", Metered)
    monkeypatch.setattr(Air, "put", lambda air, packet: (sent.append(packet), put(air, packet)))
    case = draw_case(Seeded(KINDS.index(kind), seed), kind)
    test_oracle_channel.by_channel(case)
    test_oracle_channel.by_oracle(case)
    for address in range(case.size):
        over = [time for time, act in case.script if act == Power(address, False)]
        spans: dict[str, list[tuple[Time, Time]]] = {}
        for packet in sent:
            if packet.source == address:
                end = min([time for time in over if time >= packet.start] + [packet.end, case.until])
                spans.setdefault(packet.phy.name, []).append((packet.start, end))
        found = {use.phy: time for use, time in used(fields[0], address).items() if use.state == TRANSMIT}
        assert found.keys() == spans.keys()
        assert sum(found.values()) == covered([span for each in spans.values() for span in each])
        assert all(length <= covered(spans[phy]) for phy, length in found.items())


def covered(spans: list[tuple[Time, Time]]) -> Time:
    """Return how much time is in at least one of *spans*: a link at rest polls while its end sends to everyone."""
    total, over = 0, -1
    for begin, end in sorted(spans):
        total += max(0, end - max(begin, over))
        over = max(over, end)
    return total


# ---------------------------------------------------------------- parts and windows


@pytest.mark.parametrize(
    ("settings", "complaint"),
    [
        ({"power_dbm": 4.0}, "no published current to transmit on 1M with 4 dBm, but with -40, 0, 8"),
        ({"connection": {"phy": "2M"}}, "no published current to receive on 2M"),
        ({"broadcast": {"phy": "coded"}}, "no published current to receive on Coded S=8"),
    ],
)
def test_no_current_is_guessed(settings: dict[str, Any], complaint: str):
    with pytest.raises(UserError, match=complaint):
        Field(2, energy="nrf52840", **settings)
    Field(2, energy="states", **settings)


@pytest.mark.parametrize("ppm", [-500, -1, 0, 1, 500])
def test_open_time_is_that_of_instants_in_windows(ppm: int):
    windows = ScanWindows(NativeClock(77, ppm), 13, 40, 17)
    for start in range(0, 90, 7):
        for end in range(start, start + 200, 11):
            inside = sum(windows.channel(time) is not None for time in range(start, end))
            assert windows.open_time(start, end) == inside
