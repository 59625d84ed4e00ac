"""The operator's console: what is asked is answered, what happens is told, and nonsense is answered as such."""

import json
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cosim.machine import Outgoing
from cosim.observation import Observation
from cosim.simulation import Simulation
from cosim.units import S
from protocols.deployment.runner import Runner
from protocols.wire import BadBytes
from tests.protocols.deployment.crew_scene import BY_CABLE, HEIGHT_M, PLACES_M, STARTS_M, WIDTH_M, scenario, setup
from tests.tiers import two_tiers

CALL = {"play": "deploy/group", "places": PLACES_M}


class Desk:
    """An operator at robot 0 (or another) of a run without calls of its own."""

    def __init__(self, faults: Any = (), **parameters: Any) -> None:
        self.run = Simulation(scenario("ideal", faults, calls=[], **parameters), 1)
        self.run.begin()
        self.heard: list[dict[str, Any]] = []
        self.number = 0

    def until(self, at_s: float) -> list[dict[str, Any]]:
        """Let time pass, and return what was said meanwhile."""
        self.run.advance(int(at_s * S))
        said = [json.loads(each.payload) for each in self.run.said()]
        self.heard += said
        return said

    def ask(self, say: str, at: int = 0, **more: Any) -> dict[str, Any]:
        """Ask, and return the answer, which comes within a second."""
        self.number += 1
        self.run.operate(at, json.dumps({"request": self.number, "say": say, **more}).encode())
        said = self.until(self.run.kernel.now / S + 1.0)
        answers = [each for each in said if each.get("answer") == self.number]
        assert len(answers) == 1, said
        return answers[0]

    def news(self, say: str) -> list[dict[str, Any]]:
        return [each for each in self.heard if each["say"] == say and "answer" not in each]


@pytest.mark.compiles
@pytest.mark.slow
def test_a_play_is_called_and_executed_and_its_tasks_and_its_end_are_told() -> None:
    desk = Desk()
    desk.until(3.0)
    answer = desk.ask("call", call=CALL, execute=True)
    assert (answer["say"], answer["executed"]) == ("plan", True)
    assert answer["plan"]["play"] == "deploy/group"
    assert 10.0 < answer["expected_s"] < 100.0
    desk.until(100.0)
    assert desk.news("ended") == [{"say": "ended", "plan": 1, "result": "done"}]
    states = [(each["task"], each["state"]) for each in desk.news("task")]
    root = answer["plan"]["root"]["name"]
    assert states.count((root, "running")) == states.count((root, "done")) == 1
    assert states[-1] == (root, "done")
    done = [task for task, state in states if state == "done"]
    assert len(done) == len(set(done))
    positions = desk.news("positions")
    assert len(positions) > 100
    assert [row[0] for row in positions[-1]["robots"]] == [0, 1, 2]
    for _, x_m, y_m, *_ in positions[-1]["robots"]:
        assert min(abs(x_m - x) + abs(y_m - y) for x, y in PLACES_M) < 0.3
    assert not desk.run.over, "an operator may call another play"


@pytest.mark.slow
def test_a_call_can_be_tailored_before_the_plan_is_executed() -> None:
    desk = Desk()
    desk.until(3.0)
    first = desk.ask("call", call=CALL)
    assert not first["executed"]
    tailored = desk.ask(
        "call", call={**CALL, "strategy": "wave", "constraints": [{"kind": "deadline", "seconds": 300}]}
    )
    assert tailored["plan"]["number"] != first["plan"]["number"]
    assert tailored["plan"]["constraints"]
    assert desk.ask("state")["plan"] is None
    assert desk.ask("execute", plan=tailored["plan"]["number"])["say"] == "executing"
    state = desk.ask("state")
    assert state["plan"]["constraints"] == tailored["plan"]["constraints"]
    assert "running" in state["tasks"].values()
    late = desk.ask("execute", plan=first["plan"]["number"])
    assert late["plan"] > tailored["plan"]["number"], "an older plan is numbered anew, else nobody would obey it"


@pytest.mark.slow
def test_what_cannot_be_played_is_refused_with_reasons_and_a_mend_that_helps() -> None:
    desk = Desk()
    desk.until(3.0)
    answer = desk.ask("call", call={**CALL, "constraints": [{"kind": "deadline", "seconds": 1}]}, execute=True)
    assert answer["say"] == "refusal"
    assert answer["conflicts"]
    assert answer["mend"]
    assert desk.ask("state")["plan"] is None
    wrong = desk.ask("call", call={"play": "deploy/grup", "places": PLACES_M})
    assert wrong["say"] == "error"
    assert "deploy/group" in wrong["why"]


@pytest.mark.slow
def test_a_task_is_terminated_and_a_strategy_switched() -> None:
    desk = Desk()
    assert desk.ask("terminate")["say"] == "error"
    assert desk.ask("switch", strategy="group")["say"] == "error"
    plan = desk.ask("call", call={**CALL, "play": "deploy/leap-frog"}, execute=True)["plan"]
    assert desk.ask("switch", strategy="wave")["say"] == "done"
    assert desk.ask("terminate", task="nonsense")["say"] == "error"
    assert desk.ask("terminate")["say"] == "done"
    desk.until(20.0)
    assert desk.news("ended") == [{"say": "ended", "plan": plan["number"], "result": "terminated"}]
    before = desk.news("positions")[-1]["robots"]
    desk.until(25.0)
    for old, new in zip(before, desk.news("positions")[-1]["robots"], strict=True):
        assert old[1:3] == new[1:3], "they stand"


def test_plays_the_map_and_routes_can_be_asked_for() -> None:
    desk = Desk()
    tree = desk.ask("plays")["tree"]
    assert {"deploy", "wean", "return", "photo"} <= {branch["name"] for branch in tree}
    floor = desk.ask("map")
    assert floor["bounds"] == [0.0, 0.0, WIDTH_M, HEIGHT_M]
    assert len(floor["walls"]) == 4
    assert [robot["radius_m"] for robot in floor["robots"]] == [0.25] * 3
    route = desk.ask("route", robot=1, to=[8.0, 4.0])
    assert route["way"][0] == list(STARTS_M[1])
    assert route["length_m"] == pytest.approx(6.7, abs=0.2)
    assert desk.ask("route", robot=1, to=[80.0, 4.0])["way"] is None
    assert desk.ask("route", robot=9, to=[8.0, 4.0])["say"] == "error"


@pytest.mark.slow
def test_a_picture_shows_how_far_walls_are_in_front_of_a_robot() -> None:
    desk = Desk(cameras=[0, 1])
    desk.until(2.0)
    for robot in (0, 1):
        picture = desk.ask("picture", robot=robot)
        assert picture["robot"] == robot
        assert len(picture["columns_m"]) == 64
        assert picture["at_m"] == pytest.approx(STARTS_M[robot])
        left, right = picture["columns_m"][0], picture["columns_m"][-1]
        assert right == pytest.approx(2.0, abs=0.3), "the wall 1 m to its right, 30 degrees off its heading"
        assert left is None or left > right
    assert desk.ask("picture", robot=2)["why"] == "robot 2 has no camera"


@pytest.mark.slow
def test_a_robot_that_is_dead_does_not_answer_and_that_is_said() -> None:
    desk = Desk(faults=[{"kind": "kill", "robot": 1, "at_s": 1.0}])
    desk.until(2.0)
    desk.number += 1
    desk.run.operate(0, json.dumps({"request": desk.number, "say": "picture", "robot": 1}).encode())
    desk.until(20.0)
    answers = [each for each in desk.heard if each.get("answer") == desk.number]
    assert answers == [{"answer": desk.number, "say": "error", "why": "robot 1 does not answer"}]


@pytest.mark.slow
@pytest.mark.parametrize("robots", two_tiers([[0, 1, 2], [0]], 1))
def test_exploring_takes_no_less_time_than_is_told_beforehand(robots: list[int]) -> None:
    """In a corridor with a bend, of 33 m in all."""
    walls = ((0, 0, 24, 0), (24, 0, 24, 12), (24, 12, 21, 12), (21, 12, 21, 3), (21, 3, 0, 3), (0, 3, 0, 0))
    desk = Desk(walls=walls)
    desk.until(3.0)
    answer = desk.ask("call", call={"play": "explore", "parameters": {"robots": robots}}, execute=True)
    assert answer["expected_s"] is None
    least_s = answer["windows"]["explore"][2]
    assert least_s > 40.0
    while not desk.news("ended"):
        desk.until(desk.run.kernel.now / S + 10.0)
    assert desk.news("ended") == [{"say": "ended", "plan": 1, "result": "done"}]
    positions = [each["at_s"] for each in desk.news("positions") if each["robots"][0][4]]
    assert least_s < positions[-1] - positions[0] < 4 * least_s
    again = desk.ask("call", call={"play": "explore", "parameters": {"robots": robots}})
    assert again["windows"]["explore"][2] == 0.0, "what was seen once is seen"


@pytest.mark.slow
def test_of_a_robot_that_is_lost_it_is_told_since_when_and_not_that_it_moves() -> None:
    desk = Desk(faults=[{"kind": "kill", "robot": 1, "at_s": 4.0}])
    desk.until(1.0)
    desk.ask("call", call=CALL, execute=True)
    desk.until(25.0)
    rows = [{row[0]: row for row in each["robots"]} for each in desk.news("positions")]
    moves, heard_s = [row[1][5] for row in rows if 1 in row], [row[1][6] for row in rows if 1 in row]
    assert any(moves)
    assert moves[-1] is None
    assert all((move is None) == (silent_s > 15.0) for move, silent_s in zip(moves, heard_s, strict=True))
    refusal = desk.ask("call", call=CALL)
    assert refusal["conflicts"][1:] == ["robot 1 has not been heard for 22 s"], "from 4 s to 26 s"


def test_names_of_parameters_that_are_missing_are_told() -> None:
    desk = Desk()
    answer = desk.ask("call", call={"play": "wean", "parameters": {"crossing": [5, 3]}})
    assert (answer["say"], answer["missing"]) == ("error", ["leap_places", "group_places"])
    assert "missing" not in desk.ask("call", call={"play": "waen"})


def test_another_robots_console_says_who_is_host() -> None:
    desk = Desk()
    answer = desk.ask("call", at=2, call=CALL)
    assert (answer["say"], answer["host"]) == ("error", 0)


def runner() -> Runner:
    machine = Runner(*setup(), 0, 0, np.random.default_rng(0))
    machine.observe(Observation(*STARTS_M[0], 0.0, 0.0, True, False), 0)
    machine.outbox()
    return machine


def answers(machine: Runner) -> list[dict[str, Any]]:
    out = [item for item in machine.outbox() if isinstance(item, Outgoing) and item.destination == -2]
    return [json.loads(item.payload) for item in out]


@pytest.mark.parametrize(
    ("data", "number", "why"),
    [
        (b"", None, "JSON"),
        (b"\xff\xfe", None, "JSON"),
        (b"[]", None, ""),
        (b'{"request": 4}', 4, "say"),
        (b'{"request": 5, "say": "dance"}', 5, "dance"),
        (b'{"request": 6, "say": "route", "robot": -1, "to": [1, 2]}', 6, "robot"),
        (b'{"request": 7, "say": "plays", "more": 1}', 7, "more"),
        (b'{"request": true, "say": "plays"', None, "JSON"),
        (b'{"request": 8, "say": "call", "call": {"play": "x", "places": [[1, NaN]]}}', 8, ""),
        (b" " * (1 << 19), None, "more than"),
    ],
)
def test_what_is_no_request_is_answered_with_what_is_wrong(data: bytes, number: int | None, why: str) -> None:
    machine = runner()
    machine.receive(data, BY_CABLE, 1)
    said = [each for each in answers(machine) if each["say"] == "error"]
    assert len(said) == 1
    assert said[0]["answer"] == number
    assert why in said[0]["why"]
    assert [type(event) for event in machine.events()] == [BadBytes]


MACHINE = runner()


@given(
    st.binary(max_size=200)
    | st.recursive(st.none() | st.integers() | st.text(), st.lists).map(
        lambda value: json.dumps({"request": 1, "say": "call", "call": value}).encode()
    )
)
def test_whatever_an_operator_says_raises_nothing(data: bytes) -> None:
    MACHINE.receive(data, BY_CABLE, 1)
    assert "error" in {each["say"] for each in answers(MACHINE)}
    MACHINE.events()


def test_nothing_is_said_to_nobody() -> None:
    machine = runner()
    for tick in range(1, 40):
        machine.observe(Observation(*STARTS_M[0], 0.0, 0.0, True, False), tick * S // 10)
        assert answers(machine) == []


@pytest.mark.slow
def test_of_tasks_in_whose_place_others_have_come_the_end_is_told_too() -> None:
    desk = Desk()
    desk.ask("call", call=CALL, execute=True)
    desk.until(2.5)
    assert desk.ask("switch", strategy="leap_frog")["say"] == "done"
    desk.until(10.0)
    told = {each["task"]: each["state"] for each in desk.news("task")}
    known = desk.ask("state")["tasks"]
    gone = {task: state for task, state in told.items() if task not in known}
    assert len(gone) > 1
    assert set(gone.values()) == {"terminated"}


# ---------------------------------------------------------------- rehearsal


@pytest.mark.slow
@pytest.mark.parametrize(("floor", "play"), [("given", "deploy"), ("learned", "explore")])
def test_what_is_rehearsed_has_robots_drive(floor: str, play: str) -> None:
    desk = Desk(map=floor)
    desk.until(1.0)
    [said] = desk.run.spec.rehearsal(desk.run.machines)  # type: ignore[misc]
    answer = desk.ask(said["say"], call=said["call"], execute=said["execute"])
    assert (said["call"]["play"], answer["say"]) == (play, "plan")
    desk.until(4.0)
    assert any(moving for told in desk.news("positions") for *_, moving, _, _ in told["robots"])
