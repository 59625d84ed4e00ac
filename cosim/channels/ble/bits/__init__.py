"""What is in packets of Bluetooth Low Energy, octet by octet, and what breaks it.

Begin with ``pdu``: advertising, scanning, and the header of what goes over connections. ``control`` and ``l2cap`` are
what connections carry. ``crc`` and ``whitening`` are put around all of it on the air; ``access`` tells which access
addresses there are.

``errors`` says how often bits are wrong, and which part of a packet that breaks.
"""
