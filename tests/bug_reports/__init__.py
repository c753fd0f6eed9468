"""Properties of FMUs that public bug reports are about, each in an FMU whose law is the paper's PID."""
