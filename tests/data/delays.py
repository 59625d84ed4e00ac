"""Functions for experiments that are no runs of robots."""

import time

from cosim.experiment import experiment_function


@experiment_function
def metrics(parameters, seed):
    """Return metrics; the seed and the parameters decide them."""
    if parameters["size"] == parameters.get("broken"):
        raise ZeroDivisionError("nobody is there")
    return {"delay_s": parameters["size"] * 0.5 + seed, "rounds": 2 * parameters["size"]}


@experiment_function
def observations(parameters, seed):
    """Return a row for each robot."""
    return [{"robot": robot, "slots": 2 * robot + seed, "kind": "poll"} for robot in range(parameters["size"])]


@experiment_function
def slow(parameters, seed):
    """Return metrics after a while."""
    time.sleep(parameters["wait_s"])
    return {"delay_s": float(seed)}


@experiment_function
def slowly_observed(parameters, seed):
    """Return two rows after a while."""
    time.sleep(parameters["wait_s"])
    return [{"robot": robot, "slots": 2 * robot + seed} for robot in range(2)]


@experiment_function
def leaving(parameters, seed):
    """Leave the process with the first seed."""
    if seed == 1:
        raise SystemExit("as a script does")
    return {"delay_s": float(seed)}
