"""Bluetooth Basic Rate (Core v1.2, Vol 2 Part B) to the half-slot: devices, piconets and scatternets.

Begin with ``device``, the channel, and ``controller``, one robot's device: it inquires (``inquiry``), pages
(``paging``), is the master of its own piconet and a slave in others'. ``piconet`` has the links of one master; its
parts ``schedule``, ``slots``, ``modes`` and ``afh`` work on the one ``PiconetState`` of ``state``, which holds
``links`` and ``queues``. ``transport`` is the line from a device to its host.

All devices are on one air (``radio``). Its arithmetic is compiled: ``medium`` (which frames overlap, what survives),
``band`` and ``polling`` (idle piconets, advanced together), ``hopping``, ``scanning`` and ``errors``. Nothing is
scheduled for an idle slot; slow oracles in ``tests/oracles`` say the same slot by slot. ``reporting`` has who is told
of what is on the air: radios of other kinds, and the meter of what it takes. ``bits`` has the packets bit by bit.
"""
