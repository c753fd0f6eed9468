"""The family of errors a user may meet. Every message says what happened, where, and how to mend it."""


class BenchmarkError(Exception):
    """Base of all errors raised on purpose."""


class InputError(BenchmarkError):
    """What the user gave cannot be used: a file, a name, a value. The commands exit with code 2."""


class Crash(BenchmarkError):
    """The process of a simulation ended before the simulation did."""


class FmuError(BenchmarkError):
    """An FMU failed in an FMI call. ``call`` names the function, ``log`` holds the FMU's own last messages."""

    def __init__(self, message: str, call: str = "", log: tuple[str, ...] = ()) -> None:
        super().__init__(message + "".join(f"\n  {line}" for line in log))
        self.call = call
        self.log = log

    def __reduce__(self) -> tuple[object, ...]:
        # The log stands in the message already; it must not be added again when the error crosses processes.
        return (_restore, (str(self), self.call, self.log))


def _restore(message: str, call: str, log: tuple[str, ...]) -> FmuError:
    error = FmuError(message, call)
    error.log = log
    return error
