"""The roll that a host calls once a tick: who of the team is lost, and who is there again."""

from collections.abc import Callable, Collection, Iterator

from cosim.machine import Address, Event
from cosim.units import Time
from protocols.deployment.counters import Counters
from protocols.deployment.member.others import Others
from protocols.deployment.tasks import events
from protocols.deployment.tasks.facts import Heard
from protocols.deployment.team.succession import Succession, WhenHeard


class Roll:
    """One robot's list of its team."""

    def __init__(
        self,
        me: Address,
        size: int,
        silence: Time,
        succession: Succession,
        others: Others,
        note: Callable[[Event], None],
        counters: Counters,
    ) -> None:
        """Take who was heard less than *silence* ago for there."""
        self._me = me
        self._size = size
        self._silence = silence
        self._succession = succession
        self._others = others
        self._note = note
        self._counters = counters

    def call(self, lost: Collection[Address], heard: WhenHeard, now: Time, over: bool) -> Iterator[Heard]:
        """Yield who is newly lost, and who of the *lost* is there again; once a play is *over* nobody is lost to it."""
        alone = self._succession.alone(heard, now)
        for robot in range(self._size):
            at = now if robot == self._me else heard(robot)  # others may have taken it for lost before it led them
            if robot in lost and now - at < self._silence:
                self._note(events.RobotFound(robot))
                yield Heard(robot=robot, again=True, at=now)
            elif robot not in lost and not over and self._succession.missed(robot, at, alone, now):
                self._counters.lost += 1
                self._note(events.RobotLost(robot, *self._others.place_m(robot)))
                yield self._missing(robot, now)

    def still_lost(self, lost: Collection[Address], heard: WhenHeard, now: Time) -> tuple[Heard, ...]:
        """Return the *lost* of whom nothing was heard lately, as facts of a plan that begins *now*."""
        silent = [robot for robot in sorted(lost) if robot != self._me and now - heard(robot) >= self._silence]
        return tuple(self._missing(robot, now) for robot in silent)

    def _missing(self, robot: Address, now: Time) -> Heard:
        return Heard(robot=robot, again=False, place_m=self._others.place_m(robot), at=now)
