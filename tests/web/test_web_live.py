"""A run under way: it is the same run as without pages, does what they ask, and leaves nothing behind."""

import json
import re
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from cosim.errors import UserError
from cosim.machine import OPERATOR, Reception
from cosim.observation import Observation
from cosim.scenario import Scenario
from cosim.simulation import simulate
from cosim.units import S, Time
from cosim.web.history import Cursor
from cosim.web.live import Live, rehearse
from cosim.web.messages import Operate, Pause, Plain, Play, Seek, Speed, Step
from tests.web.console import PLAIN, Console

LONG_S = 60.0
"""Wall time that no test needs: what does not come until then will not come."""

Making = Callable[..., Live]


@pytest.fixture
def live() -> Iterator[Making]:
    """Return a function that begins a live run; they are closed after the test."""
    begun: list[Live] = []

    def begin(playing: bool = True, speed: float = 1.0, attended: bool = False, **parameters: Any) -> Live:
        duration_s = parameters.pop("duration_s", 10)
        protocol = {"use": "tests.web.console:SPEC", "parameters": parameters}
        plain = PLAIN | {"protocol": protocol, "duration_s": duration_s}
        begun.append(Live(Scenario.model_validate(plain), 1, playing, speed, attended))
        return begun[-1]

    yield begin
    for session in begun:
        session.close()
        assert not session.running


class Page:
    """What a page has been told so far."""

    def __init__(self, session: Live) -> None:
        self.session = session
        self.cursor: Cursor | None = None
        self.messages: list[Plain] = []

    def look(self) -> list[Plain]:
        told, self.cursor = self.session.look(self.cursor)
        self.messages += told
        return told

    def until(self, happened: Callable[[Plain], bool]) -> Plain:
        """Look until a message is what is waited for."""
        end_s = time.monotonic() + LONG_S
        while time.monotonic() < end_s:
            for message in self.look():
                if happened(message):
                    return message
            time.sleep(0.005)
        raise AssertionError(f"it did not come: {self.messages[-3:]}")

    def of(self, kind: str) -> list[Plain]:
        return [message for message in self.messages if message["say"] == kind]


def said(robot: int, data: Plain) -> Operate:
    return Operate(say="operator", robot=robot, data=data)


def state(name: str) -> Callable[[Plain], bool]:
    return lambda message: message["say"] == "now" and message["state"] == name


def test_a_run_that_is_looked_at_is_the_run_that_is_not(live: Making):
    session = live(speed=1000.0)
    ended = Page(session).until(lambda message: message["say"] == "ended")
    alone = simulate(Scenario.model_validate(PLAIN), 1)
    assert ended["digest"] == alone.digest
    told = {name: value for name, value, *_ in ended["metrics"]}
    assert {name: value for name, value in alone.metrics.items() if name != "kernel_events"}.items() <= told.items()


def test_events_and_frames_come_once_and_in_order(live: Making):
    session = live(speed=20.0)
    page = Page(session)
    page.until(state("ended"))
    events = [row for message in page.of("now") for row in message["events"]]
    assert [row[0] for row in events] == list(range(9))
    assert {row[3] for row in events} == {"Marked"}
    assert page.of("now")[-1]["frames_seen"] == 9
    times = [message["time_s"] for message in page.of("now")]
    assert times == sorted(times)


def test_a_second_page_sees_the_same_however_late_it_comes(live: Making):
    session = live(playing=False)
    session.wish(said(1, {"request": 5}))
    session.wish(Step(say="step", count=15))
    one = Page(session)
    one.until(lambda message: message["say"] == "operator")
    session.wish(Step(say="step"))
    one.until(lambda message: message["say"] == "now" and message["time_s"] > 1.55)
    two = Page(session)
    two.look()
    assert two.of("operator") == one.of("operator")
    assert two.messages[0]["robots"] == one.of("now")[-1]["robots"]
    rows = [row for message in one.of("now") for row in message["events"]]
    assert two.messages[0]["events"] == rows
    assert len(two.messages[0]["trails"]) == 17


def test_a_pause_holds_and_steps_are_ticks(live: Making):
    session = live(playing=False, patient=True)
    page = Page(session)
    assert page.until(state("paused"))["time_s"] == 0
    for tick in range(1, 4):
        session.wish(Step(say="step"))
        page.until(lambda message, tick=tick: message["time_s"] == pytest.approx(tick / 10))  # type: ignore[misc]
    time.sleep(0.1)
    assert page.look() == []
    session.wish(Play(say="play"))
    page.until(lambda message: message["time_s"] > 0.4)
    session.wish(Pause(say="pause"))
    page.until(state("paused"))


def test_a_faster_run_is_faster(live: Making):
    session = live(playing=False, patient=True, duration_s=1000)
    page = Page(session)
    session.wish(Step(say="step"))  # compiles what is to be compiled
    page.until(lambda message: message["time_s"] > 0)
    session.wish(Speed(say="speed", speed=50.0))
    session.wish(Play(say="play"))
    begun_s = time.monotonic()
    assert page.until(lambda message: message["time_s"] > 10)["speed"] == 50.0
    assert 0.19 <= time.monotonic() - begun_s < 9.8  # not faster than asked for either


def test_an_operator_is_answered_in_order(live: Making):
    session = live(patient=True, attended=True)
    for request in range(30):
        session.wish(said(request % 3, {"request": request}))
    page = Page(session)
    page.until(lambda message: message["say"] == "operator" and message["data"]["answer"] == 29)
    assert [message["data"]["answer"] for message in page.of("operator")] == list(range(30))
    assert [message["robot"] for message in page.of("operator")] == [request % 3 for request in range(30)]


def test_an_operator_makes_a_robot_drive(live: Making):
    session = live(playing=False, speed=20.0, attended=True)
    session.wish(said(0, {"go": [6.0, 2.0 + 1.5]}))
    session.wish(Play(say="play"))
    page = Page(session)
    message = page.until(lambda message: message["say"] == "now" and message["robots"][0][1] > 3.4)
    assert message["robots"][1][1] == 2.0


def test_a_run_is_not_over_while_its_operator_may_speak(live: Making):
    session = live(speed=1000.0, attended=True)
    page = Page(session)
    assert page.until(lambda message: message["time_s"] > 20.0)["state"] == "playing"  # its scenario is of 10 s


def test_a_run_whose_thread_does_not_look_up_is_busy(live: Making, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("cosim.web.live._BUSY_S", 0.05)
    held, observe = threading.Event(), Console.observe

    def compiling(self: Console, observation: Observation, now: Time) -> None:
        if now >= S:
            held.wait(LONG_S)
        observe(self, observation, now)

    monkeypatch.setattr(Console, "observe", compiling)
    page = Page(live(speed=10.0, patient=True))
    try:
        at_s = page.until(state("busy"))["time_s"]
        assert at_s < 1.0
    finally:
        held.set()
    assert page.until(lambda message: message["time_s"] > 1.0)["state"] in ("playing", "busy")
    page.until(state("ended"))


# ---------------------------------------------------------------- beforehand


@pytest.fixture
def said_to(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> list[tuple[Time, int, Any]]:
    """Return what robots are told at their consoles; the cache of kernels is empty."""
    said: list[tuple[Time, int, Any]] = []
    receive = Console.receive

    def heard(self: Console, data: bytes, reception: Reception, now: Time) -> None:
        if reception.source == OPERATOR:
            said.append((now, self.me, json.loads(data)))
        receive(self, data, reception, now)

    monkeypatch.setattr(Console, "receive", heard)
    monkeypatch.setattr("cosim.web.live.cache_folder", lambda *_: tmp_path / "kernels")
    return said


def test_what_an_operator_mostly_says_is_rehearsed_once(said_to: list[tuple[Time, int, Any]]):
    scenario = Scenario.model_validate(PLAIN)
    rehearse(scenario, 1)
    assert said_to == []  # a run without an operator
    rehearse(scenario, 1, attended=True)
    assert said_to == [(2 * S + 1, robot, {"go": [3.0, 3.0]}) for _ in range(3) for robot in range(3)]
    rehearse(scenario, 1, attended=True)
    assert len(said_to) == 9
    rehearse(Scenario.model_validate(PLAIN | {"duration_s": 11}), 1, attended=True)
    assert len(said_to) == 18


def test_nothing_is_rehearsed_where_nothing_is_compiled(
    said_to: list[tuple[Time, int, Any]], monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr("cosim.web.live.COMPILES", False)
    rehearse(Scenario.model_validate(PLAIN), 1, attended=True)
    assert said_to == []


def test_what_breaks_in_a_rehearsal_is_left_to_the_run(said_to: list[tuple[Time, int, Any]], tmp_path: Path):
    protocol = {"use": "tests.web.console:SPEC", "parameters": {"break_at_s": 0.5}}
    rehearse(Scenario.model_validate(PLAIN | {"protocol": protocol}), 1)
    assert not (tmp_path / "kernels").exists()  # the next one gets further, perhaps
    with pytest.raises(UserError, match="starts"):
        rehearse(Scenario.model_validate(PLAIN | {"team": {"size": 1, "starts": [[99, 99]]}}), 1)


@pytest.mark.parametrize(
    ("wish", "expected"),
    [
        (Seek(say="seek", time_s=1.0), "under way"),
        (Step(say="step", count=-1), "under way"),
        (Operate(say="operator", robot=3, data={}), "there is no robot 3"),
    ],
)
def test_what_cannot_be_is_refused(live: Making, wish: Any, expected: str):
    with pytest.raises(UserError, match=expected):
        live(playing=False).wish(wish)


def test_who_asks_too_much_is_told_so(live: Making, monkeypatch: pytest.MonkeyPatch):
    held = threading.Event()
    monkeypatch.setattr(Live, "_take_wishes", lambda self: held.wait(LONG_S))
    session = live()
    try:
        for _ in range(64):
            session.wish(Pause(say="pause"))
        with pytest.raises(UserError, match="busy"):
            session.wish(Pause(say="pause"))
    finally:
        held.set()


def test_nothing_can_be_asked_of_a_run_that_has_ended(live: Making):
    session = live(speed=1000.0)
    Page(session).until(state("ended"))
    with pytest.raises(UserError, match="this run has ended"):
        session.wish(said(0, {}))


def test_a_machine_that_breaks_is_told_to_the_page(live: Making):
    session = live(break_at_s=0.3)
    message = Page(session).until(state("failed"))
    assert message["why"] == "RuntimeError: the console has broken"
    assert message["time_s"] == pytest.approx(0.3)


def test_a_machine_that_gets_what_it_cannot_read_is_told_too(live: Making, monkeypatch: pytest.MonkeyPatch):
    session = live(playing=False)
    session.wish(said(0, {"go": "nowhere"}))
    session.wish(Play(say="play"))
    assert "TypeError" in Page(session).until(state("failed"))["why"]


def test_a_slow_page_gets_the_newest_and_is_told_what_it_missed(live: Making, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("cosim.web.live._ANSWERS", 8)
    session = live(patient=True, attended=True, speed=100.0, duration_s=100_000)
    slow, quick = Page(session), Page(session)
    slow.look()
    for request in range(40):
        session.wish(said(0, {"request": request}))
        quick.until(lambda message, n=request: message["say"] == "operator" and message["data"]["answer"] == n)  # type: ignore[misc]
    told = slow.look()
    assert [message["data"]["answer"] for message in told if message["say"] == "operator"] == list(range(32, 40))
    assert [message["answers"] for message in told if message["say"] == "missed"] == [32]
    [now] = [message for message in told if message["say"] == "now"]
    assert now["time_s"] >= quick.of("now")[-1]["time_s"]


def test_closing_ends_the_thread_also_in_the_middle_of_a_run(live: Making):
    before = threading.active_count()
    session = live(patient=True, duration_s=1_000_000, speed=1000.0)
    assert session.running
    session.close()
    session.close()
    assert threading.active_count() == before


STEPS = 1000
"""Ticks: as many as a page can ask for at once."""


@pytest.fixture
def slow(monkeypatch: pytest.MonkeyPatch) -> None:
    """Have every tick take 6 ms at least."""
    observe = Console.observe

    def slowly(self: Console, observation: Observation, now: Time) -> None:
        time.sleep(0.002)
        observe(self, observation, now)

    monkeypatch.setattr(Console, "observe", slowly)


def test_closing_does_not_wait_for_steps_that_are_still_to_be_taken(live: Making, slow: None):
    session = live(playing=False, patient=True, duration_s=1_000_000)
    for _ in range(4):
        session.wish(Step(say="step", count=STEPS))
    page = Page(session)
    page.until(lambda message: message["time_s"] > 0)
    begun_s = time.monotonic()
    session.close()
    assert time.monotonic() - begun_s < 5.0  # a spell and a tick are 0.11 s
    page.look()
    assert page.of("now")[-1]["time_s"] < 100.0


def test_a_pause_ends_steps_that_were_asked_for_before_it(live: Making, slow: None):
    session = live(playing=False, patient=True, duration_s=1_000_000)
    for _ in range(3):
        session.wish(Step(say="step", count=STEPS))
    page = Page(session)
    page.until(lambda message: message["time_s"] > 0 and message["state"] == "playing")
    session.wish(Pause(say="pause"))
    held_s = page.until(state("paused"))["time_s"]
    assert held_s < 100.0
    session.wish(Step(say="step"))
    page.until(lambda message: message["state"] == "paused" and message["time_s"] > held_s)
    assert page.of("now")[-1]["time_s"] == pytest.approx(held_s + 0.1, abs=1e-6)


def test_what_is_said_after_steps_is_heard_after_them(live: Making, slow: None):
    session = live(playing=False, patient=True, attended=True)
    for _ in range(2):
        session.wish(Step(say="step", count=15))
    session.wish(said(0, {"request": 1}))
    page = Page(session)
    answered = page.until(lambda message: message["say"] == "operator")
    assert answered["time_s"] == pytest.approx(3.0)


def test_a_run_of_which_nothing_more_can_be_shown_has_failed(
    live: Making, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
):
    session = live(speed=10.0, patient=True, duration_s=1_000_000)
    page = Page(session)
    page.until(lambda message: message["time_s"] > 0)

    def broken(self: Live) -> None:
        raise RuntimeError("nothing to be seen")

    monkeypatch.setattr(Live, "_robots", broken)
    assert page.until(state("failed"))["why"] == "RuntimeError: nothing to be seen"
    (told,) = caplog.messages
    assert re.search(r'test_web_live\.py", line \d+, in broken', told), "the log tells where"
    with pytest.raises(UserError, match="this run has failed"):
        session.wish(Pause(say="pause"))
