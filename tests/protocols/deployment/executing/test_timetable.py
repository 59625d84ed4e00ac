"""Windows: what can be kept is kept, and what breaks is named."""

import pytest
from hypothesis import strategies as st

from cosim.units import S, from_seconds
from protocols.deployment.tasks.plan import Between, Go, Instant, Plan, Task, Wait
from tests.protocols.deployment.plan_strategies import betweens
from tests.protocols.deployment.play_scene import Scene, Troubles, crew_of
from tests.tiers import tiers

Times = dict[tuple[str, str], float]
"""When the instants of a plan are, in s."""


def go(name: str, robot: int = 0, x_m: float = 5.0) -> Task:
    return Task(name=name, act=Go(robot=robot, place_m=(x_m, 0.0)))


def wait(name: str, seconds: float) -> Task:
    return Task(name=name, act=Wait(seconds=seconds))


def serial(name: str, *subtasks: Task) -> Task:
    return Task(name=name, subtasks=subtasks)


def parallel(name: str, *subtasks: Task) -> Task:
    return Task(name=name, order="parallel", subtasks=subtasks)


def instant(text: str) -> Instant:
    task, _, edge = text.partition(".")
    return Instant(task=task, edge=edge or "start")  # type: ignore[arg-type]


def between(earlier: str, later: str, least: float = 0.0, most: float | None = None) -> Between:
    return Between(earlier=instant(earlier), later=instant(later), at_least_s=least, at_most_s=most, why="the test")


def run(root: Task, *constraints: Between, **troubles: object) -> Scene:
    plan = Plan(number=1, play="windows", robots=(0, 1, 2, 3), root=root, constraints=constraints)
    return Scene(plan, crew_of(4), troubles=Troubles(**troubles)).run()  # type: ignore[arg-type]


def times_of(scene: Scene) -> Times:
    assert scene.executive is not None
    times: Times = {("", "start"): 0.0, ("", "end"): 0.0}
    for node in scene.executive.progress.tree.root.walk():
        if node.began is not None and node.ended is not None:
            times |= {(node.name, "start"): node.began / S, (node.name, "end"): node.ended / S}
    return times


def violated(times: Times, constraints: tuple[Between, ...]) -> set[int]:
    """Return the constraints that were not kept, exact to the nanosecond."""
    broken = set[int]()
    for number, each in enumerate(constraints):
        gap = from_seconds(times[each.later.task, each.later.edge]) - from_seconds(
            times[each.earlier.task, each.earlier.edge]
        )
        late = each.at_most_s is not None and gap > from_seconds(each.at_most_s)
        if gap < from_seconds(each.at_least_s) or late:
            broken.add(number)
    return broken


def broken(scene: Scene) -> list[int]:
    return [breach.constraint for breach in scene.breaches]


# ---------------------------------------------------------------- one by one


def test_a_task_starts_ten_seconds_after_another():
    scene = run(parallel("root", go("a"), go("b", 1)), between("a", "b", 10.0))
    assert times_of(scene)["b", "start"] == 10.0
    assert not scene.breaches


def test_a_task_starts_when_another_has_ended():
    scene = run(parallel("root", go("a"), go("b", 1)), between("a.end", "b"))
    times = times_of(scene)
    assert times["b", "start"] == times["a", "end"] > 4.0


def test_an_end_is_held_until_its_window_opens():
    scene = run(serial("root", go("a"), go("b", 1)), between("", "a.end", 30.0))
    assert times_of(scene)["a", "end"] == times_of(scene)["b", "start"] == 30.0


def test_what_something_is_to_follow_soon_waits_until_that_can():
    """a could start at once, but b cannot before 20 s, and is to start at most 5 s after a's end."""
    scene = run(parallel("root", wait("a", 2), wait("b", 1)), between("", "b", 20.0), between("a.end", "b", 0.0, 5.0))
    assert not scene.breaches
    assert times_of(scene)["a", "end"] == 15.0


def test_a_missed_deadline_is_reported_when_it_is_missed_and_not_before():
    scene = run(go("a", x_m=20.0), between("", "a.end", 0.0, 12.0))
    assert [(breach.constraint, breach.at) for breach in scene.breaches] == [(0, 12 * S + 1)]
    assert "the test" in scene.breaches[0].why
    assert scene.executive is not None
    assert scene.executive.states["root" if "root" in scene.executive.states else "a"] == "done"


def test_a_deadline_that_cannot_be_kept_any_more_is_reported_before_it_has_passed():
    """After a, b waits for 10 s: as a has not ended at 5 s, the end is not there at 15 s."""
    scene = run(serial("root", go("a", x_m=20.0), wait("b", 10)), between("", "root.end", 0.0, 15.0))
    assert [(breach.constraint, breach.at) for breach in scene.breaches] == [(0, 5 * S + 1)]


@pytest.mark.parametrize("order", [1, -1])
def test_a_wait_that_was_cut_short_hides_no_missed_deadline(order: int):
    short = wait("a", 9).model_copy(update={"time_out_s": 3.0, "on_failure": "skip"})
    root = parallel("root", *[short, go("b", 1, 20.0)][::order])
    scene = run(root, between("", "b.end", 0.0, 5.0))
    assert times_of(scene)["a", "end"] == 3.0
    assert [(breach.constraint, breach.at) for breach in scene.breaches] == [(0, 5 * S + 1)]


def test_windows_that_contradict_each_other_are_reported_at_once():
    scene = run(parallel("root", wait("a", 1), wait("b", 1)), between("a", "b", 10.0), between("a", "b.end", 0.0, 5.0))
    assert [(breach.constraint, breach.at) for breach in scene.breaches] == [(1, 0)]
    assert times_of(scene)["b", "start"] == 10.0


def test_tasks_that_wait_for_each_other_do_not_wait_for_ever():
    scene = run(parallel("root", go("a"), go("b", 1)), between("a.end", "b"), between("b.end", "a"))
    assert len(scene.breaches) == 1


def test_tasks_that_start_at_one_instant_may_wait_for_each_other():
    for constraints in ((between("a", "b", 0.0, 0.0),), (between("a", "b"), between("b", "a"))):
        scene = run(parallel("root", go("a"), go("b", 1), go("c", 2)), *constraints)
        assert not scene.breaches
        assert times_of(scene)["a", "start"] == times_of(scene)["b", "start"]


def test_who_goes_first_of_those_that_may_be_at_once_breaks_no_window_that_held_nobody():
    scene = run(wait("root", 0), between("root", "root.end", 0.0, 0.0), between("root.end", "root"))
    assert not scene.breaches
    assert times_of(scene)["root", "start"] == times_of(scene)["root", "end"]


def test_who_goes_first_of_those_that_may_be_at_once_waits_until_the_other_can_follow():
    """The part may not end before the whole, and the whole not before 1 s."""
    scene = run(parallel("root", wait("a", 0)), between("", "root.end", 1.0), between("root.end", "a.end"))
    assert not scene.breaches
    assert times_of(scene)["a", "end"] == times_of(scene)["root", "end"] == 1.0


def test_only_what_holds_a_task_up_is_given_up():
    """The windows of the whole play's end are not to blame."""
    root = parallel("root", serial("s", go("a"), go("c", 2)), go("b", 1))
    scene = run(root, between("c.end", "root.end", 2.0), between("a.end", "b", 1.0), between("b.end", "a", 1.0))
    assert set(broken(scene)) < {1, 2}


def test_a_window_on_a_task_that_never_starts_is_void():
    root = parallel("root", go("a"), Task(name="b", subtasks=(go("b1", 1, 50.0), go("b2", 1)), ends_with="a"))
    scene = run(root, between("b2", "a.end", -99.0, 1.0), between("", "b2.end", 0.0, 6.0))
    assert not scene.breaches


def test_who_takes_over_knows_which_windows_have_broken():
    scene = run(serial("root", go("a", x_m=20.0), go("b", 1)), between("", "a.end", 0.0, 9.0), hosts=(15.0,))
    assert set(broken(scene)) == {0}


# ---------------------------------------------------------------- in general


@st.composite
def waits(draw: st.DrawFn, name: str = "root", depth: int = 2) -> Task:
    if depth == 0 or draw(st.integers(0, 3)) == 0:
        return wait(name, draw(st.integers(0, 9)))
    size = draw(st.integers(1, 3))
    subtasks = [draw(waits(f"{name}/{number}", depth - 1)) for number in range(size)]
    return (serial if draw(st.booleans()) else parallel)(name, *subtasks)


def witness(task: Task, start_s: int, draw: st.DrawFn, times: Times) -> int:
    """Fill *times* with some execution of a tree of waits, with idle times anywhere, and return its end."""
    late = st.integers(0, 5)
    times[task.name, "start"] = at_s = start_s + draw(late)
    end_s = at_s + (int(task.act.seconds) if isinstance(task.act, Wait) else 0)
    for each in task.subtasks:
        child_s = witness(each, at_s, draw, times)
        end_s = max(end_s, child_s)
        at_s = child_s if task.order == "serial" else at_s
    times[task.name, "end"] = end_s = end_s + draw(late)
    return end_s


@tiers(40, 200, st.data(), waits())
def test_a_plan_that_can_be_executed_within_its_windows_is(data: st.DataObject, root: Task):
    times: Times = {("", "start"): 0.0}
    witness(root, 0, data.draw, times)
    pairs = data.draw(st.lists(st.tuples(*2 * [st.sampled_from(sorted(times))]), max_size=6))
    slack = st.integers(0, 3)
    constraints = []
    for a, b in pairs:
        gap = times[b] - times[a]
        if gap >= 0:
            most = None if data.draw(st.booleans()) else gap + data.draw(slack)
            constraints.append(between(".".join(a), ".".join(b), max(gap - data.draw(slack), 0.0), most))
    scene = run(root, *constraints)
    assert not scene.breaches
    assert not violated(times_of(scene), tuple(constraints))


@st.composite
def lively(draw: st.DrawFn, name: str = "root", depth: int = 2) -> Task:
    if depth == 0 or draw(st.integers(0, 3)) == 0:
        robot, x_m = draw(st.integers(0, 3)), draw(st.integers(-9, 9))
        return draw(st.sampled_from([wait(name, draw(st.integers(0, 9))), go(name, robot, x_m)]))
    size = draw(st.integers(1, 3))
    subtasks = [draw(lively(f"{name}/{number}", depth - 1)) for number in range(size)]
    return (serial if draw(st.booleans()) else parallel)(name, *subtasks)


@tiers(40, 200, st.data(), lively())
def test_what_broke_is_reported_and_nothing_else(data: st.DataObject, root: Task):
    names = [task.name for task in root.walk()]
    constraints = tuple(data.draw(st.lists(betweens(names), min_size=1, max_size=4)))
    scene = run(root, *constraints)
    really = violated(times_of(scene), constraints)
    assert really <= set(broken(scene))
    if len(scene.breaches) == 1:
        assert really == set(broken(scene))


def test_the_oracle_sees_a_violation():
    times: Times = {("", "start"): 0.0, ("a", "start"): 4.0}
    assert violated(times, (between("", "a", 5.0), between("", "a", 0.0, 3.0), between("", "a", 1.0, 4.0))) == {0, 1}
    with pytest.raises(KeyError):
        violated(times, (between("", "b"),))
