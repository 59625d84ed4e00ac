"""What is in packets of Bluetooth Mesh (Mesh Profile 1.0, section 3), layer by layer.

From the air inwards: ``bearer``, ``network``, ``lower_transport``, ``upper_transport``. Numbers go most significant
octet first. Nothing is encrypted, nor made unreadable: the octets of the integrity checks count, and are 0.
"""
