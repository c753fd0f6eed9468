"""The variables of SteadyLQG: those of RobustLQG, without what limits a part in time or keeps the dither on."""

from __future__ import annotations

from controller_fmu.robust_c.interface import ROWS as ROBUST_ROWS

LEFT_OUT = ("spent", "dither_time", "sway", "sway_share", "peak_time", "peak_regain")

ROWS = tuple(row for row in ROBUST_ROWS if row.name not in LEFT_OUT)
"""The variables in the order of their value references."""
