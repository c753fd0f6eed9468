"""What the tuning scripts share: a fast closed loop, the benchmark's cases, linear stability, the search itself.

Here alone a controller's folder meets the plant and the protocol; no FMU contains any of it.
"""
