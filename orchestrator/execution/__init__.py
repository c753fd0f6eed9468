"""Running many simulations, each group in a process of its own."""
