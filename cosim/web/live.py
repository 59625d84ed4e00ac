"""A run that is under way: simulated in a thread of its own, at the pace that its pages ask for.

Only this thread touches the simulation. What pages ask for waits in a bounded queue until the thread takes it; the
thread publishes under a lock what they are sent, as plain data that does not change any more.
"""

import json
import logging
import threading
import time
import traceback
from collections import deque
from collections.abc import Iterable, Sequence
from contextlib import suppress
from functools import cache, partial
from typing import Any, Final

import numpy as np

from cosim.arrays import Floats
from cosim.caches import begin, cache_folder, kernels_digest
from cosim.decoding import frame_said
from cosim.errors import UserError
from cosim.jit import COMPILES
from cosim.scenario import Scenario, digest, dump
from cosim.simulation import Simulation
from cosim.trace import (
    BELIEFS,
    FRAMES,
    INTERVALS,
    MESSAGES,
    METRICS,
    PAYLOADS,
    POSES,
    RECEPTIONS,
    TRANSMISSIONS,
    WAKES,
    Table,
    Trace,
)
from cosim.units import S, Time, from_seconds, to_seconds
from cosim.web.activity import PresentActivity
from cosim.web.air import Frame, RecentAir
from cosim.web.beliefs import PresentBeliefs
from cosim.web.history import DOWN, MOST_OF_KIND, UP, Cursor, History, Moment, places
from cosim.web.messages import Again, AskMap, AskPresent, Operate, Pause, Plain, Play, Seek, Speed, Step, Wish
from cosim.web.pacing import Pace
from cosim.web.rows import Rolling, Row
from cosim.web.scans import Scanner
from cosim.web.scenes import scene_of
from cosim.web.timeline import Grown, Timeline

_LOG: Final = logging.getLogger(__name__)
_WATCHED: Final = (POSES, FRAMES, TRANSMISSIONS, RECEPTIONS, INTERVALS, MESSAGES, WAKES, PAYLOADS, METRICS, *BELIEFS)
"""Tables that a page shows besides the events."""
_WISHES: Final = 64
"""Maximum number of wishes that wait."""
_ANSWERS: Final = 4096
"""Number of messages to the operator that are kept for pages that come late, or are slow."""
_ROWS: Final = 2000
"""Number of events that are kept, and of marks."""
_TICKS: Final = 6000
"""Number of ticks that trails go back."""
_PERIOD_S: Final = 0.03
"""Interval between two publications."""
_HEARD: Final[Time] = 2
"""Time in which the operator's message has been received, and answered if that takes no time, ns."""
_SPELL_S: Final = 0.1
"""Maximum time that the thread simulates before it looks at the wishes again."""
_BUSY_S: Final = 1.0
"""Time after its last publication from which the thread counts as busy."""
_REHEARSED: Final[Time] = 60 * S
"""Length of the rehearsal of a run that has an operator, ns."""
_STARTED: Final[Time] = 2 * S
"""Length of the rehearsal of a run that has none, and of that part of it in which an operator is silent, ns."""


class Tap(Trace):
    """A trace that keeps the events, which decide the run's digest, and of all else only what is not fetched yet."""

    def __init__(self, wanted: Iterable[Table] = ()) -> None:
        super().__init__(wanted)
        self.down: set[int] = set()
        """Robots that do nothing any more."""
        self._ticks: list[tuple[int, list[float]]] = []
        self._frames: list[Frame] = []
        self.seen = 0
        """Number of frames so far."""
        self._events: list[Row] = []
        self._number = 0
        self._rows: dict[str, list[tuple[Any, ...]]] = {name: [] for name in self.tables if name != POSES.name}
        self._fields = tuple(field.name for field in self.tables["events"].fields[3:])

    def row(self, table: Table, *values: Any) -> None:
        """Add a row; *values* in the order of the table's fields."""
        rows = self._rows.get(table.name)
        if rows is not None:
            rows.append(values)
        if table.name == "events":
            super().row(table, *values)
            self._events.append(self._event(values))
        elif table.name == "frames":
            start, source, destination, duration, kind, channel, lt_addr, length, outcome, part, *radio = values
            about = kind, outcome, length, channel, lt_addr, part
            self._frames.append(Frame(start, start + duration, source, destination, *about, *(radio or (0,))))
            self.seen += 1
        elif table.name == "poses":
            time, _, *pose = values
            if not self._ticks or self._ticks[-1][0] != time:
                self._ticks.append((time, [to_seconds(time)]))
            self._ticks[-1][1].extend(pose)

    def put(self, table: Table, *values: Any) -> None:
        """Add a row."""
        self.row(table, *values)

    def rows(self, table: Table, *columns: Any) -> None:
        """Add rows by column, in the order of the table's fields."""
        plain = (column.tolist() if hasattr(column, "tolist") else column for column in columns)
        for values in zip(*plain, strict=True):
            self.row(table, *values)

    def fetched(self) -> tuple[list[Row], list[Frame], list[Row]]:
        """Drain the rows since the last call: ticks, frames, events."""
        ticks = [pose for _, pose in self._ticks]
        frames, events = self._frames, self._events
        self._ticks, self._frames, self._events = [], [], []
        return ticks, frames, events

    def grown(self) -> dict[str, list[tuple[Any, ...]]]:
        """Drain the rows since the last call of all tables but that of poses, by the table's name."""
        rows, self._rows = self._rows, {name: [] for name in self._rows}
        return rows

    @property
    def told(self) -> int:
        """Number of events so far."""
        return self._number

    def _event(self, values: tuple[Any, ...]) -> Row:
        time, source, name, *rest = values
        if name in DOWN:
            self.down.add(source)
        elif name in UP:
            self.down.discard(source)
        fields = {name: value for name, value in zip(self._fields, rest, strict=True) if value is not None}
        self._number += 1
        return [self._number - 1, to_seconds(time), source, name, fields]


def rehearse(scenario: Scenario, seed: int, attended: bool = False) -> None:
    """Simulate the beginning of a run and throw it away, so that its pages do not wait for kernels to be compiled.

    Do so once for a scenario and a cache of kernels, and not at all where nothing is compiled. What an operator says in
    an *attended* run is the protocol's ``rehearsal``. Raise UserError for a scenario that cannot be set up.
    """
    done = cache_folder("rehearsed", kernels_digest()) / digest([dump(scenario), attended])[:16]
    if done.exists() or not COMPILES:
        return
    run = Simulation(scenario, seed, _WATCHED, Tap)
    run.attended = attended
    run.begin()
    try:
        _play_beginning(run)
    except Exception:  # noqa: BLE001  # only kernels are lost: the run that is shown makes them, and tells what breaks it
        return
    with suppress(OSError):  # without a cache that can be written to, it is done each time
        begin(done.parent)
        done.touch()


def _play_beginning(run: Simulation) -> None:
    """Simulate the length of a rehearsal, with the protocol's ``rehearsal`` as what an operator says."""
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
        self._simulation = Simulation(scenario, seed, _WATCHED, Tap)
        self._simulation.attended = attended
        self._scene = scene_of(scenario, self._simulation.floorplan, seed) | {"live": True, "attended": attended}
        self._team = scenario.team.size
        self._tick = scenario.tick
        self._slot: Time | None = self._scene["slot_ns"]
        self._pace = Pace(speed, playing, time.monotonic())
        self._wishes: deque[Wish] = deque()
        self._steps: tuple[str, int] | None = None
        """Where the steps that are being taken end: at a time, or when so many frames or events are known."""
        self._closing = threading.Event()
        self._lock = threading.Lock()
        self._marks, self._events = Rolling(_ROWS), Rolling(_ROWS)
        self._air, self._activity, self._ticks = RecentAir(), PresentActivity(), Rolling(_TICKS)
        self._kinds: dict[str, Rolling] = {}
        self._beliefs = PresentBeliefs()
        parts = self._air, self._activity, self._beliefs, self._events, self._marks, self._kinds
        self._history = History(self._ticks, *parts)
        self._scanner = cache(lambda: Scanner(self._scene))
        self._sensed: tuple[Time, Floats, Floats] | None = None
        """The last tick, where all robots were (n, 3), and how the frames of their odometry were turned (n,)."""
        self._answers = Rolling(_ANSWERS)
        drawn = [table for table in self._simulation.trace.tables.values() if table not in BELIEFS]
        self._timeline = Grown(drawn, partial(frame_said, scenario), dump(scenario)["channel"], self._team)
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
    def timeline(self) -> Timeline:
        """The boxes of the run so far."""
        return self._timeline

    @property
    def running(self) -> bool:
        """True if the simulation's thread runs."""
        return self._thread.is_alive()

    @property
    def state(self) -> str:
        """What the run is doing, as pages were told last."""
        return self._moment.state

    @property
    def _busy(self) -> bool:
        """True if the simulation's thread has published nothing for long."""
        return self.running and time.monotonic() - self._published_s > _BUSY_S

    def wish(self, wish: Wish) -> None:
        """Have the simulation's thread do what a page asks for; raise UserError, one line, if it cannot be done."""
        if isinstance(wish, Again):
            raise UserError("this run cannot begin anew")
        if isinstance(wish, Seek) or (isinstance(wish, Step) and wish.count < 1):
            raise UserError("this run is under way: it only goes on")
        if isinstance(wish, Step) and wish.by == "slot" and self._slot is None:
            raise UserError("this run has no slots")
        if isinstance(wish, Operate) and wish.robot >= self._team:
            raise UserError(f"there is no robot {wish.robot}: the team has robots 0 to {self._team - 1}")
        if self._moment.state in ("ended", "failed"):
            raise UserError(f"this run has {self._moment.state}")
        with self._lock:
            if len(self._wishes) >= _WISHES:
                raise UserError("the simulation is busy: nothing more can wait")
            self._wishes.append(wish)

    def look(self, cursor: Cursor | None) -> tuple[list[Plain], Cursor]:
        """Return the messages for a page that has been sent all up to *cursor*, and the new cursor."""
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

    def answer(self, asked: AskPresent) -> Plain:
        """Return the answer to what a page asks about the present; raise UserError, one line, if there is none."""
        with self._lock:
            if isinstance(asked, AskMap):
                return self._beliefs.map(asked.robot, self._moment.time)
            sensed = self._sensed
        scanner = self._scanner()  # without the lock: wishes and looks would wait, and the server with them
        if sensed is None:
            raise UserError("this run has not begun")
        tick, poses, turned_rad = sensed
        return scanner.scan(asked.robot, poses, turned_rad, tick)

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
        except Exception as error:  # noqa: BLE001  # a machine may raise anything, a thread has no caller: pages and log tell it
            self._fail(error)

    def _fail(self, error: Exception) -> None:
        """Publish that the run has failed, and its state if that can still be asked for; log where it did."""
        self._failure = f"{type(error).__name__}: {error}"
        # as text: a record that has the error keeps its frames, and what they hold
        _LOG.error("the run has failed\n\n%s", "".join(traceback.format_exception(error)).rstrip())
        try:
            self._publish()
        except Exception:  # noqa: BLE001  # a run that has failed may fail again when looked at; the first is told
            with self._lock:
                self._moment = self._moment._replace(state=self._state(), why=self._failure)

    def _take_wishes(self) -> None:
        """Do what was asked for, in this order: what comes after steps waits until they are taken."""
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
            case Step(by=by, count=count):
                self._pause(now, wall)
                self._steps = by, self._end_of_steps(now, by, count)
            case Speed(speed=speed):
                self._pace.change(speed, wall)
            case Operate(robot=robot, data=data):
                self._simulation.operate(robot, json.dumps(data, ensure_ascii=False).encode())
                if not self._pace.playing:  # what is said arrives all the same, and is answered
                    self._simulation.advance(now + _HEARD)
                    self._pause(self._simulation.kernel.now, wall)

    def _stepped(self, begun: float) -> bool:
        """Go on with steps; return whether none are left, all taken or cut short by a pause."""
        if self._steps is None:
            return True
        with self._lock:
            cut = any(isinstance(wish, Pause) for wish in self._wishes)
        if not cut and not self._taken(*self._steps, begun):
            return False
        self._steps = None
        self._pause(self._simulation.kernel.now, time.monotonic())
        return True

    def _end_of_steps(self, now: Time, by: str, count: int) -> int:
        """Return where steps from *now* end: a time, or the number of frames or events that are known then."""
        trace: Any = self._simulation.trace
        if by == "frame":
            return int(trace.seen) + count
        if by == "event":
            return int(trace.told) + count
        step = self._tick if by == "tick" else self._slot or self._tick
        return (now // step + count) * step + 1

    def _taken(self, by: str, end: int, begun: float) -> bool:
        """Advance to the *end* of steps; return False if that takes too long, or if the session is closed."""
        if by in ("tick", "slot"):
            return self._reach(end, begun)
        simulation, kernel = self._simulation, self._simulation.kernel
        trace: Any = simulation.trace
        while (trace.seen if by == "frame" else trace.told) < end and not simulation.over:
            simulation.advance(max(kernel.now, kernel.peek()[0]) + 1)
            if time.monotonic() - begun > _SPELL_S or self._closing.is_set():
                return False
        return True

    def _pause(self, now: Time, wall: float) -> None:
        self._pace.pause(wall)
        self._pace.jump(now, wall)

    def _simulate(self) -> None:
        """Advance to the time that is due; if that takes too long, let less be due."""
        begun = time.monotonic()
        if not self._reach(self._pace.due(begun), begun):
            self._pace.jump(self._simulation.kernel.now, time.monotonic())

    def _reach(self, due: Time, begun: float) -> bool:
        """Advance to *due*, tick by tick; return False if that takes too long, or if the session is closed."""
        simulation, kernel = self._simulation, self._simulation.kernel
        while kernel.now < due and not simulation.over:
            simulation.advance(min(due, (kernel.now // self._tick + 1) * self._tick + 1))
            if time.monotonic() - begun > _SPELL_S or self._closing.is_set():
                return False
        return True

    def _publish(self) -> None:
        """Let pages see the present state."""
        trace: Any = self._simulation.trace
        present = self._simulation.present
        ticks, frames, events = trace.fetched()
        grown = trace.grown()
        said = self._simulation.said()
        answers: list[Plain] = [
            {"say": "operator", "robot": robot, "time_s": to_seconds(at), "data": _decoded(payload)}
            for at, robot, payload in said
        ]
        moment = Moment(present.now, self._state(), self._pace.speed, self._robots(), why=self._failure)
        self._timeline.take(grown, present)
        sensed = self._sense(ticks)
        with self._lock:
            if sensed is not None:
                self._beliefs.take(grown, sensed[0])
                self._sensed = sensed
            for row in ticks:
                self._ticks.append(row)
            for frame in frames:
                self._air.append(frame)
            self._air.put(present.flying)
            self._activity.put(present.under_way)
            for row in events:
                self._events.append(row)
                self._kinds.setdefault(row[3], Rolling(MOST_OF_KIND)).append(row)
                if places(row[4]):  # its fields name a place
                    self._marks.append(row)
            for answer in answers:
                self._answers.append([answer])
            self._moment = moment
            self._published_s = time.monotonic()

    def _sense(self, ticks: Sequence[Row]) -> tuple[Time, Floats, Floats] | None:
        """Return the last of new *ticks*, where all robots were, and how the frames of their odometry were turned."""
        if not ticks:
            return None
        time_s, *places = ticks[-1]
        poses, senses = np.array(places).reshape(-1, 3), self._simulation.senses
        turned_rad = np.zeros(len(poses)) if senses is None else poses[:, 2] - senses.own_poses[:, 2]
        return from_seconds(time_s), poses, turned_rad

    def _end(self) -> None:
        outcome = self._simulation.outcome()
        self._publish()  # intervals that the end of the run has closed
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
        return "playing" if self._pace.playing or self._steps is not None else "paused"

    def _robots(self) -> list[list[Any]]:
        simulation = self._simulation
        trace: Any = simulation.trace
        poses = [simulation.fleet.pose_at(robot, simulation.kernel.now) for robot in range(self._team)]
        return [
            [round(x, 4), round(y, 4), round(heading, 4), robot in trace.down]
            for robot, (x, y, heading, *_) in enumerate(poses)
        ]


def _decoded(payload: bytes) -> Any:
    """Return what a machine sends to its operator: plain data if it is JSON, else its text."""
    text = payload.decode(errors="replace")
    try:
        return json.loads(text)
    except ValueError:
        return text
