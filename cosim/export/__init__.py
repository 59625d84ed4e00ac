"""Captures: the frames of a run in the format that Wireshark and tshark read.

``capture`` is where to begin: it puts the radios of a run side by side into one file. ``pcapng`` writes the blocks of
the file, ``baseband`` the packets of Bluetooth radios (LINKTYPE_BLUETOOTH_BREDR_BB), ``ieee80211`` the frames of
802.11 radios (LINKTYPE_IEEE802_11) with routing and payloads inside.
"""
