"""The metrics of aggregation: how long the search took, what it cost, and how long it went on after its end.

The task ends when every host that lives to see the end of the run knows all targets. A search that has not ended counts
as long as the run was, as in the paper (section VII.B). The energy of driving is proportional to the way. Of a robot
that has been rebooted its last life counts; a reboot of a host that others notice is a false suspicion. Instants are
told by the robots' own clocks: with a fault that steps one of them the metrics of time mean nothing.
"""

import math
from collections.abc import Sequence
from typing import TypeAlias

from cosim.machine import Metric
from cosim.units import Time, to_seconds
from protocols.aggregation.host import Host
from protocols.aggregation.searcher import Searcher

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
    Metric("hosts_alive", "1", "hosts that no fault has killed"),
)


def measure(machines: Team) -> dict[str, float]:
    """Return what the machines have counted."""
    end = max(machine.records.last_tick for machine in machines)
    living = [machine for machine in machines if machine.records.last_tick == end]
    hosts = [machine for machine in living if isinstance(machine, Host)]
    searchers = [machine for machine in living if isinstance(machine, Searcher)]
    known = [host.records.known_at for host in hosts]
    stopped = [searcher.records.stopped_at for searcher in searchers]
    task_end = _last(known, end)
    records = [machine.records for machine in machines]
    way_m = sum(record.ways_m[-1] for record in records if record.ways_m)
    joules_a_metre = machines[0].parameters.motion_j_per_m
    radio_j = sum(record.radio_j for record in records)
    posts = len(machines[0].knowledge.ground.posts_m)
    visited = set().union(*(host.findings.visited for host in hosts))
    return {
        "search_time_min": to_seconds(task_end) / 60.0,
        "first_known_min": to_seconds(min((at for at in known if at is not None), default=end)) / 60.0,
        "completed": float(bool(hosts) and None not in known),
        "stop_time_min": to_seconds(_last(stopped, end)) / 60.0,
        "distance_after_m": sum(_way_after(machine, task_end) for machine in machines),
        "frames": float(sum(record.frames for record in records)),
        "payload_bytes": float(sum(record.payload_bytes for record in records)),
        "motion_j": joules_a_metre * way_m,
        "radio_j": radio_j,
        "energy_j": joules_a_metre * way_m + radio_j,
        "joins": float(sum(len(record.joins) for record in records)),
        "contacts": float(sum(record.contacts for record in records)),
        "targets_reported": float(sum(record.reported for record in records)),
        "share_visited": len(visited) / posts if posts else math.nan,
        "rejoin_time_s": _rejoin_time_s(machines, end),
        **_suspicions(machines, end),
    }


def _last(instants: Sequence[Time | None], end: Time) -> Time:
    """Return the last of *instants*, or *end* if one of them has not come."""
    return max((end if at is None else at for at in instants), default=end)


def _way_after(machine: Host | Searcher, task_end: Time) -> float:
    """Return how far a robot has gone since the first tick after *task_end*."""
    ways_m = machine.records.ways_m
    if not ways_m:
        return 0.0
    after = max(machine.records.last_tick - task_end, 0) // machine.knowledge.tick
    return ways_m[-1] - ways_m[max(len(ways_m) - 1 - after, 0)]


def _rejoin_time_s(machines: Team, end: Time) -> float:
    """Return how long it took the first searchers of dead hosts to be taken in by others, those that were."""
    delays = []
    for machine in machines:
        if isinstance(machine, Searcher):
            death = machines[machine.knowledge.host_of(machine.me)].records.last_tick
            after = [at - death for at in machine.records.joins if death < end and at >= death]
            delays += [to_seconds(min(after))] if after else []
    return sum(delays) / len(delays) if delays else math.nan


def _suspicions(machines: Team, end: Time) -> dict[str, float]:
    """Return how long hosts took to miss the dead among them, and how often they missed the living."""
    delays, wrong = [], 0
    hosts = [machine for machine in machines if isinstance(machine, Host)]
    for host in hosts:
        for other, at in host.records.failures:
            death = hosts[other].records.last_tick
            if death == end or at < death:
                wrong += 1
            else:
                delays.append(to_seconds(at - death))
    mean = sum(delays) / len(delays) if delays else math.nan
    return {"detection_time_s": mean, "false_suspicions": float(wrong)}
