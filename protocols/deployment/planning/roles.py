"""The assignment of robots to roles: that of least route cost among the robots that can (paper 004, section 4).

MACBeth "fills in these missing details by querying the route planner for routes for each robot to each destination, and
then chooses the lowest-cost robot-to-destination assignment". If there is none, some k roles have fewer than k robots
between them (Hall's theorem); these are named, with the reason for each robot that cannot play them.
"""

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple, TypeAlias

import networkx as nx
import numpy as np
from scipy.optimize import linear_sum_assignment

from cosim.machine import Address
from protocols.deployment.planning.binding import Role
from protocols.deployment.planning.play import Needs
from protocols.deployment.tasks.crew import Body

Prices: TypeAlias = Mapping[tuple[str, Address], float | str]
"""Cost of each robot in each role, or the reason why it cannot play that."""


class Shortage(NamedTuple):
    """Some *roles* that have too few robots."""

    roles: tuple[str, ...]
    robots: tuple[Address, ...]
    """All robots that can play any of these."""
    lacking: tuple[str, ...]
    """Roles among these that remain without a robot, as few as possible."""
    reasons: tuple[str, ...]
    """Reasons why the other robots cannot, each once."""


def unfit(needs: Sequence[Needs], robot: Address, body: Body) -> str | None:
    """Return why a robot cannot play a role with these *needs*; None if it can."""
    for need in needs:
        if need.camera and not body.camera:
            return f"robot {robot} has no camera"
        if need.sensor is not None and need.sensor != body.sensor:
            return f"robot {robot} has a {body.sensor}, no {need.sensor}"
        if need.passage_m is not None and 2.0 * body.radius_m > need.passage_m:
            return f"robot {robot} is {2.0 * body.radius_m:g} m wide, too wide for a passage of {need.passage_m:g} m"
    return None


def wanted(needs: Sequence[Needs]) -> str:
    """Return a description of a robot that fits *needs*."""
    what = ["a robot"]
    if any(need.camera for need in needs):
        what.append("with a camera")
    what += sorted({f"with a {need.sensor}" for need in needs if need.sensor is not None})
    passages_m = [need.passage_m for need in needs if need.passage_m is not None]
    if passages_m:
        what.append(f"at most {min(passages_m):g} m wide")
    return " ".join(what)


def assigned(roles: Sequence[Role], robots: Sequence[Address], prices: Prices) -> dict[str, Address] | Shortage:
    """Return the robot of each role so that the sum of *prices* is least; or the roles that have too few robots.

    Among several such assignments always the same one is returned.
    """
    costs = np.array([[_price(prices[role.name, robot]) for robot in robots] for role in roles])
    costs = costs.reshape(len(roles), len(robots))
    # first, as the assignment raises an error where there is none of finite cost
    shortage = _shortage(roles, robots, prices)
    if shortage is not None:
        return shortage
    rows, columns = linear_sum_assignment(costs)
    return {roles[row].name: robots[column] for row, column in zip(rows.tolist(), columns.tolist(), strict=True)}


def _price(price: float | str) -> float:
    return math.inf if isinstance(price, str) else price


def _shortage(roles: Sequence[Role], robots: Sequence[Address], prices: Prices) -> Shortage | None:
    """Return the roles without a robot, with those whose robots could play them instead; None if all have robots."""
    able = {role.name: [robot for robot in robots if not isinstance(prices[role.name, robot], str)] for role in roles}
    graph: nx.Graph[str | Address] = nx.Graph()
    graph.add_nodes_from(able)
    graph.add_edges_from((name, robot) for name, fit in able.items() for robot in fit)
    matching = nx.bipartite.maximum_matching(graph, top_nodes=list(able))
    lacking = [name for name in able if name not in matching]
    if not lacking:
        return None
    # roles on alternating paths from the unmatched ones compete for the same robots (Hall's theorem)
    short, ahead = dict.fromkeys(lacking), list(lacking)
    while ahead:
        for robot in able[ahead.pop()]:
            other = matching[robot]
            if other not in short:
                short[other] = None
                ahead.append(other)
    fit = sorted({robot for name in short for robot in able[name]})
    found = [prices[name, robot] for name in able if name in short for robot in robots]
    reasons = tuple(dict.fromkeys(why for why in found if isinstance(why, str)))
    return Shortage(tuple(name for name in able if name in short), tuple(fit), tuple(lacking), reasons)
