"""What the tuning scripts share: the search, and the protocol it minimizes the cost of. No FMU contains any of it."""
