"""The service: FMUs are accepted, queued and shown here; how anything is computed stays below."""
