"""The commands: options, progress, terminal, exit codes, remedies. All they do is done by the library below."""
