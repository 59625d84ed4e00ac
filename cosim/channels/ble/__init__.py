"""Bluetooth Low Energy (Core v5.x, Vol 6, Parts A and B): its layers, which are pure, and the channel made of them.

The layers know no clock and no air. ``phy`` has air times, ``channels`` numbers and frequencies, ``bits`` what is in
packets; ``selection`` says on which channel a connection event is. ``advertising`` and ``scanning`` say when a device
is heard that is not connected, and ``connections`` is about those that are.

The channel begins with ``channel``. Each robot has a ``device`` with one ``antenna``; others meet it as a ``station``,
which advertises by its ``beacon``. ``discovery`` looks for such, ``session`` runs a connection, ``broadcasts`` sends
to everyone. What is sent goes through the ``ether``, what comes of it to the ``hosts``.

A peer's bad octets raise WireError wherever they are decoded; what cannot be encoded raises ValueError.
"""
