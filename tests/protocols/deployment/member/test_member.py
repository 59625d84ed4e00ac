"""What a robot does of what it is ordered: it obeys the latest, waits for its turn, steps aside, and reports ends."""

import math
from typing import Any

import pytest

from cosim.machine import Drive, Event, Unrecorded, drained
from cosim.observation import Observation
from cosim.units import S, Time
from protocols.deployment.counters import Counters
from protocols.deployment.member.camera import Camera, half_turn_s
from protocols.deployment.member.member import Member
from protocols.deployment.messages.messages import YieldRequest
from protocols.deployment.messages.status import News
from protocols.deployment.parameters import MemberParameters
from protocols.deployment.tasks.events import Driving, PictureTaken, SteppedAside, TaskEnded, TaskStarted
from protocols.deployment.tasks.orders import Errand, Halt, Order, Result, Retreat
from protocols.deployment.tasks.plan import Face, Go, Photo, Place
from tests.protocols.deployment.crew_scene import STARTS_M, TICK, setup


class Wheels:
    """A mover that is where it is told to be when the test says so."""

    def __init__(self) -> None:
        self.state, self.goal_m, self.blocked_by, self.twin, self.under_way = "idle", None, None, None, False
        self.told: list[tuple[Any, ...]] = []

    @property
    def wants_m(self) -> Any:
        return self.goal_m

    def go(self, place_m: Any, via_m: Any = ()) -> None:
        self.state, self.goal_m = "driving", place_m
        self.told.append(("go", place_m))

    def halt(self) -> None:
        self.state, self.goal_m = "idle", None
        self.told.append(("halt",))

    def retreat(self, from_m: Any, way: Any) -> None:
        self.state, self.goal_m = "driving", (9.0, 5.0)
        self.told.append(("retreat", from_m))

    def step(self, observation: Any, others: Any, now: Time) -> Drive | None:
        return None


class Bench:
    """Robot 0 of three, on wheels that the test moves."""

    def __init__(self, **changes: Any) -> None:
        parameters, known = setup(**changes)
        self.wheels, self.events, self.counters = Wheels(), list[Event](), Counters()
        own: Any = self.wheels
        self.member = Member(parameters.member, known, 0, own, self.counters, self.events.append)
        self.now: Time = 0
        self.at = STARTS_M[0]
        self.serial = -1

    def order(self, errand: Errand, plan: int = 1, serial: int | None = None, task: str = "t") -> None:
        self.serial = self.serial + 1 if serial is None else serial
        self.member.obey(Order(plan=plan, serial=self.serial, task=task, robot=0, errand=errand), self.now)

    def tick(self, times: int = 1, heading: float = 0.0) -> list[Drive | None]:
        drives = []
        for _ in range(times):
            self.now += TICK
            drives.append(self.member.step(Observation(*self.at, heading, 0.0, True, False), self.now))
        return drives

    def tell(
        self,
        robot: int,
        x_m: float,
        y_m: float,
        speed_mps: float = 0.0,
        idle: bool = True,
        goal_m: Place | None = None,
    ) -> None:
        news = News(1, 0, 1, 0, 0, None, idle, x_m, y_m, 0.0, speed_mps, goal_m, "" if idle else "task")
        self.member.others.news[robot] = news, self.now

    def results(self) -> list[Result]:
        return [report.result for report in drained(self.member.reports)]


def test_a_drive_is_done_when_the_robot_has_arrived() -> None:
    bench = Bench()
    bench.order(Go(robot=0, place_m=(5.0, 3.0)))
    bench.tick(5)
    assert (bench.member.idle, bench.member.task, bench.results()) == (False, "t", [])
    bench.wheels.state = "arrived"
    bench.tick()
    assert (bench.member.idle, bench.member.task, bench.results()) == (True, "", [Result.DONE])
    recorded = [type(event) for event in bench.events if not isinstance(event, Unrecorded)]
    assert recorded == [TaskStarted, TaskEnded]
    assert bench.events.count(Driving("t", False, False, None)) == 6
    bench.tick(5)
    assert bench.results() == []


@pytest.mark.parametrize(("plan", "serial"), [(1, 3), (1, 4), (0, 9)])
def test_an_order_that_is_not_the_latest_is_ignored(plan: int, serial: int) -> None:
    bench = Bench()
    bench.order(Go(robot=0, place_m=(5.0, 3.0)), serial=5)
    bench.order(Go(robot=0, place_m=(1.0, 3.0)), plan=plan, serial=serial, task="old")
    assert bench.wheels.told == [("go", (5.0, 3.0))]
    bench.order(Go(robot=0, place_m=(2.0, 3.0)), plan=2, serial=0)
    assert bench.wheels.told[-1] == ("go", (2.0, 3.0))


def test_orders_of_another_host_count_anew_and_what_it_is_at_already_goes_on() -> None:
    bench = Bench()
    go = Go(robot=0, place_m=(5.0, 3.0))
    bench.order(go, serial=700)
    bench.member.forget_serials()
    bench.order(go, serial=3)
    assert bench.wheels.told == [("go", (5.0, 3.0))]
    bench.wheels.state = "arrived"
    bench.tick()
    assert [report.serial for report in drained(bench.member.reports)] == [3]


def test_a_robot_sets_off_behind_another_once_that_is_far_enough_ahead() -> None:
    bench = Bench()
    bench.tell(1, 2.0, 1.0, speed_mps=0.5, idle=False)
    bench.order(Go(robot=0, place_m=(5.0, 3.0), behind=1, behind_m=1.5))
    bench.tick(50)
    assert bench.wheels.told == []
    bench.tell(1, 2.4, 1.0, speed_mps=0.5, idle=False, goal_m=(5.0, 3.5))
    bench.tick()
    assert bench.wheels.told == []
    bench.tell(1, 3.0, 1.0, idle=False)  # 1.6 m nearer to the place, by the way; but it waits for its own turn
    bench.tick()
    assert bench.wheels.told == []
    bench.tell(1, 3.0, 1.0, speed_mps=0.5, idle=False, goal_m=(5.0, 3.5))
    bench.tick()
    assert bench.wheels.told == [("go", (5.0, 3.0))]


def test_who_waits_for_its_turn_is_waited_for_and_one_behind_is_not_ahead_however_far() -> None:
    bench = Bench(member={"behind_s": 3.0, "behind_most_s": 20.0})
    bench.tell(1, 1.0, 4.5, idle=False)
    bench.order(Go(robot=0, place_m=(5.0, 3.0), behind=1, behind_m=1.5))
    bench.tick(199)
    assert bench.wheels.told == []
    bench.tick(2)
    assert bench.wheels.told == [("go", (5.0, 3.0))]


def test_nobody_waits_for_one_that_does_not_drive() -> None:
    bench = Bench(member={"behind_s": 3.0})
    bench.tell(1, 2.0, 1.0)
    bench.order(Go(robot=0, place_m=(5.0, 3.0), behind=1, behind_m=1.5))
    bench.tick(29)
    assert bench.wheels.told == []
    bench.tick(2)
    assert bench.wheels.told == [("go", (5.0, 3.0))]


def test_a_drive_fails_when_the_robot_gets_no_nearer_for_long() -> None:
    bench = Bench(member={"stuck_s": 20.0})
    bench.order(Go(robot=0, place_m=(5.0, 1.0)))
    for k in range(10):  # it gets nearer by 10 cm a second, which counts every third second at the latest
        bench.at = (1.0 + 0.1 * k, 1.0)
        bench.tick(10)
    bench.tick(165)
    assert bench.results() == []
    bench.tick(60)
    assert bench.results() == [Result.FAILED]
    assert bench.wheels.told[-1] == ("halt",)
    assert bench.counters.failed == 1


def test_a_halt_is_no_success_of_the_task_that_it_ends() -> None:
    bench = Bench()
    bench.order(Go(robot=0, place_m=(5.0, 3.0)))
    bench.order(Halt(robot=0))
    assert bench.results() == [Result.TERMINATED]
    assert bench.wheels.told[-1] == ("halt",)


def test_a_robot_turns_to_what_it_photographs_and_one_without_a_camera_fails() -> None:
    bench = Bench(cameras=[0])
    bench.order(Photo(robot=0, heading_rad=1.0))
    turns = bench.tick()
    assert isinstance(turns[0], Drive)
    assert turns[0].speed_mps == 0.0
    assert turns[0].turn_radps > 0.0
    assert bench.tick(heading=1.0) == [Drive(0.0, 0.0)]
    assert bench.results() == [Result.DONE]
    assert [event.heading_rad for event in bench.events if isinstance(event, PictureTaken)] == [1.0]
    blind = Bench(cameras=[1])
    blind.order(Photo(robot=0))
    assert blind.results() == [Result.FAILED]


@pytest.mark.parametrize("towards_m", [(1.0, 9.0), (9.0, 1.0), (-3.0, -3.0)])
def test_a_robot_turns_towards_what_it_is_to_face_until_it_does(towards_m: Place) -> None:
    bench = Bench(cameras=[])
    bench.at = (1.0, 1.0)
    wanted = math.atan2(towards_m[1] - 1.0, towards_m[0] - 1.0)
    bench.order(Face(robot=0, towards_m=towards_m))
    (turn,) = bench.tick(heading=wanted - 0.5)
    assert isinstance(turn, Drive)
    assert turn.speed_mps == 0.0
    assert turn.turn_radps > 0.0
    assert bench.results() == []
    assert bench.tick(heading=wanted) == [Drive(0.0, 0.0)]
    assert bench.results() == [Result.DONE]
    assert bench.counters.pictures == 0


@pytest.mark.parametrize("rate_radps", [0.03, 0.5, 3.0, 9.0])
def test_half_a_turn_takes_the_time_in_which_small_steps_make_it(rate_radps: float) -> None:
    camera, step_s, heading, steps = Camera(MemberParameters(look_radps=rate_radps), True), 1e-3, 0.0, 0
    while (turn := camera.turn(math.pi, Observation(0.0, 0.0, heading, 0.0, True, False))) is not None:
        heading, steps = heading + turn.turn_radps * step_s, steps + 1
    assert half_turn_s(rate_radps) == pytest.approx(steps * step_s, rel=5e-3)


def test_a_robot_with_nothing_to_do_steps_aside_for_who_asks_and_comes_back() -> None:
    bench = Bench(member={"near_m": 2.0, "away_m": 3.0})
    bench.tell(1, 2.0, 1.0, speed_mps=0.5, idle=False)
    bench.member.yield_to(YieldRequest(robot=1, from_m=(2.0, 1.0), way_m=((0.5, 1.0),)), bench.now)
    assert bench.wheels.told == [("retreat", (2.0, 1.0))]
    assert [type(event) for event in bench.events] == [SteppedAside]
    bench.tick(20)
    bench.tell(1, 1.0, 3.5, speed_mps=0.5, idle=False)
    bench.tick()
    assert bench.wheels.told[1:] == []
    bench.tell(1, 1.0, 4.5, speed_mps=0.5, idle=False)
    bench.tick()
    assert bench.wheels.told[1:] == [("go", STARTS_M[0])]
    bench.wheels.state = "arrived"
    bench.tick()
    assert bench.member.resting


def test_a_robot_that_drives_does_not_step_aside() -> None:
    bench = Bench()
    bench.order(Go(robot=0, place_m=(5.0, 3.0)))
    bench.member.yield_to(YieldRequest(robot=1, from_m=(2.0, 1.0), way_m=()), bench.now)
    assert bench.wheels.told == [("go", (5.0, 3.0))]


def test_who_stepped_aside_leaves_its_post_to_one_that_stays_there() -> None:
    bench = Bench(member={"aside_s": 5.0, "taken_s": 3.0})
    bench.member.yield_to(YieldRequest(robot=1, from_m=(2.0, 1.0), way_m=()), bench.now)
    bench.tick(52)
    assert bench.wheels.told[-1] == ("go", STARTS_M[0])
    bench.tell(1, *STARTS_M[0])
    bench.wheels.blocked_by = 1  # type: ignore[assignment]
    bench.tick(29)
    assert not bench.member.resting
    bench.tick(5)
    assert bench.member.resting
    assert bench.wheels.told[-1] == ("halt",)


def test_who_was_ordered_aside_is_back_when_it_is_ordered_back_or_after_long() -> None:
    bench = Bench(member={"aside_s": 10.0})
    bench.order(Retreat(robot=0, post_m=STARTS_M[0], passing=1))
    bench.tell(1, 9.0, 5.0, idle=False)
    bench.tick(50)
    assert [told[0] for told in bench.wheels.told] == ["retreat"]
    bench.tick(60)
    assert bench.wheels.told[-1] == ("go", STARTS_M[0])
    bench.wheels.state = "arrived"
    bench.tick()
    assert bench.results() == [Result.DONE]


def test_an_idle_robot_in_the_way_is_asked_to_step_aside_but_not_at_every_tick() -> None:
    bench = Bench(member={"ask_s": 3.0})
    bench.order(Go(robot=0, place_m=(5.0, 1.0)))
    bench.wheels.blocked_by = 1  # type: ignore[assignment]
    bench.tick()
    assert bench.member.requests() == [], "nothing is known of it"
    bench.tell(1, 2.0, 1.0, idle=False)
    bench.tick()
    assert bench.member.requests() == [], "it is at something"
    bench.tell(1, 2.0, 1.0)
    bench.tick(25)
    first = bench.member.requests()
    assert [(other, request.robot, request.from_m) for other, request in first] == [(1, 0, STARTS_M[0])]
    assert first[0][1].way_m[-1] == pytest.approx((5.0, 1.0), abs=0.1)
    bench.tick(10)
    assert len(bench.member.requests()) == 1
    assert bench.now < 5 * S


def test_a_picture_for_which_the_robot_cannot_turn_has_failed_in_the_end() -> None:
    bench = Bench(cameras=[0], member={"stuck_s": 5.0})
    bench.tick(100)
    bench.order(Photo(robot=0, heading_rad=1.0))
    assert all(bench.tick(49))
    assert bench.results() == []
    assert bench.tick(2)[-1] == Drive(0.0, 0.0)
    assert bench.results() == [Result.FAILED]
    assert bench.counters.pictures == 0
