"""Transport: how robots exchange messages over any channel, and how they keep the links that a channel needs.

- ``transport``, where to begin: ``Transport`` carries messages of any size to one robot, reliably and in order, and
  publishes values of which only the latest of each topic counts; ``parameters`` is what a scenario can set.
- ``frames``: what transports put on the wire, byte by byte; ``streams``: acknowledgement, loss and retransmission of
  the messages to and from one other robot; ``sending``: what waits to be sent, and in which order.
- ``links``: a piconet of known members for radios such as Bluetooth's, in which another robot becomes the master when
  the master dies, if wanted. A transport uses it where ``parameters.links`` is set; a protocol with frames of its own
  can hold one itself (``protocols.mapping``).
- ``meeting``: links to robots that come into sight and were not known before (``protocols.reflection``).

``examples/election/leader_election.py`` is a small protocol on it; ``protocols.deployment.runner`` is a large one.
"""
