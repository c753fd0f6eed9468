"""Studies: what is asked of a controller, as computations that ask for simulations, and the engine that runs them."""
