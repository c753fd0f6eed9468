"""Hostile FMUs and archives, built by the tests from the sources beside this file."""
