"""What carries bytes between robots: a channel says when a payload arrives and where, or why it does not.

Begin with ``base``: the contract of a channel and of the endpoints that it delivers to. ``ideal`` is the null model
that all radios are compared with, and the smallest channel to read; ``vision`` sends along lines of sight. The two
models of real radios are packages: ``bluetooth`` (piconets and scatternets, to the half-slot), ``ble`` (Bluetooth Low
Energy, to the packet) and ``adhoc`` (IEEE 802.11 with routing). ``radios`` gives each robot several channels at once.

Shared by the radios are ``propagation``, the gains between robots in a building, and ``jamming``, the transmitters that
disturb; ``clock`` and ``reach``, which are Bluetooth's and Low Energy's. ``air`` is a band that radios of several
technologies can share; ``ble`` alone is in it yet. A channel knows robots by address and position only; it knows no
protocol, no body and no other channel.
"""
