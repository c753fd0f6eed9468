"""Which plant and which controller are simulated together, and under which conditions."""
