"""Random sequences of FMI calls on the compiled FMUs, with sanitizers: a harness in C, and what builds and runs it."""
