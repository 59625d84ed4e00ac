"""Where a robot takes the others to be: as it sees them at this tick, or else by their last status broadcasts."""

import math
from collections.abc import Mapping, Sequence

from cosim.machine import Address
from cosim.observation import Observation
from cosim.units import Time, to_seconds
from protocols.deployment.messages.status import News
from protocols.deployment.tasks.crew import Body
from protocols.deployment.tasks.plan import Place
from protocols.motion.traffic import Other


class Others:
    """What one robot knows of the places and the tasks of the others."""

    def __init__(self, me: Address, bodies: Sequence[Body], starts_m: Sequence[Place]) -> None:
        self.news: dict[Address, tuple[News, Time]] = {}
        """Last status of each other robot, and when it was received; who receives one puts it here."""
        self._bodies = bodies
        self._seen: dict[Address, tuple[Place, tuple[News, Time] | None]] = {
            robot: (place, None) for robot, place in enumerate(starts_m) if robot != me
        }
        """Where each was seen last, or its start, and its last status then."""

    def look(self, observation: Observation, now: Time) -> list[Other]:
        """Take what is seen at this tick; return all robots that were seen or heard so far."""
        seen = {robot: (x_m, y_m) for robot, x_m, y_m in observation.sightings if robot in self._seen}
        self._seen |= {robot: (place, self.news.get(robot)) for robot, place in seen.items()}
        return [self._other(robot, now) for robot in sorted(self.news.keys() | seen.keys())]

    def place_m(self, robot: Address) -> Place:
        """Return the place at which *robot* was seen or reported itself last; its start if neither."""
        place, known = self._seen[robot]
        status = self.news.get(robot)
        if status is None or status is known:  # seen after it, or at the same tick
            return place
        return status[0].x_m, status[0].y_m

    @property
    def places_m(self) -> Mapping[Address, Place]:
        """Place of each other robot, as of :meth:`place_m`."""
        return {robot: self.place_m(robot) for robot in self._seen}

    def moves(self, robot: Address) -> bool:
        """Return whether *robot* drives, by its last status."""
        return robot in self.news and self.news[robot][0].moves

    def bound(self, robot: Address) -> bool:
        """Return whether *robot* has set off to some place, by its last status."""
        return robot in self.news and self.news[robot][0].goal_m is not None

    def busy(self, robot: Address) -> bool:
        """Return whether *robot* has a task, if only to wait for its turn, by its last status."""
        return robot in self.news and self.news[robot][0].task != ""

    def idle(self, robot: Address) -> bool:
        """Return whether *robot* has nothing to do, by its last status."""
        return robot in self.news and self.news[robot][0].idle

    def _other(self, robot: Address, now: Time) -> Other:
        body, (x_m, y_m) = self._bodies[robot], self.place_m(robot)
        plain = Other(robot, x_m, y_m, body.radius_m, braking_mps2=body.acceleration_mps2, age_s=math.inf)
        if robot not in self.news:
            return plain
        news, heard = self.news[robot]
        return plain._replace(
            speed_mps=news.speed_mps,
            heading_rad=news.heading_rad,
            goal_m=news.goal_m,
            idle=news.idle,
            age_s=to_seconds(now - heard),
        )
