"""Links of Bluetooth, or Low Energy, and a station of 802.11 in one air: what each loses of its packets.

The links are made while the station is silent, all between the same two places. From then on each master has a payload
for its slave at regular times, a packet each, and the station broadcasts frames with pauses that are exponential, or
none. What is counted is what became of the packets with payload, of their answers, and of the station's frames.
"""

import math
from collections.abc import Callable, Mapping
from typing import Any, Final, Literal, NamedTuple

import numpy as np
from pydantic import Field

from cosim.arrays import Floats, Int64s
from cosim.channels.adhoc.settings import AdhocSettings
from cosim.channels.air.band import Section
from cosim.channels.air.spectra import CLASSIC, DSSS, LE_1M, OFDM, OFFSETS, shares
from cosim.channels.ble.bits.errors import noise_mw, received
from cosim.channels.ble.channels import DATA_CHANNELS, frequency_mhz, rf_channel
from cosim.channels.ble.phy import LE_1M as PHY_1M
from cosim.channels.kinds import ChannelSite
from cosim.channels.radios import SPEC, RadiosSettings, with_radio
from cosim.experiment import experiment_function
from cosim.geometry.segments import packed_walls, segment_grid
from cosim.kernel import Kernel
from cosim.machine import BROADCAST, Address, Connected, Fate, LinkEvent, Outgoing, Page, Reception, Scan
from cosim.randomness import Streams
from cosim.settings import Count, Gain, Metres, Rate, Seconds, Settings
from cosim.trace import RECEPTIONS, TRANSMISSIONS, Trace
from cosim.trace import Field as Column
from cosim.units import MS, US, S, Time, from_seconds

NARROW, WIDE = 0, 1
"""Numbers of the radios."""
PERIODS: Final = {"bluetooth": 5 * MS, "ble": 7_500 * US}
"""Times from one payload of a master to the next."""
PAUSE: Final[Time] = 3 * MS
"""Time between packets of a central that are of one event at most."""
CONNECTING: Final[Time] = 40 * S
"""Time for all links to be made, if they are few."""
MAKING: Final[Time] = 2_500 * MS
"""Time for a link to be made, if they are many: one follows the other."""
_STAMP: Final = 8
"""Octets of a payload that say when it was handed over."""
LOSS_AT_1_M_DB: Final = 40.2
CARRIER_TO_INTERFERENCE_DB: Final = 11.0
"""What a signal of Bluetooth needs."""
COLUMNS: Final = (
    Column("narrow_loss", "float", "1", "share of the links' packets with payload that were destroyed"),
    Column("pair_loss", "float", "1", "share of the same that were not received, or whose answers were not"),
    Column("expected_narrow_loss", "float", "1", "narrow_loss by the station's frames and the channels that it ruins"),
    Column("wide_loss", "float", "1", "share of the station's frames that were destroyed"),
    Column("wide_load", "float", "1", "share of the time in which the station sent"),
    Column("wide_mbps", "float", "Mb/s", "payload of the station's frames that were received"),
    Column("ruined", "float", "1", "channels of the links on which the station's frames destroy a packet"),
)


class Parameters(Settings):
    """What the experiment varies."""

    narrow: Literal["bluetooth", "ble"] = Field(default="bluetooth", description="what the links are of")
    packet: Literal["short", "long"] = Field(
        default="short", description="packets of the links: DH1 or 27 octets, DH5 or 251 octets"
    )
    links: Count = Field(default=1, ge=0, le=40, description="number of links, each with a master of its own")
    afh: bool = Field(default=False, description="whether masters of Bluetooth leave out bad channels")
    load: Gain = Field(default=0.5, ge=0, le=1, description="share of the time in which the station means to send")
    phy: Literal["dsss", "erp"] = Field(default="dsss", description="physical layer of the station")
    rate_mbps: Rate = Field(default=11, gt=0, description="Mb/s of the station's frames")
    octets: Count = Field(default=1500, ge=1, le=2000, description="payload of the station's frames")
    link_m: Metres = Field(default=10, gt=0, description="m from the masters to the slaves")
    station_m: Metres = Field(default=14, gt=0, description="m from the slaves to the station, away from the masters")
    hearer_m: Metres = Field(default=1, description="m from the station to who receives it, away from the links")
    aside_m: Metres = Field(default=0, description="m from the line of all these to who receives the station")
    warming_s: Seconds = Field(default=0, ge=0, description="s in which both send before anything is counted")
    duration_s: Seconds = Field(default=10, gt=0, description="s that are counted")


class Layout(NamedTuple):
    """Who is where, with which radios."""

    places: list[tuple[float, float]]
    carried: list[tuple[int, ...]]
    masters: list[Address]
    """Each one's slave is next."""
    station: Address
    """Who receives it is next."""


def along_a_line(given: Parameters) -> Layout:
    """Return the links, all between the same two places, and the station beyond the slaves."""
    links, ends = given.links, -given.station_m - given.hearer_m
    pair, stations = [(given.link_m, 0.0), (0.0, 0.0)], [(-given.station_m, 0.0), (ends, given.aside_m)]
    carried: list[tuple[int, ...]] = [*[(NARROW,)] * (2 * links), *[(WIDE,)] * 2]
    return Layout(pair * links + stations, carried, [*range(0, 2 * links, 2)], 2 * links)


class Host:
    """A host that does what a master, or the station, is told to do when its packet is over."""

    def __init__(self) -> None:
        self.connected = False
        self.delays: list[Time] = []
        """Times from when payloads of a link were handed over to when they were received here."""
        self.over: Callable[[], None] = lambda: None
        """Called when a payload is over."""

    def receive(self, data: bytes, reception: Reception, now: Time) -> None:
        """Take a payload, and note how long one of a link took."""
        if reception.radio == NARROW:
            self.delays.append(now - int.from_bytes(data[:_STAMP], "big"))

    def link(self, event: LinkEvent, now: Time) -> None:
        """Note a link, and go on after a payload."""
        self.connected = self.connected or isinstance(event, Connected)
        if isinstance(event, Fate):
            self.over()

    def drain(self, now: Time) -> None:
        """Do nothing."""


class Sharing:
    """One run, of robots as *layout* has them, in an *air* with such settings."""

    def __init__(self, given: Parameters, seed: int, layout: Layout, air: Mapping[str, Any] | None = None) -> None:
        self.given = given
        self.kernel = Kernel()
        self.trace = Trace(with_radio((TRANSMISSIONS, RECEPTIONS)))
        self.masters, self.station, size = layout.masters, layout.station, len(layout.places)
        self._random = Streams(seed)("coexistence")
        none: tuple[None, ...] = (None,) * size
        grid = segment_grid(np.empty((0, 4)))
        site = ChannelSite(
            *(self.kernel, self.trace, Streams(seed), size, grid, np.empty(0), packed_walls(grid)),
            *(layout.carried, none, none, none),
        )
        radios = [_narrow(given), _wide(given)]
        self.settings = RadiosSettings.model_validate({"air": "shared", "radios": radios, **(air or {})})
        self.channel = SPEC.make(self.settings, site)
        self.hosts = [Host() for _ in range(size)]
        for address, host in enumerate(self.hosts):
            self.channel.attach(address, host)
        self.channel.moved(np.array(layout.places))

    def connect(self) -> None:
        """Make all links, and have nobody look for others any more."""
        made = max(CONNECTING, len(self.masters) * MAKING)
        for master in self.masters:
            self.channel.command(master, Page(master + 1))
            while not self.hosts[master].connected and self.kernel.now < made:
                self.kernel.run(self.kernel.now + S)
        for master in self.masters:
            self.channel.command(master, Scan(False))
            self.channel.command(master + 1, Scan(False))
        self.kernel.run(made)

    def run(self) -> tuple[Time, Time]:
        """Have all send; return from when to when it counts."""
        given, now = self.given, self.kernel.now
        period = PERIODS[given.narrow]
        for master in self.masters:
            self._repeat(master, now + int(self._random.integers(period)), period)
        if given.load:
            station = self.hosts[self.station]
            station.over = self._pause if given.load < 1 else self._broadcast
            for _ in range(1 if given.load < 1 else 3):
                self._broadcast()
        since = now + from_seconds(given.warming_s)
        until = since + from_seconds(given.duration_s)
        for tick in range(now + 100 * MS, until + 1, 100 * MS):
            self.kernel.run(tick)
            self.channel.advance(tick)
        self.channel.close(self.kernel.now)
        return since, until

    def _repeat(self, master: Address, at: Time, period: Time) -> None:
        octets = {("bluetooth", "short"): 27, ("bluetooth", "long"): 339, ("ble", "short"): 20, ("ble", "long"): 244}
        rest = bytes(octets[self.given.narrow, self.given.packet] - _STAMP)

        def send() -> None:
            payload = self.kernel.now.to_bytes(_STAMP, "big") + rest
            self.channel.send(master, Outgoing(master + 1, payload, radio=NARROW))

        def begin() -> None:
            send()
            self.kernel.every(period, send)

        self.kernel.at(at, begin)

    def _pause(self) -> None:
        load = self.given.load
        mean = self.frame_time * (1.0 - load) / load
        self.kernel.after(max(1, int(self._random.exponential(mean))), self._broadcast)

    def _broadcast(self) -> None:
        self.channel.send(self.station, Outgoing(BROADCAST, bytes(self.given.octets), 1, WIDE))

    @property
    def frame_time(self) -> Time:
        """The duration of the station's frames."""
        return int(self.wide.timing().broadcast(self.given.octets).duration)

    @property
    def wide(self) -> AdhocSettings:
        """The settings of the station."""
        settings = self.settings.radios[WIDE]
        assert isinstance(settings, AdhocSettings)
        return settings


def _narrow(given: Parameters) -> dict[str, Any]:
    law = {"propagation": {"reference_loss_db": LOSS_AT_1_M_DB, "walls": False}}
    if given.narrow == "ble":
        connection = {"interval_s": 0.0075, "links": 1, "octets": 27 if given.packet == "short" else 251}
        return {"kind": "ble", "queue_payloads": 4, "connection": connection, "power_dbm": 0.0, **law}
    types = ["DH1" if given.packet == "short" else "DH5"]
    afh = {"afh": given.afh}
    return {"kind": "bluetooth", "power_class": 3, "packet_types": types, "queue_payloads": 4, **afh, **law}


def _wide(given: Parameters) -> dict[str, Any]:
    law = {"propagation": {"reference_loss_db": LOSS_AT_1_M_DB, "walls": False}}
    rates = {"rate_mbps": given.rate_mbps, "basic_rates_mbps": [given.rate_mbps]}
    return {"kind": "adhoc", "phy": given.phy, "channel": 6, "power_dbm": 15.0, **rates, **law}


@experiment_function
def measure(parameters: Mapping[str, Any], seed: int) -> dict[str, float]:
    """Return what was lost in one run, beside what the station's frames let expect."""
    given = Parameters.model_validate(parameters)
    run = Sharing(given, seed, along_a_line(given))
    run.connect()
    told = Told(run, *run.run())
    return {
        **told.narrow(),
        "expected_narrow_loss": told.share_hit() * ruined_by(given) / channels_of(given),
        **told.wide(),
        "ruined": ruined_by(given),
    }


class Told:
    """The tables of a run, of what began in [since, until)."""

    def __init__(self, run: Sharing, since: Time, until: Time) -> None:
        self._run, self._since, self._until = run, since, until
        self._sent, self._heard = (
            {name: np.array(column) for name, column in run.trace.columns(table.name).items() if name != "body"}
            for table in (TRANSMISSIONS, RECEPTIONS)
        )

    def _chosen(self, table: dict[str, Any], radio: int, **wanted: int) -> Any:
        time = table["time_ns"]
        found = (table["radio"] == radio) & (time >= self._since) & (time < self._until)
        for name, value in wanted.items():
            found &= table[name] == value
        return found

    def narrow(self) -> dict[str, float]:
        """Return which share of the packets with payload, and of them or their answers, were lost, by all links.

        Of Bluetooth those count that have not been sent before: hops stay near each other, and who repeats a packet has
        been where it was lost. Of Low Energy the first of each event counts, as an event ends with a loss.
        """
        lost = failed = count = 0
        for master in self._run.masters:
            sent = self._chosen(self._sent, NARROW, source=master) & (self._sent["length"] > 0)
            sent &= self._starts_event(master) if self._run.given.narrow == "ble" else ~self._sent["retry"]
            times, lasts = self._sent["time_ns"][sent], self._sent["duration_ns"][sent]
            right = self._received(master, master + 1, times)
            answers = self._answer_times(times, lasts)
            answered = self._received(master + 1, master, answers)
            lost += int((~right).sum())
            failed += int((~(right & answered)).sum())
            count += len(times)
        if not count:
            return {"narrow_loss": math.nan, "pair_loss": math.nan}
        return {"narrow_loss": lost / count, "pair_loss": failed / count}

    def _starts_event(self, master: Address) -> Any:
        """Return which packets of *master* are the first of their events."""
        mine = (self._sent["radio"] == NARROW) & (self._sent["source"] == master)
        starts = np.zeros(len(mine), np.bool_)
        starts[mine] = np.diff(self._sent["time_ns"][mine], prepend=-S) > PAUSE
        return starts

    def _answer_times(self, times: Int64s, lasts: Int64s) -> Int64s:
        """Return when the answers to packets begin, within a microsecond."""
        if self._run.given.narrow == "ble":
            return np.asarray(times + lasts + 150 * US)
        slots = -(-lasts // (625 * US))
        return np.asarray(times + slots * 625 * US)

    def _received(self, source: Address, receiver: Address, times: Int64s) -> Any:
        """Return which frames of *source* that began at *times*, within a microsecond, *receiver* has received."""
        rows = (self._heard["radio"] == NARROW) & (self._heard["source"] == source)
        rows &= (self._heard["receiver"] == receiver) & (self._heard["outcome"] == "received")
        right = np.sort(self._heard["time_ns"][rows])
        if not len(right):
            return np.zeros(len(times), np.bool_)
        places = np.searchsorted(right, times - US)
        return np.abs(right[np.minimum(places, len(right) - 1)] - times) <= US

    def wide(self) -> dict[str, float]:
        """Return what became of the station's frames."""
        sent = self._chosen(self._sent, WIDE, source=self._run.station)
        heard = self._chosen(self._heard, WIDE, source=self._run.station, receiver=self._run.station + 1)
        right = int((self._heard["outcome"][heard] == "received").sum())
        frames = int(sent.sum())
        seconds = self._run.given.duration_s
        return {
            "wide_loss": 1.0 - right / frames if frames else math.nan,
            "wide_load": float(self._sent["duration_ns"][sent].sum()) / (1e9 * seconds),
            "wide_mbps": 8e-6 * self._run.given.octets * right / seconds,
        }

    def share_hit(self, lasts: Time | None = None) -> float:
        """Return the chance that a packet at a random time overlaps a frame of the station: it lies in no pause.

        It *lasts* as long as one of a link with payload, unless another time is given.
        """
        sent = self._chosen(self._sent, WIDE, source=self._run.station)
        if not sent.any():
            return 0.0
        begins, ends = self._sent["time_ns"][sent], (self._sent["time_ns"] + self._sent["duration_ns"])[sent]
        least = packet_time(self._run.given) if lasts is None else lasts
        free = np.maximum(0, begins[1:] - ends[:-1] - least).sum()
        return float(1.0 - free / (begins[-1] - begins[0]))

    def met(self) -> float:
        """Return how many packets of one other link, on any channel, a packet at a random time overlaps on average."""
        sent = self._chosen(self._sent, NARROW)
        links, time = len(self._run.masters), self._until - self._since
        return float((self._sent["duration_ns"][sent] + packet_time(self._run.given)).sum()) / (links * time)


def packet_time(given: Parameters) -> Time:
    """Return the duration of a packet with payload of a link."""
    micros = {("bluetooth", "short"): 366, ("bluetooth", "long"): 2870, ("ble", "short"): 296, ("ble", "long"): 2088}
    return micros[given.narrow, given.packet] * US


def channels_of(given: Parameters) -> int:
    """Return how many channels the links hop on, without AFH."""
    return 79 if given.narrow == "bluetooth" else DATA_CHANNELS


def ruined_by(given: Parameters) -> float:
    """Return on how many channels a frame of the station destroys a packet that it overlaps from end to end."""
    wide = OFDM if given.phy == "erp" else DSSS
    carrier_dbm = -_loss_db(given.link_m)
    if given.narrow == "bluetooth":
        lost_db = 10 * np.log10(np.maximum(_shares(wide, CLASSIC, 2402, 1, 79), 1e-30))
        taken_dbm = 15.0 - _loss_db(given.station_m) + lost_db
        return float((carrier_dbm - taken_dbm < CARRIER_TO_INTERFERENCE_DB).sum())
    octets = 27 if given.packet == "short" else 251
    power, noise = 10 ** (carrier_dbm / 10), noise_mw(PHY_1M, -99.0)
    ruined = 0.0
    for index in range(DATA_CHANNELS):
        share = _shares(wide, LE_1M, frequency_mhz(rf_channel(index)), 1, 1)[0]
        taken = 10 ** ((15.0 - _loss_db(given.station_m)) / 10) * share
        header, payload = received(PHY_1M, octets, power, noise, [Section(0, PHY_1M.air_time(octets), taken)], 0)
        ruined += 1.0 - header * payload
    return ruined


def _shares(sender: int, receiver: int, first_mhz: int, step_mhz: int, count: int) -> Floats:
    """Return the shares of the station's power that receivers on *count* channels take in."""
    offsets = np.abs(2 * (first_mhz + step_mhz * np.arange(count)) - 2 * 2437)
    return np.where(offsets < OFFSETS, shares()[sender, receiver, np.minimum(offsets, OFFSETS - 1)], 0.0)


def _loss_db(distance_m: float) -> float:
    return LOSS_AT_1_M_DB + 20.0 * math.log10(distance_m)
