"""The commands: options, progress, terminal, exit codes, remedies. The layers below do the work."""
