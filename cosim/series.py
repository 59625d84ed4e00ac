"""What metrics would be if the run ended now, second by second: rows of the table ``metrics``, when they have changed.

Which of a referee's metrics are asked for, its protocol's spec says by ``over_time``. The energy that is left in a
robot's battery is among them, if it has one. Nothing is asked for unless the trace wants the table.
"""

from collections.abc import Callable, Mapping

from cosim.errors import LocalProtocolError
from cosim.machine import Address
from cosim.protocol import ProtocolSpec, Referee
from cosim.trace import METRICS, Trace
from cosim.units import S, Time

TEAM: Address = -1
"""The robot of a metric that is about all of them."""
BATTERY = "battery_j"
"""Energy that is left in the battery of a robot."""


class MetricSeries:
    """Writes down, at the first tick of each second and at the end, which metrics have changed."""

    def __init__(
        self, trace: Trace, spec: ProtocolSpec, referee: Referee, energy_j: Callable[[], Mapping[Address, float]]
    ) -> None:
        """*energy_j* tells what is left in each robot's battery, of those that have one.

        Raise LocalProtocolError if the *spec* names a metric over time that is none of its own.
        """
        declared = {metric.name for metric in spec.metrics}
        for name in spec.over_time:
            if name not in declared:
                raise LocalProtocolError(f"{spec.name}: over_time names {name!r}, which is no metric of the spec")
        self._trace = trace
        self._wanted = trace.wants(METRICS)
        self._units = {metric.name: metric.unit for metric in spec.metrics if metric.name in spec.over_time}
        self._referee = referee
        self._energy_j = energy_j
        self._next: Time = 0
        self._before: dict[tuple[Address, str], str] = {}

    def look(self, now: Time) -> None:
        """Note the metrics if a second is over."""
        if self._wanted and now >= self._next:
            self._next = (now // S + 1) * S
            self.note(self._referee.verdict(now) if self._units else {}, now)

    def note(self, verdict: Mapping[str, float], now: Time) -> None:
        """Note what has changed in the *verdict* of the referee, and in the batteries."""
        if not self._wanted:
            return
        for name, unit in self._units.items():
            self._put(TEAM, name, verdict[name], unit, now)
        for robot, left_j in self._energy_j().items():
            self._put(robot, BATTERY, left_j, "J", now)

    def _put(self, robot: Address, name: str, value: float, unit: str, now: Time) -> None:
        text = repr(float(value))  # NaN is not equal to itself
        if self._before.get((robot, name)) != text:
            self._before[robot, name] = text
            self._trace.row(METRICS, now, robot, name, float(value), unit)
