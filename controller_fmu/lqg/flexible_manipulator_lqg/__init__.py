"""The LQG controller for the flexible manipulator: the variables of its FMUs, and the design.

The package travels inside the FMU's resources and imports nothing but the standard library and NumPy.
"""
