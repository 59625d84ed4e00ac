"""Random plans: trees of drives, pictures, waits, explorations and deployments, with constraints."""

from hypothesis import strategies as st

from protocols.deployment.tasks.plan import Between, Deployment, Explore, Go, Instant, Photo, Plan, Task, Wait

ROBOTS = st.integers(0, 3)
PLACE = st.tuples(st.integers(-8, 8).map(float), st.integers(-8, 8).map(float))
FAILURES = st.sampled_from(["fail", "skip", "retry"])


@st.composite
def deployments(draw: st.DrawFn) -> Deployment:
    robots = draw(st.lists(ROBOTS, min_size=1, max_size=4, unique=True))
    places = draw(st.lists(PLACE, min_size=len(robots), max_size=len(robots), unique=True))
    strategy = draw(st.sampled_from(["group", "wave", "leap_frog"]))
    return Deployment(strategy=strategy, robots=tuple(robots), places_m=tuple(places), augmented=draw(st.booleans()))


ACTS = st.one_of(
    st.builds(Go, robot=ROBOTS, place_m=PLACE),
    st.builds(Photo, robot=ROBOTS),
    st.builds(Wait, seconds=st.integers(0, 9).map(float)),
    st.builds(Explore, robots=st.lists(ROBOTS, min_size=1, max_size=3, unique=True).map(tuple)),
    deployments(),
)


@st.composite
def tasks(draw: st.DrawFn, name: str, depth: int, deadlines: bool) -> Task:
    changes: dict[str, object] = {"on_failure": draw(FAILURES)}
    if deadlines and draw(st.integers(0, 3)) == 0:
        changes["time_out_s"] = float(draw(st.integers(1, 60)))
    if depth == 0 or draw(st.booleans()):
        return Task(name=name, act=draw(ACTS), **changes)  # type: ignore[arg-type]
    size = draw(st.integers(1, 3))
    subtasks = tuple(draw(tasks(f"{name}/{number}", depth - 1, deadlines)) for number in range(size))
    order = draw(st.sampled_from(["serial", "parallel"]))
    return Task(name=name, order=order, subtasks=subtasks, **changes)  # type: ignore[arg-type]


@st.composite
def plans(draw: st.DrawFn, windows: bool = True, deadlines: bool = True, enders: bool = True) -> Plan:
    """A plan for robots 0 to 3."""
    root = draw(tasks("play", draw(st.integers(0, 3)), deadlines))
    names = [task.name for task in root.walk()]
    if enders and len(names) > 1 and draw(st.booleans()):
        ending, ended = draw(st.sampled_from(names)), draw(st.sampled_from(names[1:]))
        root = _ending(root, ended, ending)
    constraints = draw(st.lists(betweens(names), max_size=3)) if windows else []
    return Plan(
        number=draw(st.integers(0, 3)), play="random", robots=(0, 1, 2, 3), root=root, constraints=tuple(constraints)
    )


def _ending(task: Task, ended: str, ending: str) -> Task:
    subtasks = tuple(_ending(each, ended, ending) for each in task.subtasks)
    changes: dict[str, object] = {"subtasks": subtasks}
    if task.name == ended:
        changes["ends_with"] = ending
    return task.model_copy(update=changes)


@st.composite
def betweens(draw: st.DrawFn, names: list[str]) -> Between:
    edge = st.sampled_from(["start", "end"])
    earlier = Instant(task=draw(st.sampled_from(["", *names])), edge=draw(edge))
    later = Instant(task=draw(st.sampled_from(names)), edge=draw(edge))
    least = float(draw(st.integers(0, 20)))
    most = draw(st.one_of(st.none(), st.integers(0, 20).map(lambda more: least + more)))
    return Between(earlier=earlier, later=later, at_least_s=least, at_most_s=most, why="a test")
