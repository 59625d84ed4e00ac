"""A run as PettingZoo's ParallelEnv: the contract, and that bodies, messages and faults are those of any other run."""

import math
import warnings
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cosim.env import parallel_env
from cosim.errors import UserError
from cosim.machine import OPERATOR, Drive, Reception
from cosim.protocol import Referee
from cosim.scenario import Scenario, build
from cosim.simulation import simulate
from cosim.testing import check_machine
from cosim.units import S
from protocols.agents.machine import AgentMachine, Parameters
from protocols.agents.spec import SPEC
from protocols.wire import BadBytes

LINKS = {"links": {}}


def scenario(size: int = 3, octets: int = 0, **settings: Any) -> Scenario:
    transport = settings.pop("transport", {})
    plain = {
        "duration_s": 3,
        "floorplan": {"map": "walls", "bounds_m": [0, 0, 6, 6]},
        "team": {"size": size, "body": {"drive": "differential"}},
        "protocol": {"use": "agents", "parameters": {"message_octets": octets, "transport": transport}},
    }
    return build(plain | settings, "test", Path())


def standing(env: Any) -> dict[str, Any]:
    return {agent: np.zeros(env.action_space(agent).shape, np.float32) for agent in env.agents}


def saying(env: Any, agent: str, payload: bytes) -> dict[str, Any]:
    """Return actions by which *agent* says *payload*, and nobody else says or does anything."""
    actions = standing(env)
    actions[agent][2] = 1.0
    actions[agent][3:] = np.frombuffer(payload, np.uint8)
    return actions


def heard(env: Any, observations: dict[str, Any], agent: str) -> list[tuple[int, float, bytes]]:
    """Return source, age and octets of what *agent* has heard, the last first."""
    layout = env.layouts[env.possible_agents.index(agent)]
    rows = observations[agent][layout.columns["heard"]].reshape(-1, 2 + layout.octets)
    return [(int(row[0]), float(row[1]), bytes(row[2:].astype(np.uint8))) for row in rows if row[0] >= 0]


# ---------------------------------------------------------------- without the libraries


def test_without_the_libraries_one_line_says_how_to_get_them(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("cosim.installed.find_spec", lambda name: None if name == "pettingzoo" else name)
    with pytest.raises(UserError, match=r"^environments need what is not installed here: pip install 'pettingzoo>="):
        parallel_env(scenario())


@pytest.mark.parametrize("links", [None, {}])
def test_agents_keep_the_laws_of_machines(links: Any) -> None:
    parameters = Parameters.model_validate({"message_octets": 4, "transport": {"links": links}})
    check_machine(lambda me, start: AgentMachine(parameters, 3, me, start), events=SPEC.events)


@pytest.mark.parametrize(
    "order",
    [b"", b"fast", AgentMachine.order(Drive(math.nan, 0.0)), AgentMachine.order(Drive(0.5, 0.0), b"much too long")],
)
def test_an_order_that_is_none_becomes_an_event(order: bytes) -> None:
    machine = AgentMachine(Parameters(message_octets=4), 3, 0, 0)
    machine.receive(order, Reception(OPERATOR, False), 5)
    assert machine.events() == [BadBytes(OPERATOR, len(order))]
    assert machine.commands() == machine.outbox() == []
    assert machine.wake_at() is None


def test_who_has_only_heard_a_message_is_not_drained() -> None:
    author, other = (AgentMachine(Parameters(message_octets=4), 3, me, 0) for me in range(2))
    author.receive(AgentMachine.order(Drive(0.0, 0.0), b"here"), Reception(OPERATOR, False), 5)
    author.wake(S)
    (frame,) = author.outbox()
    assert other.receive(frame.payload, Reception(0, True), S) is False
    assert [(each.source, each.payload) for each in other.heard] == [(0, b"here")]
    other.message_octets = 5
    author.receive(AgentMachine.order(Drive(0.0, 0.0), b"more"), Reception(OPERATOR, False), S)
    author.wake(2 * S)
    (frame,) = author.outbox()
    assert other.receive(frame.payload, Reception(0, True), 2 * S), "there is an event"
    assert other.events() == [BadBytes(0, 4)]


def test_a_message_that_no_frame_can_hold_is_refused() -> None:
    with pytest.raises(UserError, match=r"protocol.parameters.message_octets: 200 is not <= 185"):
        scenario(octets=200)


def test_a_piconet_has_at_most_eight_robots() -> None:
    with pytest.raises(UserError, match=r"^protocol.parameters.transport.links: 9 robots"):
        simulate(scenario(9, transport=LINKS), 1)
    with pytest.raises(UserError, match=r"^protocol.parameters.transport.links: 10 robots, a piconet has at most 9"):
        simulate(scenario(10, transport=LINKS, channel={"kind": "ble"}), 1)


# ---------------------------------------------------------------- the contract of PettingZoo


@pytest.fixture(scope="module", autouse=False)
def pettingzoo() -> Any:
    return pytest.importorskip("pettingzoo.test")


VARIANTS: list[Callable[[], Any]] = [
    lambda: parallel_env(scenario()),
    lambda: parallel_env(scenario(1), motion="moves"),
    lambda: parallel_env(scenario(octets=5), motion="moves", ticks_per_step=3),
    lambda: parallel_env(scenario(4, 16, faults=[{"kind": "kill", "robot": 2, "at_s": 1}]), sightings=2),
    lambda: parallel_env(scenario(octets=4, channel={"kind": "adhoc"})),
    lambda: parallel_env(scenario(octets=4, channel={"kind": "bluetooth"}, transport=LINKS, duration_s=12)),
]


@pytest.mark.slow
@pytest.mark.parametrize("make", VARIANTS, ids=["drive", "moves", "messages", "killed", "adhoc", "bluetooth"])
def test_pettingzoo_is_content(make: Callable[[], Any], pettingzoo: Any) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        pettingzoo.parallel_api_test(make(), num_cycles=200)
        pettingzoo.parallel_seed_test(make, num_cycles=50)


@pytest.mark.parametrize("make", VARIANTS[:4], ids=["drive", "moves", "messages", "killed"])
def test_observations_lie_in_their_space(make: Callable[[], Any], pettingzoo: Any) -> None:
    env = make()
    observations, _ = env.reset(seed=5)
    while env.agents:
        assert all(env.observation_space(agent).contains(observations[agent]) for agent in env.agents)
        observations, *_ = env.step({agent: env.action_space(agent).sample() for agent in env.agents})
    assert all(env.observation_space(agent).contains(row) for agent, row in observations.items())


# ---------------------------------------------------------------- time


def test_an_episode_is_truncated_at_the_last_tick_before_the_end(pettingzoo: Any) -> None:
    env = parallel_env(scenario(), ticks_per_step=4)
    _, infos = env.reset()
    times = [infos["robot_0"]["time_s"]]
    while env.agents:
        _, _, terminations, truncations, infos = env.step(standing(env))
        times.append(infos["robot_0"]["time_s"])
    assert times == pytest.approx([0.0, 0.4, 0.8, 1.2, 1.6, 2.0, 2.4, 2.8, 2.9])
    assert all(truncations.values())
    assert not any(terminations.values())


class Line(Referee):
    """Ends the run when a robot is right of a line."""

    def look(self, x_m: Any, y_m: Any, now: int) -> bool:
        return bool((x_m > 2.0).any())

    def verdict(self, now: int) -> dict[str, float]:
        return {}


LINED = replace(SPEC, referee=lambda parameters, size, surroundings: Line())


def test_the_referee_terminates_an_episode_and_rewards_know_the_truth(
    pettingzoo: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("protocols.agents.spec.LINED", LINED, raising=False)
    plain = scenario(2, duration_s=60, protocol={"use": "protocols.agents.spec:LINED"})
    plain = plain.model_copy(update={"team": plain.team.model_copy(update={"starts": ((1.0, 1.0), (1.0, 5.0))})})
    env = parallel_env(plain, reward=lambda before, after: after.positions_m[:, 0] - before.positions_m[:, 0])
    env.reset()
    gained = 0.0
    while env.agents:
        actions = standing(env) | {"robot_1": np.array([0.5, 0.0], np.float32)}
        observations, rewards, terminations, truncations, infos = env.step(actions)
        assert rewards["robot_0"] == 0.0
        gained += rewards["robot_1"]
    assert all(terminations.values())
    assert not any(truncations.values())
    assert 1.0 < gained < 1.06
    assert observations["robot_1"][2] == pytest.approx(1.0 + gained)
    assert 2.0 < infos["robot_0"]["time_s"] < 3.0  # 1 m at 0.5 m/s, and the time to get as fast


def test_moves_are_drives_at_the_limits_of_the_body(pettingzoo: Any) -> None:
    env = parallel_env(scenario(3, duration_s=10), motion="moves")
    before, _ = env.reset(seed=2)
    for _ in range(5):
        after, *_ = env.step({"robot_0": 0, "robot_1": 1, "robot_2": 3})
    assert [after[agent][5] for agent in env.agents] == pytest.approx([0.0, 0.4, 0.0])  # at 1 m/s2, since the second
    assert after["robot_2"][4] > before["robot_2"][4]
    assert (after["robot_2"][2:4] == before["robot_2"][2:4]).all()


def test_who_gets_no_order_goes_on_as_before(pettingzoo: Any) -> None:
    env = parallel_env(scenario())
    env.reset()
    env.step({"robot_0": np.array([0.5, 0.0], np.float32)})
    for _ in range(3):
        observations, *_ = env.step({})
    assert observations["robot_0"][5] > 0.0


# ---------------------------------------------------------------- seeds


def episode(env: Any, seed: int | None, steps: int = 10) -> tuple[int, list[bytes]]:
    observations, infos = env.reset(seed=seed)
    rows = [row.tobytes() for row in observations.values()]
    for step in range(steps):
        octets = bytes([step, 1, 2, 3])
        observations, *_ = env.step(saying(env, "robot_0", octets) | {"robot_1": np.full(7, 0.3, np.float32)})
        rows += [row.tobytes() for row in observations.values()]
    return infos["robot_0"]["seed"], rows


@pytest.mark.parametrize("channel", [{"kind": "ideal", "jitter_s": 0.1, "loss": 0.3}, {"kind": "adhoc"}])
def test_equal_seeds_give_equal_episodes_and_the_next_are_others(channel: Any, pettingzoo: Any) -> None:
    one, other = (parallel_env(scenario(octets=4, channel=channel)) for _ in range(2))
    first = [episode(one, 7), episode(one, None), episode(one, None)]
    assert len({tuple(rows) for _, rows in first}) == 3
    assert [episode(one, 7), episode(one, None)] == first[:2]
    assert episode(other, first[2][0]) == first[2]
    assert first[0][0] == 7


def test_without_any_seed_the_first_is_that_of_the_scenario(pettingzoo: Any) -> None:
    env = parallel_env(scenario(seed=9))
    assert env.reset()[1]["robot_0"]["seed"] == 9
    with pytest.raises(UserError, match=r"^seed: -1 is not >= 0"):
        env.reset(seed=-1)


# ---------------------------------------------------------------- messages


@pytest.mark.parametrize("delay_s", [0.05, 0.25])
def test_a_message_arrives_after_the_delay_of_the_channel(delay_s: float, pettingzoo: Any) -> None:
    env = parallel_env(scenario(octets=4, channel={"kind": "ideal", "delay_s": delay_s}, transport={"spread_s": 0}))
    env.reset()
    actions = saying(env, "robot_1", b"\x00\x80\xfe\xff")
    for step in range(1, 5):
        observations, _, _, _, infos = env.step(actions)
        actions = standing(env)
        age_s = infos["robot_0"]["time_s"] - delay_s
        told = [(1, pytest.approx(age_s, abs=1e-6), b"\x00\x80\xfe\xff")] if age_s > 0.0 else []
        assert heard(env, observations, "robot_0") == heard(env, observations, "robot_2") == told, step
        assert heard(env, observations, "robot_1") == []


def test_over_80211_a_message_takes_the_time_that_its_frame_does(pettingzoo: Any) -> None:
    env = parallel_env(scenario(octets=4, channel={"kind": "adhoc"}, transport={"spread_s": 0}))
    env.reset()
    observations, *_ = env.step(saying(env, "robot_1", b"here"))
    ((source, age_s, payload),) = heard(env, observations, "robot_0")
    assert (source, payload) == (1, b"here")
    assert 0.0 < 0.1 - age_s < 0.01, "a frame lasts from a preamble of 192 us to a few ms"
    assert 0.1 - age_s > 192e-6


def test_a_message_that_is_not_sent_is_not_heard(pettingzoo: Any) -> None:
    env = parallel_env(scenario(octets=4))
    env.reset()
    for _ in range(4):
        actions = saying(env, "robot_1", b"here")
        actions["robot_1"][2] = -1.0
        observations, *_ = env.step(actions)
    assert heard(env, observations, "robot_0") == []


def test_the_latest_messages_stand_first(pettingzoo: Any) -> None:
    env = parallel_env(scenario(octets=1, transport={"spread_s": 0}))
    env.reset()
    for number in range(11):
        observations, *_ = env.step(saying(env, "robot_1", bytes([number])))
    assert [payload[0] for _, _, payload in heard(env, observations, "robot_0")] == [10, 9, 8, 7, 6, 5, 4, 3]


@pytest.mark.slow
def test_over_bluetooth_links_are_up_when_an_episode_begins(pettingzoo: Any) -> None:
    env = parallel_env(scenario(4, 4, channel={"kind": "bluetooth"}, transport=LINKS, duration_s=30))
    observations, infos = env.reset(seed=3)
    assert 1.0 < infos["robot_0"]["time_s"] < 20.0, "three pages take seconds"
    assert all(row[1] == 1.0 for row in observations.values())
    observations, *_ = env.step(saying(env, "robot_2", b"here"))
    for _ in range(5):
        observations, *_ = env.step(standing(env))
    for agent in ("robot_0", "robot_1", "robot_3"):
        assert [(source, payload) for source, _, payload in heard(env, observations, agent)] == [(2, b"here")], agent
    # a slave's message goes by the master
    assert heard(env, observations, "robot_0")[0][1] > heard(env, observations, "robot_1")[0][1]


@pytest.mark.slow
def test_a_run_that_ends_before_it_has_links_is_refused(pettingzoo: Any) -> None:
    env = parallel_env(scenario(4, 4, channel={"kind": "bluetooth"}, transport=LINKS, duration_s=1))
    with pytest.raises(UserError, match=r"^duration_s: 1 s are over before the first step"):
        env.reset()


# ---------------------------------------------------------------- who is seen, and who lives


def test_the_nearest_are_seen_if_there_is_no_room_for_all(pettingzoo: Any) -> None:
    starts = [[1, 1], [5, 5], [2, 1], [1, 3]]
    env = parallel_env(scenario(4, team={"size": 4, "starts": starts}), sightings=2)
    observations, _ = env.reset()
    seen = observations["robot_0"][env.layouts[0].columns["seen"]].reshape(-1, 3)
    assert seen.tolist() == [[2, 2, 1], [3, 1, 3]]


def test_where_nobody_is_seen_the_row_says_so(pettingzoo: Any) -> None:
    env = parallel_env(scenario(team={"size": 3, "starts": [[1, 1], [5, 5], [1, 5]], "sight_range_m": 2}))
    observations, _ = env.reset()
    seen = observations["robot_0"][env.layouts[0].columns["seen"]].reshape(-1, 3)
    assert seen.tolist() == [[-1, 0, 0]] * 2


def test_a_killed_robot_is_flagged_and_its_actions_change_nothing(pettingzoo: Any) -> None:
    ends = []
    for turn in (0.0, 1.0):
        env = parallel_env(scenario(octets=4, faults=[{"kind": "kill", "robot": 1, "at_s": 0.55}], duration_s=5))
        env.reset(seed=4)
        rows, flags = [], []
        while env.agents:
            actions = standing(env)
            if len(flags) > 5:  # it is dead
                actions = saying(env, "robot_1", b"dead")
                actions["robot_1"][:2] = 0.5, turn
            observations, *_ = env.step(actions)
            assert env.agents in ([], env.possible_agents)
            flags.append(observations["robot_1"][0])
            rows.append([row.tobytes() for row in observations.values()])
        assert flags == [1.0] * 5 + [0.0] * 44
        assert all(observations[agent][0] == 1.0 for agent in ("robot_0", "robot_2"))
        assert heard(env, observations, "robot_0") == []
        ends.append(rows)
    assert ends[0] == ends[1]


# ---------------------------------------------------------------- mistakes


@pytest.mark.parametrize("action", [[0.0], [0.0, np.nan], [0.0, 0.0, 1.0], "ahead", None])
def test_what_is_no_action_is_told_in_one_line(action: Any, pettingzoo: Any) -> None:
    env = parallel_env(scenario())
    env.reset()
    with pytest.raises(UserError, match=r"^robot_1: the action .* is none of Box"):
        env.step({"robot_1": action})


@pytest.mark.parametrize("action", [5, -1, 0.5])
def test_what_is_no_move_is_told_in_one_line(action: Any, pettingzoo: Any) -> None:
    env = parallel_env(scenario(), motion="moves")
    env.reset()
    with pytest.raises(UserError, match=r"^robot_0: the action .* is none of Discrete\(5\)"):
        env.step({"robot_0": action})


@pytest.mark.parametrize(
    ("terms", "told"),
    [
        ({"motion": "fly"}, "motion: 'fly' is not drive or moves"),
        ({"ticks_per_step": 0}, "ticks_per_step: 0 is not >= 1"),
        ({"sightings": -1}, "sightings: -1 is not >= 0"),
    ],
)
def test_terms_that_cannot_be_are_told_in_one_line(terms: Any, told: str, pettingzoo: Any) -> None:
    with pytest.raises(UserError, match=f"^{told}$"):
        parallel_env(scenario(), **terms)


def test_a_protocol_that_takes_no_orders_is_named(pettingzoo: Any) -> None:
    with pytest.raises(UserError, match=r"^protocol.use: monitoring takes no orders"):
        parallel_env(scenario(protocol={"use": "monitoring"}))
