"""The errors that reach a user, each with the exit code of the command-line contract.

Every layer may raise them; only ``slamcli.cli.main`` turns them into messages and exit codes.
"""

from __future__ import annotations

from enum import IntEnum


class ExitCode(IntEnum):
    """Exit codes of every command (``docs/exit-codes.md``)."""

    SUCCESS = 0
    CHECK_FAILED = 1
    USAGE = 2
    INVALID_INPUT = 3
    NOT_CONVERGED = 4
    NUMERICAL_FAILURE = 5
    INTERRUPTED = 130
    BROKEN_PIPE = 141


class SlamcliError(Exception):
    """Base of all errors with a message made for the user.

    Parameters
    ----------
    message
        What is wrong, in one line.
    details
        Further lines: where, what was expected, what to do next.
    """

    exit_code: ExitCode = ExitCode.CHECK_FAILED

    def __init__(self, message: str, details: tuple[str, ...] = ()) -> None:
        super().__init__(message)
        self.message = message
        self.details = details


class UsageError(SlamcliError):
    """An option or a configuration file asks for something that does not exist."""

    exit_code = ExitCode.USAGE


class InputError(SlamcliError):
    """The input cannot be read, or what it says is not a valid graph."""

    exit_code = ExitCode.INVALID_INPUT


class NumericalError(SlamcliError):
    """The linear system is singular or indefinite, or a number is not finite."""

    exit_code = ExitCode.NUMERICAL_FAILURE
