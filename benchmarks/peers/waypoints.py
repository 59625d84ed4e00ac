"""Robots that walk to random points and send a payload a second each, over 802.11b or a disc.

    python -m benchmarks.peers.waypoints --nodes=500 --side=1118 --seconds=60 --routing=aodv --seed=1

Equal to ``ns3_waypoints.cc`` and ``gradysim_waypoints.py`` as far as README.md says.
"""

import argparse
from collections.abc import Sequence
from typing import Any, NamedTuple

from benchmarks.peers.timing import Work, tell
from cosim.machine import BROADCAST, Address, Command, Event, GoTo, LinkEvent, Outgoing, Reception
from cosim.observation import Observation
from cosim.protocol import Metric, ProtocolSpec, Surroundings, anywhere
from cosim.scenario import Scenario
from cosim.settings import Settings
from cosim.simulation import Simulation
from cosim.units import S, Time

RADIUS_M = 0.05
IP_UDP_OCTETS = 28
"""What the headers of IP and UDP add to a payload: without a router it is longer by that, and all frames are alike."""
FADING: dict[str, Any] = {
    "propagation": {"model": "log_distance", "exponent": 3.0, "reference_loss_db": 46.68},
    "power_dbm": 16.0206,
    "noise_figure_db": 7,
    "detection_dbm": -82,
}
"""What ns-3's radios are by default: a frame is noticed up to 51 m away."""
RADIO: dict[str, Any] = {"kind": "adhoc", "phy": "dsss", "rate_mbps": 1, "basic_rates_mbps": [1], **FADING}
DISC: dict[str, Any] = {"kind": "ideal", "range_m": 51}
AODV: dict[str, Any] = {"kind": "aodv", "hello_always": True}
"""Every node sends hellos, as in ns-3."""
ONE_HOP: dict[str, Any] = {"broadcast_ttl": 1}
"""Payloads to all are not passed on, as with ns-3's EnableBroadcast = false."""


class Parameters(Settings):
    """What robots send, and how long they rest."""

    octets: int
    to_all: bool
    pause_s: int


class Walker:
    """One robot's endpoint."""

    finished = False

    def __init__(self, parameters: Parameters, bounds_m: Sequence[float], me: Address, stream: Any, start: Time):
        self.sent = self.received = 0
        self._payload = bytes(parameters.octets)
        self._silent = not parameters.to_all and me == 0
        self._destination = BROADCAST if parameters.to_all else 0
        self._pause = parameters.pause_s * S
        self._bounds_m = bounds_m
        self._stream = stream
        self._next = start + int(stream.integers(S))
        self._go_on: Time | None = None
        self._outbox: list[Outgoing] = []
        self._motion: list[Command] = []

    def receive(self, data: bytes, reception: Reception, now: Time) -> bool:
        """Count a payload; return that nothing else comes of it."""
        self.received += 1
        return False

    def link(self, event: LinkEvent, now: Time) -> None:
        """Take note of nothing."""

    def observe(self, observation: Observation, now: Time) -> bool:
        """Rest where one has arrived, and walk on; return whether one does."""
        if not observation.arrived:
            return False
        if self._go_on is None:
            self._go_on = now + self._pause
        if now < self._go_on:
            return False
        self._go_on = None
        x_min, y_min, x_max, y_max = self._bounds_m
        uniform, margin = self._stream.uniform, 2 * RADIUS_M
        x_m, y_m = uniform(x_min + margin, x_max - margin), uniform(y_min + margin, y_max - margin)
        self._motion.append(GoTo(float(x_m), float(y_m)))
        return True

    def wake(self, now: Time) -> None:
        """Send a payload, if one is due."""
        if now >= self._next:
            self._next += S
            if not self._silent:
                self.sent += 1
                self._outbox.append(Outgoing(self._destination, self._payload))

    def wake_at(self) -> Time:
        """Return when the next payload is due."""
        return self._next

    def outbox(self) -> list[Outgoing]:
        """Drain payloads."""
        self._outbox, drained = [], self._outbox
        return drained

    def commands(self) -> list[Command]:
        """Drain motion."""
        self._motion, drained = [], self._motion
        return drained

    def events(self) -> list[Event]:
        """Return nothing: there is nothing to report."""
        return []


class Nobody:
    """The judge: ends nothing."""

    def look(self, x_m: Any, y_m: Any, now: Time) -> bool:
        """Let the run go on."""
        return False

    def died(self, death: Any) -> None:
        """Take note of nothing."""

    def verdict(self, now: Time) -> dict[str, float]:
        """Return no metric."""
        return {}


def measure(machines: Sequence[Walker]) -> dict[str, float]:
    """Return what was sent and received."""
    return {
        "sent": float(sum(machine.sent for machine in machines)),
        "received": float(sum(machine.received for machine in machines)),
    }


def prepare(parameters: Parameters, surroundings: Surroundings) -> Sequence[float]:
    """Return the bounds of the square."""
    return surroundings.bounds_m


SPEC = ProtocolSpec(
    name="waypoints",
    parameters=Parameters,
    place=anywhere,
    prepare=prepare,
    make=Walker,
    referee=lambda parameters, setup, surroundings: Nobody(),
    metrics=(
        Metric("sent", "1", "payloads that machines have sent"),
        Metric("received", "1", "payloads that machines have received"),
    ),
    measure=measure,
    events=(),
)


class Load(NamedTuple):
    """What is simulated."""

    nodes: int
    side: float
    """Metres, of the square."""
    seconds: float
    channel: str = "radio"
    """Its name: radio, or disc."""
    routing: str = "none"
    """Its name: aodv, or none."""
    to: str = "all"
    """Its name: all, or first."""
    pause: int = 2
    """Seconds that a robot rests where it has arrived."""
    tick: float = 0.1
    octets: int = 100
    neglect: float = 0.0
    """Decibels below the noise from which on signals are neglected, or 0: only those of at most -140 dBm are."""


def scenario(load: Load) -> Scenario:
    """Return the scenario of a *load*."""
    channel, octets = (RADIO, load.octets) if load.channel == "radio" else (DISC, load.octets)
    if load.routing == "aodv":
        channel = channel | {"routing": AODV | (ONE_HOP if load.to == "all" else {})}
    elif load.channel == "radio":
        octets += IP_UDP_OCTETS
    if load.neglect:
        channel = channel | {"neglect_db": load.neglect}
    parameters = {"octets": octets, "to_all": load.to == "all", "pause_s": load.pause}
    return Scenario.model_validate(
        {
            "duration_s": load.seconds,
            "tick_s": load.tick,
            "floorplan": {"map": "walls", "bounds_m": [0, 0, load.side, load.side]},
            "team": {"size": load.nodes, "body": {"radius_m": RADIUS_M, "speed_mps": 1.0, "drive": "omni"}},
            "channel": channel,
            "protocol": {"use": "benchmarks.peers.waypoints:SPEC", "parameters": parameters},
        }
    )


def simulation(load: Load, seed: int) -> Work:
    """Set up the run of a *load*, and return it."""
    run = Simulation(scenario(load), seed)

    def work() -> dict[str, float]:
        metrics = run.run().metrics
        return {
            "sent": metrics["sent"],
            "received": metrics["received"],
            "frames": metrics["frames_sent"],
            "received_per_payload": metrics["received"] / metrics["sent"],
        }

    return work


def main() -> None:
    """Simulate a load and tell what it took."""
    parser = argparse.ArgumentParser("python -m benchmarks.peers.waypoints")
    for name, kind in Load.__annotations__.items():
        parser.add_argument(f"--{name}", type=kind, default=Load._field_defaults.get(name))
    parser.add_argument("--seed", type=int, default=1)
    options = vars(parser.parse_args())
    seed = options.pop("seed")
    load = Load(**options)
    tell(simulation(load._replace(seconds=5.0), 99), lambda: simulation(load, seed))


if __name__ == "__main__":
    main()
