"""Closed-loop co-simulation of one plant FMU and one controller FMU."""
