"""The judge of searches with faults: looks from outside, at the end of a run, and asks no machine for a verdict.

It knows whose radios reach whom, whose process runs, what has arrived at hosts byte by byte, and what machines hold:
whose member a searcher takes itself for, whom hosts have in their lists, which targets they know.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

from cosim.kernel import AIR
from cosim.simulation import Simulation
from cosim.trace import MESSAGES
from cosim.units import MS, Time, from_seconds, to_seconds
from protocols.aggregation.frames import decode
from protocols.aggregation.messages import Report
from tests.protocols.aggregation.fault_schedules import Schedule

JUDGED_S = 30.0
"""So long after the last fault everybody is to be in a sub-team."""
STEP: Time = 500 * MS
"""From one look of the judge to the next."""
REACH_S = 4.0
"""Who has been in reach of a host for so long has heard of it: some heartbeats, few of which are lost."""
SETTLED_S = 5.0
"""A membership that is younger is being told about: such a searcher is judged when it is so old."""
TOLD_S = 10.0
"""Hosts that have been in reach of each other for so long know of each other what they need."""


# ---------------------------------------------------------------- what is seen


class Look(NamedTuple):
    """What the judge sees at one instant."""

    at_s: float
    up: frozenset[int]
    """Robots whose process runs."""
    heard: tuple[tuple[frozenset[int], ...], ...]
    """By radio and robot: who would hear it."""
    claims: dict[int, tuple[int | None, int]]
    """Searcher -> the host that it names, and the epoch."""
    lists: dict[int, dict[int, int]]
    """Host -> its members and their epochs."""
    found: dict[int, frozenset[int]]
    """Host -> the targets that it knows."""

    def mutual(self, radio: int, one: int, other: int) -> bool:
        """Return whether two robots can hear each other."""
        return other in self.heard[radio][one] and one in self.heard[radio][other]


class Watched:
    """A schedule that has been run, and what was seen at its end."""

    def __init__(self, what: Schedule) -> None:
        """Run it; raise what the run raises."""
        self.schedule = what
        self.simulation = Simulation(what.scenario, what.number, (MESSAGES,))
        self.looks: list[Look] = []
        self.hosts: int = what.scenario.protocol.parameters.hosts  # type: ignore[attr-defined]
        self.size = what.scenario.team.size
        kernel, end = self.simulation.kernel, what.scenario.duration
        for at in range(from_seconds(what.quiet_s + JUDGED_S - TOLD_S), end, STEP):
            kernel.at(at, self._look, AIR)
        self.simulation.run()
        self.ended_s = to_seconds(kernel.now)
        self.whole = kernel.now == end
        """Whether the search has not ended before its time."""

    def _look(self) -> None:
        simulation, robots = self.simulation, range(self.size)
        machines: list[Any] = list(simulation.machines)
        hosts, searchers = range(self.hosts), range(self.hosts, self.size)
        look = Look(
            to_seconds(simulation.kernel.now),
            frozenset(robot for robot in robots if simulation.nodes[robot].alive),
            tuple(tuple(frozenset(part.in_reach(robot)) for robot in robots) for part in simulation.channel.parts),
            {each: (machines[each].membership.host, machines[each].membership.epoch) for each in searchers},
            {host: {each: m.epoch for each, m in machines[host].team.roster.members.items()} for host in hosts},
            {host: frozenset(machines[host].findings.targets) for host in hosts},
        )
        self.looks.append(look)

    def found_now(self, host: int) -> set[int]:
        """Return the targets that a host knows in the end."""
        machine: Any = self.simulation.machines[host]
        return set(machine.findings.targets)

    @property
    def survivors(self) -> list[int]:
        """The hosts that have never been down."""
        columns = self.simulation.trace.columns("events")
        down = {
            source
            for source, event in zip(columns["source"], columns["event"], strict=True)
            if event in ("Killed", "Crashed")
        }
        return [host for host in range(self.hosts) if host not in down]

    def reported(self) -> list[tuple[int, int]]:
        """Return the (host, target) of all reports that have arrived at a host, byte by byte."""
        columns = self.simulation.trace.columns("messages")
        pairs: set[tuple[int, int]] = set()
        for receiver, payload in zip(columns["source"], columns["payload"], strict=True):
            if receiver < self.hosts:
                message = decode(bytes.fromhex(payload))[1]
                if isinstance(message, Report):
                    pairs |= {(receiver, finding.number) for finding in message.targets}
        return sorted(pairs)


# ---------------------------------------------------------------- the verdict


def lost_reports(run: Watched) -> list[str]:
    """Return where a report was lost.

    A target in a report that arrived at a host which never went down must be among that host's findings in the end.
    What it knew ``TOLD_S`` before the end, all hosts must know that could exchange frames with it all that time.
    """
    survivors = run.survivors
    wrong = [
        f"target {target} was reported to host {host}, which does not know it"
        for host, target in run.reported()
        if host in survivors and target not in run.found_now(host)
    ]
    last = [look for look in run.looks if look.at_s >= run.ended_s - TOLD_S]
    if not (run.whole and last):
        return wrong
    for host in survivors:
        for other in range(run.hosts):
            together = all(other in look.up and host != other and look.mutual(1, host, other) for look in last)
            missing = last[0].found[host] - run.found_now(other)
            if together and missing:
                wrong.append(f"host {other} has not been told of {sorted(missing)} by host {host}")
    return wrong


def outsiders(looks: Sequence[Look], hosts: int, quiet_s: float) -> list[str]:
    """Return who is not in exactly one sub-team, 30 s after the last fault.

    Who is asked: each searcher whose process runs and that could exchange frames, all through the last ``REACH_S``,
    with one and the same host whose process ran. It is in exactly one sub-team if it names a host whose process runs,
    that host has it in its list with the epoch that the searcher counts, and no other host whose process runs has it,
    which that host could exchange frames with over the last ``TOLD_S``: who cannot be told does not count.

    A searcher that has changed its membership in the last ``SETTLED_S`` is asked again when it has not for so long;
    until the end of the run, then it is one that finds no rest.
    """
    return [wrong for each in sorted(looks[0].claims) if (wrong := _outside(looks, each, hosts, quiet_s)) is not None]


def _outside(looks: Sequence[Look], searcher: int, hosts: int, quiet_s: float) -> str | None:
    for count, now in enumerate(looks, 1):
        before = looks[:count]
        if now.at_s < quiet_s + JUDGED_S:
            continue
        if not _in_reach(before, searcher, hosts):
            return None
        if all(look.claims[searcher] == now.claims[searcher] for look in _last(before, SETTLED_S)):
            return _wrong(before, searcher, hosts)
    return f"searcher {searcher} joins on and on"


def _last(looks: Sequence[Look], seconds: float) -> list[Look]:
    return [look for look in looks if look.at_s >= looks[-1].at_s - seconds]


def _in_reach(looks: Sequence[Look], searcher: int, hosts: int) -> bool:
    """Return whether the searcher could exchange frames with one living host all the time of late."""
    late = _last(looks, REACH_S)
    return any(
        all({searcher, host} <= look.up and look.mutual(0, host, searcher) for look in late) for host in range(hosts)
    )


def _wrong(looks: Sequence[Look], searcher: int, hosts: int) -> str | None:
    """Return what is wrong with a searcher's membership at the last look."""
    now = looks[-1]
    host, epoch = now.claims[searcher]
    if host is None or host not in now.up:
        return f"searcher {searcher} is in the sub-team of {host}, which does not live"
    if now.lists[host].get(searcher) != epoch:
        return f"searcher {searcher}, epoch {epoch}: host {host} has it with epoch {now.lists[host].get(searcher)}"
    late = _last(looks, TOLD_S)
    for other in range(hosts):
        told = all({other, host} <= look.up and look.mutual(1, host, other) for look in late)
        if other != host and told and searcher in now.lists[other]:
            return f"searcher {searcher} of host {host} is in the list of host {other}, too"
    return None
