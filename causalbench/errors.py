"""One class per mistake. Messages name what was given, what was expected, what exists and what to do."""

from __future__ import annotations

import difflib
from collections.abc import Iterable


class CausalbenchError(Exception):
    """Base of every error that this package raises on purpose."""


class UserError(CausalbenchError):
    """Raised when the user asked for something that cannot be; the command line prints it and exits with 2."""


class StorageError(CausalbenchError):
    """Raised when a run folder cannot be written any more: the disk is full, or the folder was removed."""


class UnknownNameError(UserError):
    """Raised when the user names a backend, task, method or tier that does not exist."""

    def __init__(self, kind: str, name: object, known: Iterable[str], hint: str = "") -> None:
        known = sorted(known)
        close = difflib.get_close_matches(str(name), known, n=1)
        guess = f" Did you mean {close[0]!r}?" if close else ""
        super().__init__(f"unknown {kind} {name!r}.{guess} Known: {', '.join(known) or 'none'}. {hint}".rstrip())


class BrokenVersionError(UserError):
    """Raised when an installed library is a version that is known not to work here."""


class BackendLoadError(UserError):
    """Raised when the user names a backend whose plugin is installed but could not be loaded."""


class InvalidActionError(CausalbenchError, ValueError):
    """Raised when an action has the wrong shape, is not finite, or lies outside [-1, 1]."""


class InvalidObservationError(UserError, ValueError):
    """Raised when a policy is given an observation that lacks an entry, or one with another shape or no numbers."""


class UnreachableLayoutError(CausalbenchError):
    """Raised when an arm cannot take the end-effector pose that a layout asks for; the caller draws another."""


class SnapshotError(CausalbenchError, ValueError):
    """Raised when bytes given to `Scene.restore` were not made by a scene of the same spec."""


class LayoutDrawError(CausalbenchError):
    """Raised when no start that the task and the scene accept was found in a bounded number of draws."""


class UndecidedStageError(CausalbenchError):
    """Raised when the data of a stage do not allow any decision; its graph then says so and is the declared one."""


class DiscovererError(CausalbenchError):
    """Raised when a discoverer returns arrays that it did not describe, or of the wrong shape or type."""


class InvalidGraphError(UserError):
    """Raised when a causal graph does not fit the task (wrong names, wrong hash, an empty action set)."""


class CheckpointError(UserError):
    """Raised when a checkpoint is damaged, of another version, or was made by another run."""


class DivergedError(CausalbenchError):
    """Raised when a loss explodes or a loss or weight is no longer finite: the cell ends as `diverged`."""


class StoppedError(CausalbenchError):
    """Raised by a training run that was asked to stop, once its checkpoint is written."""


class SuiteError(UserError):
    """Raised when a suite file has a mistake; the message starts with file, line and key."""


class RunFolderError(UserError):
    """Raised when a run folder cannot be written, is in use, or holds what cannot be compared with the new cells."""


class UnfinishedRunError(CausalbenchError):
    """Raised at the end of a run in which a cell failed, diverged, took too long or was skipped; says which and why."""


class DamagedFileError(RunFolderError):
    """Raised when a file of a run folder is missing, cut off, or not the one that was written."""
