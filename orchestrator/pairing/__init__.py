"""Which plant and which controller are simulated together, on which testbed."""
