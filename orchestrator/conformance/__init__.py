"""What can be said of a controller FMU before any evaluation: findings with a severity and a remedy."""
