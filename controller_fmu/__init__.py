"""Controllers of the benchmark as FMUs, and what turns sources into FMUs."""
