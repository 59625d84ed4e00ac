"""A run on the wall clock whose machines are processes that talk by UDP over the loopback interface: ``cosim live``.

One process holds bodies, world and judge, a :class:`cosim.simulation.Simulation` that is advanced as time goes by
(``team``). Each machine is a process of its own (``robot``): it gets by a pipe what its robot senses and what becomes
of links and payloads, and leaves there what it wants driven, linked and recorded. Payloads go from socket to socket,
from 127.0.0.1 to 127.0.0.1. Links, reach and the fates of payloads are those of the ideal channel (``loopback``), which
carries nothing here. Machines that share anything but messages are found beforehand (``apart``), and refused.
"""
