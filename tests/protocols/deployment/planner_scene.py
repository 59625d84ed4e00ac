"""Calls that are refused, and what is offered to mend them, done as a person would do it."""

import re
from pathlib import Path
from typing import Any

import yaml

from protocols.deployment.planning.planner import Refusal
from protocols.deployment.tasks.plan import Plan
from tests.protocols.deployment.plays_scene import BODY, Scene, playbook_of

NEAR_FAR = [[5.0, 0.0], [10.0, 0.0]]
WEAN = {"crossing": [10, 0], "leap_places": [[20, 0], [30, 0]], "group_places": [[10, 10], [10, 20]]}


def scene_of(folder: Path, play: dict[str, Any], **more: Any) -> Scene:
    """Return a scene with a play that is called ``mine``."""
    (folder / "mine.yaml").write_text(yaml.safe_dump(play))
    return Scene(playbook=playbook_of(folder), **more)


def applied(scene: Scene, mend: str, play: str, **more: Any) -> Plan | Refusal:
    """Do what a mend says, as a person would, and call again."""
    for part in mend.split("; and "):
        if found := re.search(r"ends at most ([\d.]+) s after the plan begins", part):
            task = re.search(r"the call: (\S+) ends", part)
            assert task is not None
            more["constraints"] = [
                each | {"seconds": float(found[1])}
                if each["kind"] == "deadline" and task[1].endswith(each.get("task", ""))
                else each
                for each in more["constraints"]
            ]
        elif found := re.search(r"(\d+) more robots?", part):
            for _ in range(int(found[1])):
                scene.join(BODY._replace(radius_m=0.2, camera="camera" in part))
                if "robots" in more:
                    more["robots"] = [*more["robots"], len(scene.crew.bodies) - 1]
        elif part.startswith("without: the call: "):
            (dropped,) = [each for each in more["constraints"] if part.endswith(f"{each['first']} ends")]
            more["constraints"] = [each for each in more["constraints"] if each != dropped]
        elif "may take part" in part:
            del more["robots"]
        elif "the planner chooses" in part:
            del more["roles"]
        elif found := re.search(r"(\S+) after (\S+)$", part):
            then, first = (name.removeprefix("mine/") for name in found.groups())
            more["constraints"] = [*more.get("constraints", []), {"kind": "before", "first": first, "then": then}]
        elif found := re.search(r"at most ([\d.]+) m apart", part):
            more["parameters"] = more["parameters"] | {"apart_m": float(found[1])}
        elif found := re.search(r"\(([-\d.]+), ([-\d.]+)\) instead of", part):
            more["places"] = [[float(found[1]), float(found[2])], *more["places"][1:]]
        elif found := re.search(r"times out after ([\d.]+) s", part):
            more["parameters"] = more["parameters"] | {"patience_s": float(found[1])}
        else:
            raise AssertionError(part)
    return scene.call(play, **more)


def assert_mends(scene: Scene, play: str, count: int | None, **more: Any) -> Refusal:
    """Assert that a call is refused, with so many mends, each of which is true; but those of the play are not tried.

    A call that is offered instead gives a plan.
    """
    refusal = scene.refusal(play, **more)
    assert len(refusal.mend) == count or count is None, refusal
    assert refusal.calls.keys() <= {*refusal.mend}
    for text, call in refusal.calls.items():
        assert isinstance(scene.planner.call(call, scene.starts_m, 7), Plan), text
    crew, starts_m = scene.crew, dict(scene.starts_m)
    for mend in refusal.mend:
        if mend.removeprefix("without: ").startswith(f"{play}: "):
            continue
        assert isinstance(applied(scene, mend, play, **more), Plan), mend
        scene.crew, scene.starts_m = crew, dict(starts_m)
        scene.planner = scene._planner()
    return refusal


def schedule(plan: Plan, scene: Scene) -> dict[tuple[str, str], float]:
    """Return the earliest times of all starts and ends."""
    windows = scene.planner.windows_s(plan, scene.starts_m)
    times = {(point.task, point.edge): earliest for point, (earliest, _) in windows.items()}
    assert all(latest is None or latest >= times[p.task, p.edge] - 1e-9 for p, (_, latest) in windows.items())
    return {point: time for point, time in times.items() if time is not None}
