"""The operator's cable: past the channel, in order, part by part, and without a trace in runs that nobody attends."""

import json
from typing import Any

import pytest

from cosim.errors import LocalProtocolError
from cosim.machine import OPERATOR, Reception
from cosim.scenario import Scenario
from cosim.simulation import Simulation, simulate
from cosim.trace import FRAMES, MESSAGES
from cosim.units import MS, S
from tests.web.console import PLAIN


def scenario(**changes: Any) -> Scenario:
    return Scenario.model_validate(PLAIN | changes)


def patient(**parameters: Any) -> Scenario:
    return scenario(protocol={"use": "tests.web.console:SPEC", "parameters": {"patient": True, **parameters}})


def begun(plain: Scenario) -> Simulation:
    run = Simulation(plain, 1, (FRAMES, MESSAGES))
    run.begin()
    return run


def test_what_an_operator_says_reaches_that_robot_alone_and_at_once():
    run = begun(patient(calls=0))
    run.advance(150 * MS)
    run.operate(1, b'{"request": 7}')
    run.advance(S)
    assert run.machines[1].heard == [(150 * MS + 1, b'{"request": 7}', Reception(OPERATOR, False))]  # type: ignore[attr-defined]
    assert run.machines[0].heard == run.machines[2].heard == []  # type: ignore[attr-defined]
    [(at, robot, payload)] = run.said()
    assert (at, robot, json.loads(payload)) == (150 * MS + 1, 1, {"answer": 7, "robot": 1})
    assert run.said() == []


def test_the_cable_is_no_channel(monkeypatch: pytest.MonkeyPatch):
    run = begun(patient(calls=0))
    monkeypatch.setattr(run.channel, "send", lambda *given: pytest.fail(f"the channel was given {given}"))
    run.operate(0, b"{}")
    run.advance(S)
    assert run.trace.count("frames") == 0
    assert run.trace.columns("messages")["sender"] == [OPERATOR]


def test_answers_of_several_robots_keep_the_order_in_which_they_were_given():
    run = begun(patient(calls=0))
    for request, robot in enumerate((2, 0, 1, 2, 0)):
        run.operate(robot, json.dumps({"request": request}).encode())
    run.advance(S)
    assert [json.loads(payload)["answer"] for _, _, payload in run.said()] == [0, 1, 2, 3, 4]


def test_an_operator_can_speak_before_the_first_tick():
    run = begun(patient(calls=0))
    run.operate(0, b'{"go": [2.0, 3.5]}')
    run.advance(9 * S)
    assert tuple(run.fleet.positions_m[0]) == pytest.approx((2.0, 3.5), abs=0.05)


@pytest.mark.parametrize("robot", [-1, 3])
def test_a_robot_that_is_not_there_has_no_console(robot: int):
    with pytest.raises(LocalProtocolError, match=f"robot {robot} has no console"):
        begun(patient()).operate(robot, b"{}")


def test_a_dead_host_does_not_answer():
    run = begun(patient(calls=0))
    run.nodes[0].kill()
    run.operate(0, b"{}")
    run.advance(S)
    assert run.said() == []


def test_parts_of_a_run_are_the_run():
    whole = simulate(scenario(), 5)
    run = Simulation(scenario(), 5)
    run.begin()
    until = 0
    while not run.over:
        until += 37 * MS
        run.advance(until)
    assert run.outcome().digest == whole.digest
    assert run.kernel.now == round(whole.simulated_s * S) < until


def test_a_run_that_is_over_stays_where_it_is():
    run = begun(scenario())
    assert run.advance(20 * S)
    end = run.kernel.now
    assert run.advance(30 * S)
    assert run.kernel.now == end == round(3.1 * S)  # the tick after the third call


def test_a_run_ends_when_its_time_is_over():
    run = begun(patient())
    assert not run.advance(10 * S - 1)
    assert run.advance(11 * S)
    assert run.kernel.now == 10 * S


def test_an_attended_run_waits_for_its_operator():
    run = begun(scenario())
    run.attended = True
    assert not run.advance(9 * S)
    run.operate(0, b"{}")
    assert not run.advance(9 * S + MS)
    assert len(run.said()) == 1
    run.attended = False
    assert run.advance(10 * S)
    assert run.kernel.now == round(9.1 * S)


def test_an_attended_run_goes_on_when_its_time_is_over():
    run = begun(scenario(duration_s=2))
    run.attended = True
    assert not run.advance(3 * S)
    assert run.kernel.now == 3 * S
