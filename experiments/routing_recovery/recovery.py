"""A relay dies while payloads go over it: how long until they take another way, what is lost, what the routers talk."""

import math
from collections.abc import Mapping, Sequence
from functools import partial
from itertools import pairwise
from typing import Any, Final, Literal

import numpy as np
from pydantic import Field

from cosim.channels.adhoc.channel import AdhocChannel
from cosim.channels.adhoc.forwarding import Forwarding
from cosim.channels.adhoc.mac import Packet
from cosim.channels.adhoc.routing.aodv import Aodv
from cosim.channels.adhoc.routing.base import Router
from cosim.channels.adhoc.routing.ip import OLSR_PORT, PAYLOAD_PORT, Datagram, decode
from cosim.channels.adhoc.routing.olsr import Olsr, OlsrSettings
from cosim.channels.adhoc.routing.olsr_wire import HELLO, decode_packet
from cosim.channels.adhoc.settings import AdhocSettings
from cosim.experiment import experiment_function
from cosim.kernel import Kernel
from cosim.machine import BROADCAST, Address, LinkEvent, Outgoing, Reception
from cosim.randomness import Streams
from cosim.settings import Count, Seconds, Settings
from cosim.trace import Field as Column
from cosim.trace import Trace
from cosim.units import MS, S, Time, from_seconds, to_seconds
from experiments.routing_recovery.omniscient import Omniscient, reach

LOOK: Final = 10 * MS
"""Interval between checks whether the death has been noticed."""
GAP: Final = S // 2
"""Time without a payload above which there is an interruption."""
END: Final = 2 * S
"""Time at the end whose payloads are not counted: they may be under way."""
COLUMNS: Final = (
    Column("outage_s", "float", "s", "from the last payload over the old way to the first over another"),
    Column("recovery_s", "float", "s", "from the death to the first payload over another way"),
    Column("steady_s", "float", "s", "from the death to the end of the last gap of more than half a second, if any"),
    Column("noticed_s", "float", "s", "from the death until who sent over the dead relay does so no more, to 10 ms"),
    Column("silence_s", "float", "s", "until then from the last sign of life that its router had of the relay"),
    Column("tries", "float", "1", "payloads that it sent to the dead relay, with what the death found in its station"),
    Column("lost", "float", "1", "payloads, sent from a second before the death on, that never arrived"),
    Column("control_octets_per_s", "float", "octet/s", "of all routers, with IPv4 and UDP headers"),
    Column("frames_per_payload", "float", "1", "on the air, with ACKs and all that routers say"),
)
"""NaN: nothing has come over another way, or no router keeps a table in which the death could be seen."""
SOURCE: Final = 0


def _circle(stations: int, apart_m: float) -> list[tuple[float, float]]:
    """Return places on a circle, neighbours *apart_m* from each other."""
    radius_m = apart_m / (2.0 * math.sin(math.pi / stations))
    turns = [2.0 * math.pi * n / stations for n in range(stations)]
    return [(radius_m * math.cos(turn), radius_m * math.sin(turn)) for turn in turns]


SHAPES: Final = {
    "diamond": ([(0.0, 0.0), (15.0, 8.0), (15.0, -8.0), (30.0, 0.0)], 3),
    "ladder": ([(0.0, 0.0), *((x, y) for x in (15.0, 30.0, 45.0) for y in (6.0, -6.0)), (60.0, 0.0)], 7),
    "ring": (_circle(8, 15.0), 4),
}
"""Places, m, of stations that reach 20 m, and the destination of payloads; robot 0 is the source."""


class Parameters(Settings):
    """Stations, and a death among them."""

    radio: AdhocSettings = Field(description="all alike; without routing an omniscient router does it")
    shape: Literal["diamond", "ladder", "ring"] = Field(default="diamond", description="where stations stand")
    payload_octets: Count = Field(default=100, ge=4, description="octets of every payload")
    interval_s: Seconds = Field(default=0.1, gt=0, description="s from payload to payload")
    settle_s: Seconds = Field(default=30.0, ge=0, description="s that routers have before the first payload")
    before_s: Seconds = Field(default=5.0, ge=1, description="s of payloads, at least, before the death")
    window_s: Seconds = Field(default=10.0, ge=0, description="s, the death comes within it, at a random instant")
    watch_s: Seconds = Field(default=30.0, gt=3, description="s for which the others are watched after it")


# ---------------------------------------------------------------- what is seen


class Observed(AdhocChannel):
    """A channel that records over which stations payloads go, and which have heard which."""

    def __init__(self, given: Parameters, kernel: Kernel, streams: Streams) -> None:
        places_m, self.destination = SHAPES[given.shape]
        self._who = reach(places_m, given.radio.range_m or math.inf)
        self.last_relay: Address | None = None
        """Robot that has handed the last payload to its destination."""
        self.sender_over: dict[Address, Address] = {}
        """Robot that has sent the last payload over each relay."""
        self.sent_to: dict[tuple[Address, Address], int] = {}
        """Number of payloads that each has handed to its station for each neighbour."""
        self.done_with: dict[tuple[Address, Address], int] = {}
        """Number of them that the station is done with: acknowledged, or tried often enough."""
        self.heard_at: dict[tuple[Address, Address], Time] = {}
        """Times at which each router last heard each neighbour."""
        super().__init__(given.radio, kernel, Trace(()), len(places_m), streams)
        self.moved(np.array(places_m))

    def _routers(self, streams: Streams) -> Forwarding | None:
        if self._settings.routing is not None:
            return super()._routers(streams)
        return Forwarding(self.size, lambda robot, now: Omniscient(robot, self._who), self.kernel, self)

    def router(self, address: Address) -> Router:
        """Return the router of a robot."""
        assert self._forwarding is not None
        return self._forwarding.routers[address]

    def power(self, address: Address, on: bool) -> None:
        """Switch a robot off, which omniscient routers know at once."""
        if not on:
            self._who.remove_node(address)
        super().power(address, on)

    def received(self, receivers: Sequence[Address], source: Address, packet: Packet, mw: Sequence[float]) -> None:
        """Record which station was heard, and over which one a payload came."""
        datagram = decode(packet.payload)
        if datagram.port == PAYLOAD_PORT and self.destination in receivers:
            self.last_relay = source
        if self._is_sign_of_life(datagram):
            self.heard_at |= {(address, source): self.kernel.now for address in receivers}
        super().received(receivers, source, packet, mw)

    def _is_sign_of_life(self, datagram: Datagram) -> bool:
        """Return whether a packet prolongs the link to its sender: with OLSR a HELLO, with hysteresis any of OLSR."""
        routing = self._settings.routing
        if not isinstance(routing, OlsrSettings):
            return True
        if datagram.port != OLSR_PORT:
            return False
        return routing.hysteresis or any(message.kind == HELLO for message in decode_packet(datagram.data)[1])

    def transmit(self, address: Address, packet: Packet) -> None:
        """Note to whom a payload goes."""
        if packet.destination != BROADCAST and decode(packet.payload).port == PAYLOAD_PORT:
            link = address, packet.destination
            self.sender_over[packet.destination] = address
            self.sent_to[link] = self.sent_to.get(link, 0) + 1
        super().transmit(address, packet)

    def _queue(self, address: Address, packet: Packet) -> None:
        self._stations.send(address, packet)  # of whose end ``done`` is to hear, whoever else is

    def done(self, address: Address, packet: Packet, acknowledged: bool) -> None:
        """Note what becomes of a payload."""
        if packet.destination != BROADCAST and decode(packet.payload).port == PAYLOAD_PORT:
            link = address, packet.destination
            self.done_with[link] = self.done_with.get(link, 0) + 1
        super().done(address, packet, acknowledged)


class Listener:
    """A host that notes when which payload arrives."""

    def __init__(self) -> None:
        self.arrived: dict[int, Time] = {}

    def receive(self, data: bytes, reception: Reception, now: Time) -> None:
        """Note a payload: the first copy counts."""
        self.arrived.setdefault(int.from_bytes(data[:4], "big"), now)

    def link(self, event: LinkEvent, now: Time) -> None:
        """Do nothing."""

    def drain(self, now: Time) -> None:
        """Do nothing."""


# ---------------------------------------------------------------- a run


class Course:
    """One run: payloads at fixed intervals, a death, and when it is noticed."""

    def __init__(self, given: Parameters, seed: int) -> None:
        self.kernel = Kernel()
        streams = Streams(seed)
        self.channel = Observed(given, self.kernel, streams)
        self.listener = Listener()
        for address in range(self.channel.size):
            self.channel.attach(address, self.listener if address == self.channel.destination else Listener())
        draws = streams("death")
        interval = from_seconds(given.interval_s)
        self.begin: Time = from_seconds(given.settle_s) + int(draws.integers(interval))
        self.death: Time = self.begin + from_seconds(given.before_s + given.window_s * draws.random())
        self.end: Time = self.death + from_seconds(given.watch_s)
        self.sent_at = list(range(self.begin, self.end, interval))
        self.summary_at_begin: Mapping[str, float] = {}
        self.relay: Address | None = None
        self.sender: Address | None = None
        self.noticed: Time | None = None
        self.silence: Time = 0
        self.tries = 0
        for number, time in enumerate(self.sent_at):
            payload = number.to_bytes(4, "big") + bytes(given.payload_octets - 4)
            outgoing = Outgoing(self.channel.destination, payload, None)
            self.kernel.at(time, partial(self.channel.send, SOURCE, outgoing))
        self.kernel.at(self.begin, self._note_begin)
        self.kernel.at(self.death, self._die)

    def _note_begin(self) -> None:
        self.summary_at_begin = self.channel.summary()

    def _die(self) -> None:
        """Switch off the relay that has handed the last payload to its destination."""
        self.relay = self.channel.last_relay
        if self.relay is None or self.relay == SOURCE:
            return
        self.channel.power(self.relay, False)
        self.sender = self.channel.sender_over.get(self.relay)
        if self.sender is not None and self._next_hop() is not None:
            self.tries = -self.channel.done_with.get((self.sender, self.relay), 0)
            self._look()

    def _next_hop(self) -> Address | None:
        """Return over whom the sender before the dead relay would send now; None if it has no way or no table."""
        assert self.sender is not None
        router, destination, now = self.channel.router(self.sender), self.channel.destination, self.kernel.now
        if isinstance(router, Aodv):
            return router.next_hop(destination, now)
        if isinstance(router, Olsr):
            route = router.routes(now).get(destination)
            return None if route is None else route.next_hop
        return None

    def _look(self) -> None:
        assert self.sender is not None
        assert self.relay is not None
        if self._next_hop() == self.relay:
            self.kernel.after(LOOK, self._look)
            return
        self.noticed = self.kernel.now
        self.silence = self.noticed - self.channel.heard_at[self.sender, self.relay]
        self.tries += self.channel.sent_to[self.sender, self.relay]


@experiment_function
def measure(parameters: Mapping[str, Any], seed: int) -> dict[str, float]:
    """Return ``COLUMNS`` of one run."""
    course = Course(Parameters.model_validate(parameters), seed)
    course.kernel.run(course.end)
    arrivals = sorted(course.listener.arrived.values())
    before = [time for time in arrivals if time <= course.death]
    after = [time for time in arrivals if time > course.death]
    known = course.noticed is not None
    summary, seconds = course.channel.summary(), to_seconds(course.end - course.begin)
    grown = {name: summary[name] - course.summary_at_begin.get(name, 0.0) for name in summary}
    return {
        "outage_s": to_seconds(after[0] - before[-1]) if before and after else math.nan,
        "recovery_s": to_seconds(after[0] - course.death) if after else math.nan,
        "steady_s": steady_s(arrivals, course.death, course.end),
        "noticed_s": to_seconds(course.noticed - course.death) if course.noticed is not None else math.nan,
        "silence_s": to_seconds(course.silence) if known else math.nan,
        "tries": float(course.tries) if known else math.nan,
        "lost": float(_lost(course)),
        "control_octets_per_s": grown.get("control_octets", 0.0) / seconds,
        "frames_per_payload": grown["frames_sent"] / len(course.sent_at),
    }


def steady_s(arrivals: Sequence[Time], death: Time, end: Time) -> float:
    """Return when the last gap of more than ``GAP`` in *arrivals*, sorted, has ended, s after the death.

    0 if there is none; NaN if it has not ended until *end*.
    """
    times = [death, *(time for time in arrivals if time > death), end]
    ends = [later for sooner, later in pairwise(times) if later - sooner > GAP]
    if not ends:
        return 0.0
    return math.nan if ends[-1] == end else to_seconds(ends[-1] - death)


def _lost(course: Course) -> int:
    """Return how many payloads, from a second before the death on, have not arrived."""
    counted = [n for n, sent in enumerate(course.sent_at) if course.death - S <= sent < course.end - END]
    return len(set(counted) - set(course.listener.arrived))
