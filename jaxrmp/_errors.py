"""What can go wrong, as types. Every message names the argument, shows what was received and says what to do."""

import contextlib
import difflib
from collections.abc import Collection, Iterable, Iterator


class JaxrmpError(Exception):
    """Base of every error that jaxrmp raises on purpose."""


class ShapeError(JaxrmpError, ValueError):
    """An array has a shape that the operation cannot take."""


class UnknownNameError(JaxrmpError, ValueError):
    """A name (frame, joint, option, configuration key) is not one of the valid ones."""

    def __init__(self, kind: str, name: object, valid: Iterable[object], hint: str = ""):
        options = [str(v) for v in valid]
        close = difflib.get_close_matches(str(name), options, n=1, cutoff=0.5)
        message = f"unknown {kind} {str(name)!r}."
        if close:
            message += f" Did you mean {close[0]!r}?"
        shown = ", ".join(options[:40]) + (", ..." if len(options) > 40 else "")
        message += f" Valid: {shown or 'none'}."
        super().__init__(message + (f" {hint}" if hint else ""))
        self.kind, self.name, self.valid = kind, name, tuple(options)

    @classmethod
    def check(cls, kind: str, name: object, valid: Collection[object], hint: str = "") -> None:
        """**Raises** it if `name`, of some `kind`, is not among the `valid` ones; a `hint` says more."""
        if name not in valid:
            raise cls(kind, name, valid, hint)


class LeafError(JaxrmpError, TypeError):
    """A class of leaves is written in a way that trees would pass over."""


class RobotError(JaxrmpError, ValueError):
    """A robot description cannot be read, or holds something that jaxrmp's kinematics cannot express."""


class RigidTransformError(JaxrmpError, ValueError):
    """A pose is not a rigid transform."""


class DemonstrationError(JaxrmpError, ValueError):
    """Demonstrations are missing, unreadable, or unfit for learning."""


class ConfigurationError(JaxrmpError, ValueError):
    """An argument or an entry of a configuration holds a value that is not allowed, or its file cannot be read."""


class NoGeometryError(RobotError, ConfigurationError):
    """A robot has no geometry that spheres could cover: none in its file, or no file."""


class ConvexProgramError(JaxrmpError, RuntimeError):
    """The convex program of the potential was not solved to optimality."""


class TrainingError(JaxrmpError, RuntimeError):
    """Training of the metric diverged."""


class BasinError(JaxrmpError, RuntimeError):
    """No kernel width gives a potential whose descent ends at the goal from everywhere in the region checked."""


class SkillFileError(JaxrmpError, ValueError):
    """A skill file is missing, damaged, of another version, or made for another robot."""


class RolloutError(JaxrmpError, RuntimeError):
    """A rollout produced non-finite states."""


class ArmError(JaxrmpError, RuntimeError):
    """An arm of steel, or what stands for it, cannot be reached, refuses, or ended a motion by itself."""


class CalibrationError(JaxrmpError, RuntimeError):
    """Where a camera is does not follow from what it saw: the robot is not in its images, or not as it would have to
    be."""


class FramesError(JaxrmpError, ValueError):
    """A file of depth images is missing, damaged, or holds something else than what its layout says."""


class ExportError(JaxrmpError, ValueError):
    """A function cannot be written in another language: an operation has no form there, or it is too large."""


class FileWarning(UserWarning):
    """Something that a file says is left out, or read in another way than it may have been meant."""


class UnsafeFileWarning(FileWarning):
    """As `FileWarning`, where a robot could move as it must not: a limit, an obstacle or a part of it is not known."""


class MissingDependencyError(JaxrmpError, ImportError):
    """An optional package is needed for this and is not installed; `remedy` says how to have it."""

    def __init__(self, package: str, extra: str, what: str = "this"):
        self.remedy = f"pip install 'jaxrmp[{extra}]', or, in a clone of jaxrmp, pip install -e '.[{extra}]'."
        super().__init__(f"{package} is needed for {what} and is not installed: {self.remedy}")
        self.package, self.extra = package, extra


@contextlib.contextmanager
def importing(package: str, extra: str) -> Iterator[None]:
    """Around the imports of an optional package. **Raises** `MissingDependencyError` if it is not installed."""
    try:
        yield
    except ImportError as error:
        raise MissingDependencyError(package, extra) from error
