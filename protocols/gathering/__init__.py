"""Gathering: all robots come together round the most central of them, step by step.

This is a second application of Pseudonet: the messages, the exchanges and the piconets are those of
``protocols.pseudonet``, and only the coordination layer is replaced. Begin with ``gathering``, which holds that layer
with the argument why it ends; ``spec`` names the protocol to cosim, and its referee measures how close the bodies are.
"""
