"""Studies of a controller, as generators that request simulations, and the engine that runs them."""
