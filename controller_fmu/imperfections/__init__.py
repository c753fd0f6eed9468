"""What stands between controller and plant in the benchmark's master loop, as an FMU of its own: a twin in C of
``orchestrator/loop/closed_loop.py``, of the signals and of the noise there.
"""
