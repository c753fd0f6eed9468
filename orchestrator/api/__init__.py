"""The use cases: evaluate, simulate, check, compare."""
