"""Basic Rate bit by bit: the packets that ``cosim.channels.bluetooth`` sends, as a receiver of the real air has them.

A run needs none of this: it computes with lengths and probabilities. The export for Wireshark writes packets with it,
and tests compare the tables of ``packets`` and ``errors`` with it.

Begin with ``packet``: whole packets to bits and back. ``codes`` has the codes that they are made of: access code,
header error check, CRC, whitening and the two forward error corrections.
"""
