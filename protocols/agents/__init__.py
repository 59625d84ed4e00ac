"""Agents: robots that decide nothing themselves; what they are to do comes by the cable of their consoles, every step.

``cosim.env.parallel_env`` makes an environment for reinforcement learning of a scenario with this protocol: a policy
outside sees what the robots observe and hear, and gives the orders. ``machine`` holds a robot's machine, which drives
as it is ordered and publishes messages by the shared transport (so that it runs over any channel, and keeps links where
radios need them); ``spec`` names it to cosim. A spec of one's own may have another referee:
``dataclasses.replace(SPEC, referee=...)``.
"""
