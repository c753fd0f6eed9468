"""How a document was made, as pairs of a name and a text: its head in words."""

from __future__ import annotations

from collections.abc import Iterator

from .head import Head
from .wording import assignments, connectors


def head_facts(head: Head) -> Iterator[tuple[str, str]]:
    """The facts of a head."""
    controller, plant, timing, sample_time = head.controller, head.plant, head.timing, head.sample_time
    processes = "1 process" if timing.workers == 1 else f"{timing.workers} processes"
    yield "Controller", controller.file
    yield "Parameters set", assignments(controller.parameters) or "none"
    yield "Connectors", connectors(controller)
    yield "FMI version", controller.fmi_version
    yield "Made by", controller.generation_tool or "not stated"
    yield "SHA-256", controller.sha256
    yield "Benchmark", f"{head.benchmark}, protocol {head.protocol}"
    yield "Seed", "several" if head.seed is None else str(head.seed)
    yield "Sample time", f"{sample_time.seconds * 1e3:g} ms" + ("" if sample_time.as_in_benchmark else " (own)")
    yield "Plant", f"{plant.file} ({plant.build}), SHA-256 {plant.sha256}"
    yield "Its parameters set", assignments(plant.parameters) or "none"
    yield "Simulations", f"{timing.simulations}, {timing.simulated_time:.0f} simulated seconds"
    yield "Run", f"{timing.start}, {timing.wall_time:.0f} s on {processes}"
    if head.command:
        yield "Command", head.command
    yield "Versions", ", ".join(f"{name} {version}" for name, version in head.environment.items())
