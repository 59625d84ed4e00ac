"""What Bluetooth radios do, ns by ns: against a plain model that has the tables of a run, and closed forms."""

from collections import Counter, defaultdict
from collections.abc import Callable, Iterator
from functools import partial
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
import pytest

from cosim.channels.bluetooth.device import BluetoothChannel
from cosim.channels.bluetooth.packets import ACL, PACKETS
from cosim.channels.bluetooth.reporting import metering
from cosim.channels.bluetooth.scanning import sent_ids
from cosim.channels.bluetooth.settings import BluetoothSettings
from cosim.channels.clock import NativeClock
from cosim.channels.energy import IDLE, OFF, RECEIVE, SLEEP, TRANSMIT
from cosim.intervals import Interval, robot_said, said
from cosim.kernel import WORLD
from cosim.machine import (
    BROADCAST,
    Address,
    Disconnect,
    Hold,
    Inquire,
    LinkCommand,
    Outgoing,
    Page,
    Park,
    Scan,
    Share,
    Sniff,
    SwitchRole,
    Unpark,
)
from cosim.trace import INTERVALS, RECEPTIONS, TRANSMISSIONS, Trace
from cosim.units import MS, SLOT, US, S, Time
from tests.channels.air.shared_field import SharedField
from tests.channels.bluetooth.bluetooth_world import World
from tests.oracles.campaign import Choice, Seeded, chance, pick
from tests.tiers import soak_count

TABLES = (INTERVALS, TRANSMISSIONS, RECEPTIONS)
ID, POLL = 68 * US, 126 * US
RANGE_M = 20.0


def used(channel: BluetoothChannel, device: Address, now: Time) -> dict[str, Time]:
    assert channel.accounts is not None
    return {use.state: time for use, time in channel.accounts.uses(device, now).items()}


# ---------------------------------------------------------------- the plain model

PRIORITY = (OFF, TRANSMIT, RECEIVE, "scan", "reserved", "slot")
"""What goes before what; reserved slots are slept through, scans and slots are idle."""
MEANS = {"scan": IDLE, "reserved": SLEEP, "slot": IDLE}
LISTENING = ("inquiry_scan", "page_scan", "inquiry_response", "page_response")
NOT_HEARD = ("out_of_range", "not_tuned", "busy")


class Packet(NamedTuple):
    """A row of transmissions."""

    start: Time
    source: Address
    kind: str
    destination: Address
    duration: Time

    @property
    def slots(self) -> int:
        return PACKETS[self.kind].slots


class Plain:
    """What radios have done, by the tables of a run that is over at *now*; *reach* tells who gets whom at a time."""

    def __init__(
        self,
        trace: Trace,
        clocks: list[NativeClock],
        settings: BluetoothSettings,
        now: Time,
        reach: Callable[[Address, Address, Time], bool],
        radio: int | None = None,
    ) -> None:
        self.clocks, self.settings, self.now, self.reach = clocks, settings, now, reach
        self.longest = max(ACL[name].slots for name in settings.packet_types)
        self.rows: dict[tuple[Address, str], list[Interval]] = defaultdict(list)
        for row in rows_of(trace, "intervals", radio):
            interval = Interval(*(row[name] for name in ("start_ns", "robot", "end_ns", "radio", "state", "detail")))
            self.rows[interval.robot, interval.state].append(interval)
        self.packets = [
            Packet(*(row[name] for name in ("time_ns", "source", "kind", "destination", "duration_ns")))
            for row in rows_of(trace, "transmissions", radio)
        ]
        answers = {(packet.start, packet.source) for packet in self.packets if packet.kind == "FHS"}
        self.heard: dict[tuple[Time, Address, Address], str] = {}
        self.silences: dict[Address, list[tuple[Time, Time]]] = defaultdict(list)
        for row in rows_of(trace, "receptions", radio):
            start, source, receiver, outcome = (row[name] for name in ("time_ns", "source", "receiver", "outcome"))
            self.heard[start, source, receiver] = outcome
            if (start, source) in answers and (outcome == "received" or row["part"] in ("header", "payload")):
                self.silences[receiver].append((start, start + 366 * US))
        self.spans: dict[Address, list[tuple[Time, Time, str]]] = defaultdict(list)
        for device in range(len(clocks)):
            self.alone(device)
            self.attend(device)
        for packet in self.packets:
            self.on_air(packet)

    def within(self, device: Address, state: str, time: Time, **words: Address) -> Interval | None:
        """Return the interval of *device* at *time* that says that."""
        for row in self.rows[device, state]:
            if row.start <= time < row.end and all(robot_said(row.detail, w) == v for w, v in words.items()):
                return row
        return None

    # ------------------------------------------------------------ what a device does by itself

    def alone(self, device: Address) -> None:
        spans, clock = self.spans[device], self.clocks[device]
        spans += [(row.start, row.end, OFF) for row in self.rows[device, "off"]]
        spans += [(row.start, row.end, "scan") for state in LISTENING for row in self.rows[device, state]]
        for state in ("inquiry", "page"):
            for row in self.rows[device, state]:
                silences = self.silences[device] if state == "inquiry" else ()
                starts, _ = sent_ids(row, row.start, row.end, silences)
                spans += [(start, start + ID, TRANSMIT) for start in starts.tolist()]
                for tick in range(clock.tick(row.start) - 4, clock.tick(row.end) + 4):
                    if tick % 4 == 2:
                        begin, end = max(clock.time_of(tick), row.start), min(clock.time_of(tick + 2), row.end)
                        spans += [(begin, end, "scan")] if begin < end else []

    # ------------------------------------------------------------ slots

    def attend(self, device: Address) -> None:
        """Have a slave listen at each slot of its master that concerns it."""
        for state in ("slave", "park"):
            for row in self.rows[device, state]:
                master = robot_said(row.detail, "master")
                if master < 0:
                    continue
                clock = self.clocks[master]
                for tick in range(clock.tick(row.start) - 4, clock.tick(row.end) + 4):
                    start = clock.time_of(tick)
                    if tick % 4 == 0 and row.start <= start < row.end and self.listens(device, master, tick, start):
                        self.spans[device].append((start, start + ID, "slot"))

    def listens(self, device: Address, master: Address, tick: int, start: Time) -> bool:
        """Return whether *device* listens to *master* in the slot of that *tick*."""
        at = partial(self.within, device, time=start, master=master)
        if at("away") or at("hold"):
            return False
        if at("park"):
            return tick % (2 * self.settings.park_interval_slots) < 2 * self.settings.park_window_slots
        if not at("slave"):
            return False
        sniff, part = at("sniff"), at("part_time")
        if sniff:
            interval, offset, attempt = numbers(sniff, "interval_slots", "offset_slots", "attempt_slots")
            if (tick // 2 - offset) % interval >= attempt:
                return False
        if part:
            names = "interval_slots", "offset_slots", "attempt_slots", "phase_ns", "ppm"
            interval, offset, attempt, phase, ppm = numbers(part, *names)
            into = (NativeClock(phase, ppm).tick(start) - 2 * offset) % (2 * interval)
            return into + 2 * (1 + self.longest) <= 2 * attempt
        return True

    # ------------------------------------------------------------ frames

    def on_air(self, packet: Packet) -> None:
        start, source, kind, destination, duration = packet
        self.spans[source].append((start, start + duration, TRANSMIT))
        for receiver in range(len(self.clocks)):
            outcome = self.heard.get((start, source, receiver))
            if outcome is not None and outcome not in NOT_HEARD:
                self.spans[receiver].append((start, start + duration, RECEIVE))
        paging = self.within(source, "page_response", start)
        if kind in ("ID", "FHS") or (paging and said(paging.detail, "role") == "master"):
            return
        if destination == BROADCAST or self.within(source, "master", start, slave=destination):
            self.asks(packet)
        else:
            self.reserve(packet, source, destination)

    def reserve(self, packet: Packet, device: Address, master: Address) -> None:
        """Have *device* sleep at slots that a packet in the piconet of *master* has reserved."""
        clock = self.clocks[master]
        if packet.slots > 1:
            over = clock.time_of(clock.tick(packet.start) + 2 * packet.slots)
            self.spans[device].append((packet.start, over, "reserved"))

    def asks(self, packet: Packet) -> None:
        start, master, _, destination, duration = packet
        tick = self.clocks[master].tick(start)
        if destination != BROADCAST:
            answer = self.clocks[master].time_of(tick + 2 * packet.slots)
            self.spans[master].append((answer, answer + ID, "scan"))
        for device in range(len(self.clocks)):
            member = self.within(device, "slave", start, master=master) or self.within(
                device, "park", start, master=master
            )
            if member and self.reach(master, device, start) and self.listens(device, master, tick, start):
                meant = destination in (device, BROADCAST)
                self.spans[device].append((start, start + (duration if meant else POLL), RECEIVE))
                self.reserve(packet, device, master)

    # ------------------------------------------------------------ sums

    def uses(self, device: Address) -> dict[str, Time]:
        """Go through time from one change to the next."""
        changes: dict[Time, list[tuple[str, int]]] = defaultdict(list)
        changes[0], changes[self.now] = [], []
        for begin, end, what in self.spans[device]:
            changes[max(begin, 0)].append((what, 1))
            changes[max(end, 0)].append((what, -1))
        under_way: Counter[str] = Counter()
        times: Counter[str] = Counter()
        for at, following in pairwise(sorted(changes)):
            for what, more in changes[at]:
                under_way[what] += more
            doing = next((what for what in PRIORITY if under_way[what]), SLEEP)
            times[MEANS.get(doing, doing)] += max(0, min(following, self.now) - at)
        return {state: time for state, time in times.items() if time}


def rows_of(trace: Trace, name: str, radio: int | None) -> Iterator[dict[str, Any]]:
    columns = trace.columns(name)
    for values in zip(*columns.values(), strict=True):
        row = dict(zip(columns, values, strict=True))
        if radio is None or row["radio"] == radio:
            yield row


def numbers(row: Interval, *names: str) -> list[int]:
    return [int(said(row.detail, name)) for name in names]


# ---------------------------------------------------------------- random runs

SIZE = 4
LASTS: Time = 5 * S
PARTS = ((0, 0, 30), (1, 30, 34))
KINDS = (("DM1", "DH5"), ("DM1", "DH1", "DM3", "DH3", "DM5", "DH5"), ("DH1",), ("DM5",))


def settings_of(choice: Choice) -> dict[str, Any]:
    version = pick(choice, ("1.1", "1.2"))
    return {
        "range_m": RANGE_M,
        "t_poll_slots": pick(choice, (16, 40, 100)),
        "scheduler": pick(choice, ("lazy", "lazy", "round_robin", "exhaustive")),
        "packet_types": pick(choice, KINDS),
        "interference": pick(choice, ("none", "co_channel", "neighbouring")),
        "n_bc": choice.integer(1, 2),
        "supervision_s": pick(choice, (1.0, 3.0)),
        "clock_ppm": pick(choice, (0, 20, 250)),
        "park_interval_slots": 256,
        "park_window_slots": 32,
        "inquiry": {"n_inquiry": pick(choice, (1, 16))},
        "inquiry_scan": {"interval_s": pick(choice, (0.01125, 0.32)), "version": version},
        "page": {"mode": pick(choice, ("R0", "R1")), "timeout_slots": 2048},
        "page_scan": {"interval_s": pick(choice, (0.01125, 0.16)), "interlaced": False},
    }


def wish_of(choice: Choice, device: Address, parks: bool) -> LinkCommand | Outgoing:
    """Draw what a host asks for: it need not be possible. Who *parks* does not divide its time."""
    peer = (device + choice.integer(1, SIZE - 1)) % SIZE
    parts = ((), PARTS, PARTS[:1], ((device, 3, 40), (peer, 43, 20)))
    wishes: tuple[Callable[[], LinkCommand | Outgoing], ...] = (
        *(3 * (lambda: Page(peer),)),
        lambda: Inquire(choice.integer(1, 600) * MS, 3),
        lambda: Scan(not chance(choice, 4)),
        lambda: Hold(peer, choice.integer(1, 400)),
        lambda: Sniff(peer, *pick(choice, ((40, 4, 8), (100, 0, 2), (200, 30, 20), (0, 0, 0)))),
        lambda: Park(peer) if parks else Share(64, pick(choice, parts), choice.integer(0, SIZE - 1)),
        lambda: Unpark(peer),
        lambda: SwitchRole(peer),
        lambda: Disconnect(peer),
        *(6 * (lambda: Outgoing(pick(choice, (peer, peer, BROADCAST)), bytes(choice.integer(1, 300))),)),
    )
    return pick(choice, wishes)()


def places_at(moves: list[tuple[Time, Any]], time: Time) -> Any:
    return next(places for since, places in reversed(moves) if since <= time)


class Run:
    """A random run; *asks*: somebody asks now and then for what a device has done."""

    def __init__(self, seed: int, asks: bool = False, **more: Any) -> None:
        choice = Seeded(28, seed)
        self.world = world = World(SIZE, seed=seed, **({"energy": "states"} | settings_of(choice) | more))
        self.moves: list[tuple[Time, Any]] = []
        self.move([(0.0, 0.0)] * SIZE)
        for device in (1, 2):  # so that all modes have links to be of
            world.at(0, partial(world.command, device, Scan(True)))
            world.at(0, partial(world.command, 0, Page(device)))
        for _ in range(90):
            at, device = choice.integer(0, LASTS - 500 * MS), choice.integer(0, SIZE - 1)
            wish = wish_of(choice, device, seed % 2 == 0)
            at = max(at, S // 2) if isinstance(wish, Disconnect | Park | Share) else at
            world.at(at, partial(self.act, device, wish))
        for _ in range(choice.integer(0, 3)):
            at, device = choice.integer(S, LASTS - S), choice.integer(0, SIZE - 1)
            world.at(at, partial(world.channel.power, device, False), WORLD)
            world.at(at + choice.integer(1, S // 2), partial(world.channel.power, device, True), WORLD)
        for _ in range(choice.integer(0, 6)):
            places = [(float(choice.integer(0, 22)), 0.0) for _ in range(SIZE)]
            world.at(choice.integer(0, LASTS - S), partial(self.move, places), WORLD)
        for device in range(SIZE):  # nothing is on the air at the end
            world.at(LASTS - 10 * MS, partial(world.channel.power, device, False), WORLD)
        asked = Seeded(29, seed)
        while asks and world.kernel.now < LASTS:
            world.kernel.run(min(LASTS, world.kernel.now + asked.integer(1, 50 * MS)))
            used(world.channel, asked.integer(0, SIZE - 1), world.kernel.now)
        world.kernel.run(LASTS)
        world.channel.advance(LASTS)
        if "energy" not in more:
            self.used = [used(world.channel, device, LASTS) for device in range(SIZE)]
        world.channel.close(LASTS)

    def act(self, device: Address, wish: LinkCommand | Outgoing) -> None:
        """Have a host do that; but who is away when it is parked is not: the table does not tell that it still is."""
        if isinstance(wish, Outgoing):
            self.world.channel.send(device, wish)
        elif not isinstance(wish, Park) or not self.busy(device, wish.peer):
            self.world.command(device, wish)

    def busy(self, *devices: Address) -> bool:
        """Return whether one of *devices* may be away from one of its piconets."""
        each = [self.world.channel.devices[device] for device in devices]
        return any(not one.idle or len(one.masters) + bool(one.master_of.members()) > 1 for one in each)

    def move(self, places: list[tuple[float, float]]) -> None:
        self.moves.append((self.world.kernel.now, places))
        self.world.channel.moved(np.array(places))

    def reach(self, one: Address, other: Address, time: Time) -> bool:
        (a, _), (b, _) = (places_at(self.moves, time)[device] for device in (one, other))
        return bool(abs(a - b) <= RANGE_M)

    @property
    def news(self) -> list[Any]:
        return [(host.events, host.received) for host in self.world.hosts]

    def plain(self) -> Plain:
        world = self.world
        clocks = [device.identity.clock for device in world.channel.devices]
        return Plain(world.trace, clocks, world.channel.settings, LASTS, self.reach)


@pytest.mark.parametrize("seed", [0, 1, 3, 4, 7, 12])
def test_radios_do_what_a_plain_model_says_that_has_the_tables(seed: int):
    compare(seed)


@pytest.mark.soak
def test_radios_do_what_a_plain_model_says_in_many_runs(record_property: Callable[[str, object], None]):
    count = soak_count(200)
    seen: Counter[str] = Counter()
    for seed in range(100, 100 + count):
        seen.update(compare(seed))
    assert all(seen[state] for state in (*MEMBERS, *LISTENING, "inquiry", "page", "off")), seen
    record_property("equal runs of Bluetooth's meter", count)


MEMBERS = ("master", "slave", "away", "part_time", "hold", "sniff", "park")


def compare(seed: int) -> set[str]:
    """Compare one run, and return the states that its devices were in."""
    run = Run(seed, tables=TABLES, idle_frames=True)
    plain = run.plain()
    assert run.used == [plain.uses(device) for device in range(SIZE)], seed
    assert all(sum(times.values()) == LASTS for times in run.used)
    return {state for _, state in plain.rows}


@pytest.mark.parametrize("seed", [2, 3])
def test_neither_who_asks_nor_tables_change_what_is_counted_nor_that_it_is_counted_what_happens(
    seed: int, monkeypatch: pytest.MonkeyPatch
):
    told = Run(seed, tables=TABLES, idle_frames=True)
    monkeypatch.setattr(metering, "_AT_ONCE", 100 * MS)
    asked = Run(seed, asks=True, tables=())
    without = Run(seed, tables=(), energy=None)
    assert told.used == asked.used
    assert told.news == asked.news == without.news
    assert asked.world.kernel.executed == without.world.kernel.executed
    assert without.world.channel.summary().items() <= asked.world.channel.summary().items()
    assert without.world.channel.accounts is None


# ---------------------------------------------------------------- an air that others share


def test_radios_in_a_shared_air_do_what_the_plain_model_says():
    classic = {"kind": "bluetooth", "energy": "states", "idle_frames": True, "t_poll_slots": 16}
    wifi = {"kind": "adhoc", "channel": 6}
    tables = (INTERVALS, TRANSMISSIONS, RECEPTIONS)
    places = [(0.0, 0.0), (4.0, 0.0), (2.0, 3.0), (1.0, 1.0)]
    field = SharedField([classic, wifi], places, [(0,), (0,), (0, 1), (0, 1)], tables)
    field.at(MS, 0, Inquire(S, 3), Page(1), Page(2))
    choice = Seeded(30)
    for _ in range(60):
        at = choice.integer(3 * S, 4 * S - 200 * MS)
        field.at(at, 0, Outgoing(pick(choice, (1, 2, BROADCAST)), bytes(choice.integer(1, 300))))
        field.at(at, 2, Outgoing(3, bytes(choice.integer(1, 1500)), None, 1))
    part = field.channel.parts[0]
    assert isinstance(part, BluetoothChannel)
    for device in range(4):
        field.kernel.at(4 * S - 10 * MS, partial(part.power, device, False), WORLD)
    field.until(4 * S)
    field.channel.advance(4 * S)
    mine = [used(part, device, 4 * S) for device in range(4)]
    field.channel.close(4 * S)
    clocks = [device.identity.clock for device in part.devices]
    plain = Plain(field.trace, clocks, part.settings, 4 * S, lambda *_: True, radio=0)
    assert mine == [plain.uses(device) for device in range(4)]
    assert {"collided", "received"} <= set(plain.heard.values())
    assert len([packet for packet in plain.packets if packet.kind in ACL]) > 50


# ---------------------------------------------------------------- closed forms


def linked(**settings: Any) -> World:
    """Return a master 0 and a slave 1 that do nothing but poll, and clocks that do not drift."""
    world = World(2, tables=(), energy="states", clock_ppm=0, **settings)
    world.command(0, Scan(False))
    world.connect(1)
    world.command(1, Scan(False))
    world.kernel.run(30 * S)
    return world


def of_an_hour(world: World) -> list[dict[str, Time]]:
    channel, since = world.channel, world.kernel.now
    before = [used(channel, device, since) for device in (0, 1)]
    executed = world.kernel.executed
    world.kernel.run(since + 3_600 * S)
    assert world.kernel.executed - executed < 400  # of supervision
    after = [used(channel, device, world.kernel.now) for device in (0, 1)]
    return [{state: time - b.get(state, 0) for state, time in a.items()} for a, b in zip(after, before, strict=True)]


def test_an_idle_link_costs_its_polls_and_a_look_at_every_slot_of_the_master():
    master, slave = of_an_hour(linked(t_poll_slots=40))
    polls, slots = 3_600 * S // (40 * SLOT), 3_600 * S // (2 * SLOT)
    assert master[TRANSMIT] == master[RECEIVE] == slave[TRANSMIT] == slave[RECEIVE] == polls * POLL
    assert master[IDLE] == 0
    assert slave[IDLE] == (slots - polls) * ID
    assert [sum(each.values()) for each in (master, slave)] == [3_600 * S] * 2


def test_sniff_mode_costs_its_windows():
    world = linked(t_poll_slots=40)
    world.command(0, Sniff(1, 400, 0, 8))
    world.kernel.run(31 * S)
    _, slave = of_an_hour(world)
    windows = 3_600 * S // (400 * SLOT)
    assert slave[TRANSMIT] == slave[RECEIVE] == windows * POLL  # what is due waits for the window
    assert slave[IDLE] == windows * (4 - 1) * ID


def test_a_slave_that_divides_its_time_looks_at_slots_with_room_for_a_packet_and_the_longest_answer():
    world = linked(t_poll_slots=40, packet_types=["DH1"])
    world.command(1, Share(64, ((0, 0, 30),), 0))
    world.kernel.run(31 * S)
    _, slave = of_an_hour(world)
    periods, polls = 3_600 * S // (64 * SLOT), slave[RECEIVE] // POLL
    assert 0 < polls <= 3_600 * S // (40 * SLOT)
    assert slave[IDLE] == (15 * periods - polls) * ID


def test_scans_and_an_inquiry_that_nobody_hears_cost_what_the_specification_says():
    world = World(2, tables=(), energy="states", clock_ppm=0, range_m=1.0)
    world.channel.moved(np.array([(0.0, 0.0), (5.0, 0.0)]))
    world.command(0, Inquire(1_280 * MS, 1))
    world.kernel.run(128 * S)
    inquirer, scanner = (used(world.channel, device, 128 * S) for device in (0, 1))
    assert scanner == {IDLE: 2 * 100 * 11_250 * US, SLEEP: 128 * S - 2 * 100 * 11_250 * US}
    assert inquirer[TRANSMIT] == 1024 * 2 * ID
    windows = 2 * 99 * 11_250 * US
    assert 1024 * SLOT + windows <= inquirer[IDLE] <= 1024 * SLOT + windows + 2 * 11_250 * US
    assert sum(inquirer.values()) == 128 * S
