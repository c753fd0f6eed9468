"""The second checker: recomputes a recorded case with equations, integrator and judge of its own.

It shares no code with the rest of the project, and imports none of it.
"""

from .compare import Recheck, Row, recheck
from .reading import Unreadable

__all__ = ["Recheck", "Row", "Unreadable", "recheck"]
