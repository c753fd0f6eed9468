"""The manipulator in C: equal to the Python plant to the last bit, and fast in any tool.

The sources are twins of the modules of ``flexible_manipulator``; :mod:`.interface` writes what both have in common.
"""
