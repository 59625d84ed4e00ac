"""Whom the air of Bluetooth tells of what is on it.

``tenancy`` are radios of other kinds, in an air that they share; ``metering`` counts how long each radio has done what,
for the energy that it takes.
"""
