"""The metrics of aggregation: how long the search took, what it cost, and how long it went on after its end.

The task ends when every host that is alive at the end of the run knows all targets. A search that has not ended counts
as long as the run was, as in the paper (section VII.B). The energy of driving is proportional to the way. All
incarnations of a robot count; a suspicion of a host that was down is neither false nor the detection of a death.
Instants are counted by ticks, so that a clock that a fault steps does not matter.
"""

import math
from collections.abc import Sequence
from typing import TypeAlias

from cosim.arrays import Floats
from cosim.machine import Address
from cosim.protocol import Death, Metric, Referee
from cosim.units import Time, to_seconds
from protocols.aggregation.counters import Counters
from protocols.aggregation.host import Host
from protocols.aggregation.searcher import Searcher
from protocols.aggregation.setup import Setup

Team: TypeAlias = Sequence[Host | Searcher]

METRICS = (
    Metric("search_time_min", "min", "until all living hosts know every target; the run's time if they never do"),
    Metric("first_known_min", "min", "until the first host knows every target; the run's time if none does"),
    Metric("completed", "1", "1 if all living hosts know every target in the end, else 0"),
    Metric("stop_time_min", "min", "until the last living searcher was told to stop; the run's time if not all were"),
    Metric("distance_after_m", "m", "driven by all robots after the search had ended"),
    Metric("frames", "1", "messages that all robots have sent"),
    Metric("payload_bytes", "B", "bytes in these messages"),
    Metric("motion_j", "J", "energy of driving"),
    Metric("radio_j", "J", "energy of sending and receiving messages (Feeney and Nilsson 2001)"),
    Metric("energy_j", "J", "both together"),
    Metric("joins", "1", "times that a searcher changed to another host"),
    Metric("contacts", "1", "times that a searcher came into contact with its host"),
    Metric("targets_reported", "1", "targets that hosts heard of first from their own searchers"),
    Metric("share_visited", "1", "share of the posts that some living host knows as visited"),
    Metric("detection_time_s", "s", "from a host's death until another host suspects it, mean; NaN if none died"),
    Metric("rejoin_time_s", "s", "from a host's death until one of its searchers was in another team, mean; or NaN"),
    Metric("false_suspicions", "1", "times that a host suspected another that lived"),
    Metric("false_failures", "1", "times that a searcher suspected a host that lived"),
    Metric("hosts_alive", "1", "hosts that no fault has killed"),
)


def measure(machines: Team) -> dict[str, float]:
    """Return the metrics of all machines, but for the referee's."""
    end = max(machine.counters.last_tick for machine in machines)
    living = [machine for machine in machines if machine.counters.last_tick == end]
    hosts = [machine for machine in living if isinstance(machine, Host)]
    searchers = [machine for machine in living if isinstance(machine, Searcher)]
    known = [host.counters.known_at for host in hosts]
    stopped = [searcher.counters.stopped_at for searcher in searchers]
    task_end = _last(known, end)
    counters = [each for machine in machines for each in machine.counters.incarnations()]
    way_m = math.fsum(record.ways_m[-1] for record in counters if record.ways_m)
    joules_a_metre = machines[0].parameters.motion_j_per_m
    radio_j = math.fsum(record.radio_j for record in counters)
    posts = len(machines[0].setup.ground.posts_m)
    visited = set().union(*(host.findings.visited for host in hosts))
    return {
        "search_time_min": to_seconds(task_end) / 60.0,
        "first_known_min": to_seconds(min((at for at in known if at is not None), default=end)) / 60.0,
        "completed": float(bool(hosts) and None not in known),
        "stop_time_min": to_seconds(_last(stopped, end)) / 60.0,
        "distance_after_m": math.fsum(_way_after(record, task_end) for record in counters),
        "frames": float(sum(record.frames for record in counters)),
        "payload_bytes": float(sum(record.payload_bytes for record in counters)),
        "motion_j": joules_a_metre * way_m,
        "radio_j": radio_j,
        "energy_j": joules_a_metre * way_m + radio_j,
        "joins": float(sum(len(record.joins) for record in counters)),
        "contacts": float(sum(record.contacts for record in counters)),
        "targets_reported": float(sum(record.reported for record in counters)),
        "share_visited": len(visited) / posts if posts else math.nan,
        "rejoin_time_s": _rejoin_time_s(machines, end),
        **_suspicions(machines, end),
    }


def _last(instants: Sequence[Time | None], end: Time) -> Time:
    """Return the last of *instants*, or *end* if one of them has not come."""
    return max((end if at is None else at for at in instants), default=end)


def _way_after(record: Counters, task_end: Time) -> float:
    """Return how far a robot has gone, in one of its incarnations, since the first tick after *task_end*."""
    ways_m = record.ways_m
    if not ways_m:
        return 0.0
    after = max(record.last_tick - task_end, 0) // record.tick
    return ways_m[-1] - ways_m[max(len(ways_m) - 1 - after, 0)]


def _rejoin_time_s(machines: Team, end: Time) -> float:
    """Return the mean time from a host's death until its searchers were taken in by others, of those that were."""
    delays = []
    for machine in machines:
        if isinstance(machine, Searcher):
            death = machines[machine.setup.host_of(machine.me)].counters.last_tick
            joins = [at for each in machine.counters.incarnations() for at in each.joins]
            after = [at - death for at in joins if death < end and at >= death]
            delays += [to_seconds(min(after))] if after else []
    return math.fsum(delays) / len(delays) if delays else math.nan


def _suspicions(machines: Team, end: Time) -> dict[str, float]:
    """Return how long hosts took to suspect the dead among them, and how often living ones were suspected, by whom."""
    delays: list[float] = []
    wrong = {Host: 0, Searcher: 0}
    for machine in machines:
        for host, at in (failure for each in machine.counters.incarnations() for failure in each.failures):
            watched = machines[host].counters
            if any(each.begun <= at < each.last_tick + each.tick for each in watched.incarnations()):
                wrong[type(machine)] += 1
            elif watched.last_tick < end and at >= watched.last_tick and isinstance(machine, Host):
                delays.append(to_seconds(at - watched.last_tick))
    mean = math.fsum(delays) / len(delays) if delays else math.nan
    return {
        "detection_time_s": mean,
        "false_suspicions": float(wrong[Host]),
        "false_failures": float(wrong[Searcher]),
    }


class SearchReferee(Referee):
    """The truth about a search: which robots are dead. All else depends on what hosts know, which no body shows.

    A run goes on until all living robots have stopped, no host lives any more, or its time is over.
    """

    def __init__(self, setup: Setup) -> None:
        self._hosts = setup.hosts
        self._dead: set[Address] = set()

    def look(self, x_m: Floats, y_m: Floats, now: Time) -> bool:
        """Return True if no host is alive: then no robot can be sent a stop."""
        return all(host in self._dead for host in range(self._hosts))

    def died(self, death: Death) -> None:
        """Note a death."""
        self._dead.add(death.robot)

    def verdict(self, now: Time) -> dict[str, float]:
        """Return the number of living hosts."""
        return {"hosts_alive": float(self._hosts - sum(host in self._dead for host in range(self._hosts)))}
