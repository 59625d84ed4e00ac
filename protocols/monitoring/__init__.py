"""Monitoring: robots send heartbeats, and each decides by a failure detector which of the others have failed.

It is the smallest protocol here and a good one to read first. ``spec`` names it to cosim, with its metrics and its
referee; ``machine`` holds one robot's machine, with what a scenario sets and what a trace shows; ``heartbeats`` is its
only message, byte by byte. The detectors themselves are in ``protocols.detection``.
"""
