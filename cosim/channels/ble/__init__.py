"""Bluetooth Low Energy (Core v5.x, Vol 6, Parts A and B), one file a layer of the specification; all of it is pure.

Begin with ``pdu``: what is in the packets of advertising, scanning and connections. Below it are ``phy`` (air times),
``channels`` (numbers and frequencies), ``access`` (access addresses), ``crc`` and ``whitening``; ``channel_map`` and
``selection`` say on which channel a connection event is.

``advertising`` and ``scanning`` say when a device is heard that is not connected.

A connection is a ``link`` of two ends, each with its ``arq``: ``parameters`` and ``anchors`` say when its events are,
``exchange`` goes through one, ``connection`` when it changes or is given up. ``l2cap`` and ``control`` are what its
PDUs carry, and ``capacity`` is how much of that fits. No channel of a scenario is made of all this yet.

A peer's bad octets raise WireError wherever they are decoded; what cannot be encoded raises ValueError.
"""
