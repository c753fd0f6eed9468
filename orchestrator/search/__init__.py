"""The search for the worst case: which member of the uncertainty description a controller fails with."""
