"""Robust control benchmark of a flexible manipulator: closed-loop co-simulation of a plant and a controller FMU."""

__version__ = "0.1.0"
