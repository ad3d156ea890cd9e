"""What can go wrong, by kind. Every message repeats what came in and says what would fit."""


class CrfbenchError(Exception):
    """Base of every error that crfbench raises on purpose."""


class InputError(CrfbenchError, ValueError):
    """An argument has the wrong shape, range or kind."""


class FormatError(CrfbenchError, ValueError):
    """A file is not what its name or its reader says it should be."""


class MissingDataError(CrfbenchError, FileNotFoundError):
    """A data set that is not bundled was asked for and was not found."""


class FetchError(CrfbenchError, OSError):
    """A download failed; nothing half-written was left behind."""


class WorkerError(CrfbenchError, RuntimeError):
    """A worker process could not be started or ended by itself; nothing is wrong with what it was given."""
