"""The errors of this package, one family that tells by fields what is wrong."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path


@dataclass(eq=False)
class ControllerFmuError(Exception):
    """Base of all errors that this package raises on purpose; as text it is one sentence made of its fields."""

    what: str
    """What is wrong."""
    where: str = ""
    """The file, folder or FMU it is about; empty if none."""
    value: str = ""
    """The offending value: a name, a unit, a reference, a command."""
    nearest: tuple[str, ...] = ()
    """Names that may have been meant, the likeliest first."""
    remedy: str = ""
    """What to do, in the language of the sources at hand."""

    def __str__(self) -> str:
        place = f"{self.where}: " if self.where else ""
        near = f" (did you mean {' or '.join(self.nearest)}?)" if self.nearest else ""
        remedy = f"; {self.remedy}" if self.remedy else ""
        return f"{place}{self.what}{near}{remedy}"


class BuildError(ControllerFmuError):
    """An FMU cannot be built."""


class CompilerError(BuildError):
    """The C compiler fails, or the environment variable CC is not a command."""


class NoCompilerError(CompilerError):
    """This machine has no C compiler."""


class DescriptionError(BuildError):
    """The model description lacks something, or is not XML."""


class UnitError(DescriptionError):
    """A variable has no unit, or one that is neither known nor defined."""


class ValueReferenceError(DescriptionError):
    """A value reference of the description is not one of the model's."""


class DialectError(BuildError):
    """No such kind of FMU exists."""


class PlatformError(BuildError):
    """Binaries cannot be built for such a platform."""


class SourceError(BuildError):
    """The sources of a model are missing, ambiguous or unusable."""


class TargetError(BuildError):
    """The FMU cannot be written where it is wanted."""


class LinearSystemError(BuildError):
    """A linear system cannot become a controller."""


class SystemFileError(LinearSystemError):
    """A file does not hold a linear system."""


class ShapeError(LinearSystemError):
    """The matrices do not fit each other, or hold what is not a finite number."""


class SampleTimeError(LinearSystemError):
    """The sample time is missing or contradicts itself, or a continuous system comes without a method."""


class UnstableError(LinearSystemError):
    """The controller by itself is unstable."""


class ScheduleError(LinearSystemError):
    """The points of a schedule are missing, or cannot be interpolated between."""


class NetworkError(BuildError):
    """A neural network cannot become a controller."""


class StarterError(ControllerFmuError):
    """A starter kit cannot be copied."""


class UnknownKitError(StarterError):
    """There is no such kit."""


class ModelNameError(StarterError):
    """The name cannot be given to a model."""


class FolderTakenError(StarterError):
    """The folder is not empty, is a file, or has no parent folder."""


@contextmanager
def located(where: Path) -> Iterator[None]:
    """Name ``where`` in the errors of the block that do not say yet what they are about."""
    try:
        yield
    except ControllerFmuError as error:
        error.where = error.where or str(where)
        raise
