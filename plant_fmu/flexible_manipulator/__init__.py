"""Two links on elastic, frictional gears: parameters, equations of motion, kinematics, integration, FMI slave.

The package travels inside the FMU's resources and imports nothing but the standard library, NumPy and,
where it is installed, Numba.
"""
