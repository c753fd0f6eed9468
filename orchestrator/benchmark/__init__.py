"""The benchmark of Moberg, Öhr and Gunnarsson (2008): cases, protocol, metrics, cost, scorecard."""
