"""A run that is under way: simulated in a thread of its own, at the pace that its pages ask for.

The simulation is touched by its thread only. What pages ask for waits in a bounded queue until the thread takes it;
what they are told the thread publishes under a lock, as plain data that nobody changes any more.
"""

import json
import threading
import time
from collections import deque
from contextlib import suppress
from typing import Any, Final

from cosim.errors import UserError
from cosim.jit import COMPILES, cache_folder
from cosim.scenario import Scenario, digest, dump
from cosim.simulation import Simulation
from cosim.units import S, Time, to_seconds
from cosim.web.history import TRAIL_TICKS, Cursor, History, Moment
from cosim.web.messages import Operate, Pause, Plain, Play, Seek, Speed, Step, Wish
from cosim.web.pacing import Pace
from cosim.web.rows import Rolling
from cosim.web.scenes import scene_of
from cosim.web.tap import WATCHED, Tap, is_mark

_WISHES: Final = 64
"""Things asked for that may wait."""
_ANSWERS: Final = 4096
"""Messages to the operator that are kept for pages that come late, or are slow."""
_ROWS: Final = 2000
"""Rows of each kind that are kept."""
_PERIOD_S: Final = 0.03
"""Between two publications."""
_HEARD: Final[Time] = 2
"""ns, so soon after it was said the operator's word has been heard, and answered if that takes no time."""
_SPELL_S: Final = 0.1
"""How long the thread simulates at most without looking up."""
_BUSY_S: Final = 1.0
"""So long after its last publication the thread is taken to be busy."""
_REHEARSED: Final[Time] = 60 * S
"""ns, how much is simulated beforehand of a run that has an operator."""
_STARTED: Final[Time] = 2 * S
"""ns, the same for a run that has none, and before an operator speaks."""


def rehearse(scenario: Scenario, seed: int, attended: bool = False) -> None:
    """Simulate the beginning of a run and throw it away, so that nobody waits for kernels that it compiles.

    It is done once for a scenario and a cache of kernels, and not at all where nothing is compiled. What an operator
    says in an *attended* run is the protocol's ``rehearsal``. Raise UserError for a scenario that cannot be set up.
    """
    done = cache_folder() / f"rehearsed-{digest([dump(scenario), attended])[:16]}"
    if done.exists() or not COMPILES:
        return
    run = Simulation(scenario, seed, WATCHED, Tap)
    run.attended = attended
    run.begin()
    try:
        _play_beginning(run)
    except Exception:  # noqa: BLE001  # what a machine does wrong is told of the run that is shown
        return
    with suppress(OSError):  # without a cache that can be written to, it is done each time
        done.parent.mkdir(parents=True, exist_ok=True)
        done.touch()


def _play_beginning(run: Simulation) -> None:
    """Simulate as much as a rehearsal does, with what an operator says in it."""
    run.advance(_STARTED)
    if run.attended and run.spec.rehearsal is not None:
        for said in run.spec.rehearsal(run.machines):
            for robot in range(len(run.machines)):
                run.operate(robot, json.dumps(said).encode())
        run.advance(_REHEARSED)


class Live:
    """A session that runs a scenario. ``attended`` runs have an operator, and last until the session is closed."""

    def __init__(
        self, scenario: Scenario, seed: int, playing: bool = True, speed: float = 1.0, attended: bool = False
    ) -> None:
        """Set the run up and start its thread; raise UserError for a scenario that cannot be set up."""
        self._simulation = Simulation(scenario, seed, WATCHED, Tap)
        self._simulation.attended = attended
        self._scene = scene_of(scenario, self._simulation.floorplan, seed) | {"live": True, "attended": attended}
        self._team = scenario.team.size
        self._tick = scenario.tick
        self._pace = Pace(speed, playing, time.monotonic())
        self._wishes: deque[Wish] = deque()
        self._until: Time | None = None
        """Up to where the steps go that are being taken."""
        self._closing = threading.Event()
        self._lock = threading.Lock()
        self._marks, self._events = Rolling(_ROWS), Rolling(_ROWS)
        self._frames, self._ticks = Rolling(_ROWS), Rolling(TRAIL_TICKS)
        self._history = History(self._ticks, self._frames, self._events, self._marks)
        self._answers = Rolling(_ANSWERS)
        self._ending: Plain | None = None
        self._failure = ""
        self._simulation.begin()
        self._moment = Moment(0, self._state(), speed, self._robots())
        self._published_s = time.monotonic()
        self._thread = threading.Thread(target=self._run, name="simulation", daemon=True)
        self._thread.start()

    @property
    def scene(self) -> Plain:
        """What does not change."""
        return self._scene

    @property
    def running(self) -> bool:
        """Whether the simulation's thread is there."""
        return self._thread.is_alive()

    @property
    def _busy(self) -> bool:
        """Whether the simulation's thread has not looked up for long."""
        return self.running and time.monotonic() - self._published_s > _BUSY_S

    def wish(self, wish: Wish) -> None:
        """Have the simulation's thread take what a page asks for; raise UserError, one line, if it cannot be."""
        if isinstance(wish, Seek) or (isinstance(wish, Step) and wish.ticks < 1):
            raise UserError("this run is under way: it only goes on")
        if isinstance(wish, Operate) and wish.robot >= self._team:
            raise UserError(f"there is no robot {wish.robot}: the team has robots 0 to {self._team - 1}")
        if self._moment.state in ("ended", "failed"):
            raise UserError(f"this run has {self._moment.state}")
        with self._lock:
            if len(self._wishes) >= _WISHES:
                raise UserError("the simulation is busy: nothing more can wait")
            self._wishes.append(wish)

    def look(self, cursor: Cursor | None) -> tuple[list[Plain], Cursor]:
        """Return what a page is to be told that has been told up to *cursor*, and the new cursor."""
        with self._lock:
            moment = self._moment._replace(state="busy") if self._busy else self._moment
            message, new = self._history.now(moment, cursor)
            told = [] if message is None else [message]
            count = self._answers.until(0)
            known = 0 if cursor is None else cursor.operator
            if cursor is not None and known < self._answers.first:
                told.append({"say": "missed", "answers": self._answers.first - known})
            told += [row[0] for row in self._answers.between(known, count)]
            if self._ending is not None and not new.ended:
                told.append(self._ending)
            return told, new._replace(operator=count, ended=self._ending is not None)

    def close(self) -> None:
        """Stop the simulation's thread and wait for it; more than once is harmless."""
        self._closing.set()
        if threading.current_thread() is not self._thread:
            self._thread.join()

    # ------------------------------------------------------------ the simulation's thread

    def _run(self) -> None:
        try:
            while self._ending is None and not self._closing.is_set():
                begun = time.monotonic()
                self._take_wishes()
                self._simulate()
                self._publish()
                if self._simulation.over:
                    self._end()
                spent = time.monotonic() - begun
                self._closing.wait(max(0.001, _PERIOD_S - spent))
        except Exception as error:  # noqa: BLE001  # whatever a protocol's machine does wrong: the page is to say it
            self._fail(error)

    def _fail(self, error: Exception) -> None:
        """Say that the run has failed, and how far it has come if that can still be asked."""
        self._failure = f"{type(error).__name__}: {error}"
        try:
            self._publish()
        except Exception:  # noqa: BLE001  # it may be what has failed: then what was known before has to do
            with self._lock:
                self._moment = self._moment._replace(state=self._state(), why=self._failure)

    def _take_wishes(self) -> None:
        """Do what was asked for in its order: what comes after steps waits until they are taken."""
        begun = time.monotonic()
        while not self._closing.is_set() and self._stepped(begun):
            with self._lock:
                if not self._wishes:
                    return
                wish = self._wishes.popleft()
            self._take(wish)

    def _take(self, wish: Wish) -> None:
        wall = time.monotonic()
        now = self._simulation.kernel.now
        match wish:
            case Play():
                self._pace.play(wall)
            case Pause():
                self._pause(now, wall)
            case Step(ticks=ticks):
                self._pause(now, wall)
                self._until = (now // self._tick + ticks) * self._tick + 1
            case Speed(speed=speed):
                self._pace.change(speed, wall)
            case Operate(robot=robot, data=data):
                self._simulation.operate(robot, json.dumps(data, ensure_ascii=False).encode())
                if not self._pace.playing:  # what is said arrives all the same, and is answered
                    self._simulation.advance(now + _HEARD)
                    self._pause(self._simulation.kernel.now, wall)

    def _stepped(self, begun: float) -> bool:
        """Go on with steps; return whether none are left: all are taken, or a pause was asked for after them."""
        if self._until is None:
            return True
        with self._lock:
            cut = any(isinstance(wish, Pause) for wish in self._wishes)
        if not cut and not self._reach(self._until, begun):
            return False
        self._until = None
        self._pause(self._simulation.kernel.now, time.monotonic())
        return True

    def _pause(self, now: Time, wall: float) -> None:
        self._pace.pause(wall)
        self._pace.jump(now, wall)

    def _simulate(self) -> None:
        """Advance to the time that is due; if there is too little time for it, have less be due."""
        begun = time.monotonic()
        if not self._reach(self._pace.due(begun), begun):
            self._pace.jump(self._simulation.kernel.now, time.monotonic())

    def _reach(self, due: Time, begun: float) -> bool:
        """Advance to *due*, tick by tick; return False if that takes too long, or the session is closed meanwhile."""
        simulation, kernel = self._simulation, self._simulation.kernel
        while kernel.now < due and not simulation.over:
            simulation.advance(min(due, (kernel.now // self._tick + 1) * self._tick + 1))
            if time.monotonic() - begun > _SPELL_S or self._closing.is_set():
                return False
        return True

    def _publish(self) -> None:
        """Let pages see what there is now."""
        trace: Any = self._simulation.trace
        ticks, frames, events = trace.fetched()
        said = self._simulation.said()
        answers: list[Plain] = [
            {"say": "operator", "robot": robot, "time_s": to_seconds(at), "data": _decoded(payload)}
            for at, robot, payload in said
        ]
        moment = Moment(self._simulation.kernel.now, self._state(), self._pace.speed, self._robots(), why=self._failure)
        with self._lock:
            for row in ticks:
                self._ticks.append(row)
            for row in frames:
                self._frames.append(row)
            for row in events:
                self._events.append(row)
                if is_mark(row):
                    self._marks.append(row)
            for answer in answers:
                self._answers.append([answer])
            self._moment = moment
            self._published_s = time.monotonic()

    def _end(self) -> None:
        outcome = self._simulation.outcome()
        metrics = [
            [metric.name, outcome.metrics[metric.name], metric.unit, metric.meaning]
            for metric in outcome.metric_columns
            if metric.name in outcome.metrics
        ]
        with self._lock:
            self._ending = {"say": "ended", "metrics": metrics, "digest": outcome.digest}

    def _state(self) -> str:
        if self._failure:
            return "failed"
        if self._simulation.over:
            return "ended"
        return "playing" if self._pace.playing or self._until is not None else "paused"

    def _robots(self) -> list[list[Any]]:
        simulation = self._simulation
        trace: Any = simulation.trace
        poses = [simulation.fleet.pose_at(robot, simulation.kernel.now) for robot in range(self._team)]
        return [
            [round(x, 4), round(y, 4), round(heading, 4), robot in trace.down]
            for robot, (x, y, heading, *_) in enumerate(poses)
        ]


def _decoded(payload: bytes) -> Any:
    """Return what a machine says to its operator: plain data if it is JSON, else its text."""
    text = payload.decode(errors="replace")
    try:
        return json.loads(text)
    except ValueError:
        return text
