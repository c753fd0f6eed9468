"""FMUs of all kinds: archives, descriptions, connectors, units, and calls of their C functions."""
