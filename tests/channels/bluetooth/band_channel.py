"""The Bluetooth channel on a scene of the oracle of the whole band: chosen clocks, powers and links; all that comes."""

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from cosim.channels import jamming
from cosim.channels.bluetooth.device import BluetoothChannel
from cosim.channels.bluetooth.settings import BluetoothSettings
from cosim.channels.propagation import PropagationSettings
from cosim.intervals import Interval
from cosim.kernel import WAKE, WORLD, Kernel
from cosim.machine import (
    Address,
    Connected,
    Discovered,
    Fate,
    Flush,
    Inquire,
    InquiryComplete,
    LinkEvent,
    Lost,
    Outgoing,
    Page,
    PageFailed,
    Reception,
    Scan,
    Share,
)
from cosim.trace import FRAMES, INTERVALS, Trace
from cosim.units import TICK, Time
from tests.oracles import band_scene as given
from tests.oracles.band_cases import Case
from tests.oracles.band_scene import News, Scene, Seen, Send

MODES = {"constant": jamming.CONSTANT, "sweeping": jamming.SWEEPING, "pulsed": jamming.PULSED}
LOOKS = 5
"""Parts of a run, between which somebody looks at what devices do."""
REPETITIONS = {1: "R0", 128: "R1", 256: "R2"}


class Outcome(NamedTuple):
    """All that must be equal. Deliveries are (time, source, receiver, payload, broadcast)."""

    frames: list[Seen]
    deliveries: list[tuple[int, int, int, bytes, bool]]
    fates: list[tuple[int, int, int, str]]
    losses: list[tuple[int, int, int]]
    news: list[tuple[Any, ...]]
    intervals: list[tuple[int, int, int, str, str]]
    """(start, device, end, state, detail)"""
    counts: dict[str, int]
    """Packets of connected devices by type, and idle polls."""

    def sort(self) -> "Outcome":
        self.frames.sort(key=lambda row: row[:6])
        for rows in self[1:-1]:
            rows.sort()
        return self


def payload_of(wish: Send) -> bytes:
    """Return a payload that tells its token, if it is long enough for that."""
    return (wish.token.to_bytes(2, "big") * wish.length)[: wish.length]


def outcome_of(case: Case) -> Outcome:
    """Return what the oracle says; a frame that is on the air at the end has no outcome."""
    scene, book = case.scene, case.book(watched=True)
    payloads = {wish.token: payload_of(wish) for wish in scene.inputs if isinstance(wish, Send)}
    return Outcome(
        [row for row in book.seen + case.idle * book.idle if row.start + row.duration < scene.end],
        [(time, source, receiver, payloads[token], all_) for time, source, receiver, token, all_ in book.deliveries],
        [tuple(row) for row in book.verdicts],
        [tuple(row) for row in book.losses],
        [tuple(row) for row in book.news],
        book.intervals,
        {name: count for name, count in book.counts.items() if count},
    ).sort()


class FixedSettings(BluetoothSettings):
    """Settings with the noise as a scene has it."""

    fixed_noise_dbm: float | None = None

    @property
    def noise_dbm(self) -> float:
        return float("-inf") if self.fixed_noise_dbm is None else self.fixed_noise_dbm


class Numbers:
    """A generator that returns what it was given."""

    def __init__(self, *numbers: int) -> None:
        self._numbers = list(numbers)

    def integers(self, *bounds: int) -> int:
        return self._numbers.pop(0)


class BackOff:
    """Back-offs of a case."""

    def __init__(self, case: Case, device: int) -> None:
        self.case, self.device = case, device

    def below(self, bound: int, number: int, link: int = 0, purpose: int = 0) -> int:
        return self.case.backoff(self.device, bound, number, link, purpose)


class Key(NamedTuple):
    """A stream of which only the key is asked for."""

    key: tuple[int, int]


class Chosen:
    """Streams that give each device the clock, the address and the windows of a case."""

    def __init__(self, case: Case) -> None:
        self.case = case

    def __call__(self, *names: str | int) -> Any:
        _, purpose, device = names
        body = self.case.scene.bodies[int(device)]
        if purpose == "device":
            return Numbers(body.phase, body.ppm, body.word)
        assert purpose == "windows"
        assert body.inquiry_scan is not None
        return Numbers(body.inquiry_scan.offset)

    def draws(self, *names: str | int) -> Any:
        if names[1] == "backoff":
            return BackOff(self.case, int(names[2]))
        return Key(self.case.scene.radio.key)


class Host:
    """An endpoint that writes down what it gets."""

    def __init__(self, address: Address, outcome: Outcome) -> None:
        self.address, self.outcome = address, outcome

    def receive(self, data: bytes, reception: Reception, now: Time) -> None:
        self.outcome.deliveries.append((now, reception.source, self.address, data, reception.broadcast))

    def link(self, event: LinkEvent, now: Time) -> None:
        def news(what: str, peer: int = -1, offset: int = 0) -> None:
            self.outcome.news.append(tuple(News(now, self.address, what, peer, offset)))

        match event:
            case Fate(token, outcome):
                self.outcome.fates.append((now, self.address, token, outcome.value))
            case Lost(peer):
                self.outcome.losses.append((now, self.address, peer))
            case Discovered(peer, offset):
                news("discovered", peer, offset)
            case InquiryComplete():
                news("complete")
            case Connected(peer, role):
                news(role.value, peer)
            case PageFailed(peer):
                news("page failed", peer)

    def drain(self, now: Time) -> None:
        pass


def settings_of(scene: Scene, idle: bool) -> BluetoothSettings:
    inquiry, page = scene.bodies[0].inquiry_scan, scene.bodies[0].page_scan
    assert inquiry is not None
    assert page is not None
    noise = scene.radio.noise_dbm
    return FixedSettings.model_validate(
        {
            "propagation": None if noise is None else PropagationSettings(),
            "fixed_noise_dbm": noise,
            "interference": scene.radio.mode,
            "packet_types": scene.kinds,
            "n_bc": scene.n_bc,
            "t_poll_slots": scene.t_poll,
            "supervision_s": scene.supervision / 1e9,
            "clock_ppm": 250,
            "inquiry": {"n_inquiry": scene.n_inquiry, "first_train": scene.first_train},
            "inquiry_scan": {
                "version": inquiry.version,
                "interval_s": inquiry.interval * 312.5e-6,
                "interlaced": inquiry.interlaced,
            },
            "page": {"mode": REPETITIONS[scene.repetitions], "timeout_slots": scene.page_timeout // 2},
            "page_scan": {"interval_s": page.interval * 312.5e-6, "interlaced": page.interlaced},
            "idle_frames": idle,
            "host_bps": scene.host_bps,
            "receive_payloads": scene.room,
        }
    )


def run_channel(
    case: Case, model: Callable[..., BluetoothChannel] = BluetoothChannel, trace: Trace | None = None
) -> Outcome:
    """Run the channel, or a *model* of it, on the case; *trace* wants frames and intervals, if not more."""
    scene = case.scene
    kernel, trace = Kernel(), trace or Trace((FRAMES, INTERVALS))
    outcome = Outcome([], [], [], [], [], [], {})
    channel = model(settings_of(scene, case.idle), kernel, trace, len(scene.bodies), Chosen(case))
    for address, body in enumerate(scene.bodies):
        channel.attach(address, Host(address, outcome))
        channel.devices[address].inquiry_scanner.n = body.inquiry_scan.n if body.inquiry_scan else 0
    jam(channel, scene)
    for time in power_changes(scene):
        kernel.at(time, partial(set_powers, channel, scene, time), WORLD)
    for wish in scene.inputs:
        kernel.at(wish.time, partial(act, kernel, channel, wish), WAKE)
    looks: list[Interval] = []
    for part in range(1, LOOKS):  # who watches the run changes nothing, and sees parts of its rows
        kernel.at(scene.end * part // LOOKS, lambda: looks.extend(channel.under_way(kernel.now)), WORLD)
    kernel.run(scene.end)
    channel.air.advance(scene.end)
    channel.close(scene.end)
    for start, device, end, _, state, detail in zip(*trace.columns("intervals").values(), strict=True):
        outcome.intervals.append((start, device, end, state, detail))
    ends = {(start, device, *what): end for start, device, end, *what in outcome.intervals}
    for start, device, now, _, *what in looks:
        assert ends.get((start, device, *what), -1) >= now, (start, device, now, what)
    columns = trace.columns("frames")
    for start, source, to, air, kind, channel_, lt_addr, _, heard, part in zip(*columns.values(), strict=True):
        if start + air < scene.end:
            outcome.frames.append(Seen(start, air, kind, source, to, channel_, lt_addr, heard, part or None))
    for device in channel.devices:
        for name, count in device.master_of.counts().items():
            if count:
                outcome.counts[name] = outcome.counts.get(name, 0) + count
    return outcome.sort()


def act(kernel: Kernel, channel: BluetoothChannel, wish: given.Input) -> None:
    """Do what a host does now."""
    devices = channel.devices
    match wish:
        case given.Join(_, master, slave, lt_addr, due):
            piconet = devices[master].master_of
            devices[slave].masters[master] = piconet
            piconet.add_slave(slave, lt_addr, due)
            devices[slave].linked(master)
            devices[master].linked(master)
        case Send(_, source, destination, _, token):
            channel.send(source, Outgoing(destination, payload_of(wish), token))
        case given.Flush(_, source, destination):
            channel.command(source, Flush(destination))
        case given.Suspend(_, master, until):
            devices[master].master_of.suspend()
            kernel.at(until, devices[master].master_of.resume, WAKE)
        case given.Share(_, device, period, parts, reference):
            channel.command(device, Share(period, parts, reference))
        case given.Scan(_, device, enabled):
            channel.command(device, Scan(enabled))
        case given.Inquire(_, device, duration, enough):
            channel.command(device, Inquire(duration * TICK, enough))
        case given.PageFor(_, device, peer, offset):
            channel.command(device, Page(peer, offset))


# ---------------------------------------------------------------- powers


def power_changes(scene: Scene) -> list[Time]:
    times = {time for time, _ in scene.radio.powers} | {time for time, _, _ in scene.radio.switches}
    return sorted(time for time in times if time < scene.end)


def jam(channel: BluetoothChannel, scene: Scene) -> None:
    """Have the scene's jammers on the air."""
    jammers = [
        jamming.Jammer(0.0, 0.0, 0.0, j.channels, MODES[j.mode], j.dwell, j.on, j.period, j.start, j.until)
        for j in scene.radio.jammers
    ]
    if jammers:
        channel.air.set_jammers(jammers, 0)


def set_powers(channel: BluetoothChannel, scene: Scene, now: Time) -> None:
    """Set the powers of *now*, nothing from and to radios that are off."""
    size = len(scene.bodies)
    matrix = np.array([rows for time, rows in scene.radio.powers if time <= now][-1])
    for time, device, on in scene.radio.switches:
        if time <= now and not on:
            again = [when for when, which, _ in scene.radio.switches if which == device and when > time]
            if all(when > now for when in again):
                matrix[device, :] = -np.inf
                matrix[:, device] = -np.inf
    channel.air.set_powers(matrix[:size], now)
    if scene.radio.jammers:
        channel.air.set_jam_powers(matrix[size:], now)
