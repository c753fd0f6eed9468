"""The closed loop of one plant FMU and one controller FMU: scenario, signals, master loop, trajectory."""
