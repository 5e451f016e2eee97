"""Docstrings: their examples run and print what they say, and they name every argument of what is public."""

import doctest
import enum
import importlib
import inspect
import re
from pathlib import Path

import pytest

import jaxrmp

PACKAGE = Path(jaxrmp.__file__).parent
MODULES = [
    ".".join(path.relative_to(PACKAGE).with_suffix("").parts)
    for path in sorted(PACKAGE.rglob("*.py"))
    if ">>> " in path.read_text()
]
PACKAGES = [".".join(("jaxrmp", *path.parent.relative_to(PACKAGE).parts)) for path in PACKAGE.rglob("__init__.py")]
NAMES = re.compile(r"(\*{0,2}[A-Za-z]\w*(?:, [A-Za-z]\w*)*)(?: = .*)?", re.DOTALL)
REFERENCE = re.compile(
    r"(?:arguments\b|the rest)[^.;`]* as (?:in |of )?(`[\w.]+`(?:(?:,|\s+and)\s+`[\w.]+`)*)", re.IGNORECASE
)


@pytest.mark.parametrize("name", MODULES)
def test_examples_in_docstrings(name):
    found = doctest.testmod(importlib.import_module(f"jaxrmp.{name}"))
    assert found.attempted > 0
    assert found.failed == 0


def public_values(package):
    """Functions and classes that a package exports, by name."""
    values = vars(importlib.import_module(package)).items()
    # What is called by its own name, jitted functions too, and not instances that can be called, as leaves can.
    own = {
        name: value for name, value in values if name[0] != "_" and callable(value) and hasattr(value, "__qualname__")
    }
    return {name: value for name, value in own.items() if value.__module__.startswith("jaxrmp.")}


def text_of(value):
    """The docstring; of a class, its bases' too."""
    bases = [base for base in getattr(value, "__mro__", ()) if base.__module__.startswith("jaxrmp.")]
    return "\n".join(base.__doc__ or "" for base in bases or [value])


def named_in(value):
    """What a docstring names: `x`, `x, xd` or `y = psi(x)`, and what those name that it says to take arguments as."""
    text = text_of(value)
    spans = [NAMES.fullmatch(span) for span in re.findall(r"`([^`]+)`", text)]
    found = {name.lstrip("*") for span in spans if span for name in span[1].split(", ")}
    for match in REFERENCE.finditer(text):
        for name in re.findall(r"`([\w.]+)`", match[1]):
            meant = referred(value, name.rpartition(".")[2])
            found |= named_in(meant) if meant else set()
    return found


def referred(value, name):
    """What a docstring means by `name`: a method of the same class, or what is public so; None if neither."""
    owner = getattr(inspect.getmodule(value), value.__qualname__.partition(".")[0], None)
    if inspect.isclass(owner) and owner is not value and hasattr(owner, name):
        return getattr(owner, name)
    packages = sorted(PACKAGES, key=lambda package: not value.__module__.startswith(package))
    return next((public_values(package)[name] for package in packages if name in public_values(package)), None)


def unnamed_in(value):
    """Arguments of a function, or fields of a class, that its docstring leaves unnamed."""
    if inspect.isclass(value) and (issubclass(value, (enum.Enum, Exception)) or getattr(value, "_is_protocol", False)):
        return []
    arguments = set(inspect.signature(value).parameters) - {"self", "cls"}
    return sorted(name for name in arguments - named_in(value) if name[0] != "_")


def methods_of(value):
    """A class's own public functions, but for those that do what a base's docstring says."""
    for name, member in vars(value).items() if inspect.isclass(value) else ():
        member = getattr(member, "__func__", member)
        if name[0] != "_" and inspect.isfunction(member) and not any(hasattr(base, name) for base in value.__mro__[1:]):
            yield name, member


@pytest.mark.parametrize("package", sorted(PACKAGES))
def test_docstrings_name_every_argument(package):
    values = public_values(package)
    assert all(text_of(value) for value in values.values())
    values |= {f"{name}.{method}": member for name, value in values.items() for method, member in methods_of(value)}
    unnamed = {name: unnamed_in(value) for name, value in values.items()}
    assert {name: arguments for name, arguments in unnamed.items() if arguments} == {}


def test_unnamed_arguments_are_found():
    def none(q, qd):
        """Where the arm is at q, `f(qd)`, `2 qd`."""

    def both(q, qd):
        """`q, qd` [n]."""

    def referred(tree, x, dt, step):
        """A step of `dt`, s; the rest as `jaxrmp.certificate`."""

    def foreign(axes, step):
        """`step`; arguments as `in_axes` of `jax.vmap`."""

    assert unnamed_in(foreign) == ["axes"]
    assert unnamed_in(none) == ["q", "qd"]
    assert unnamed_in(both) == []
    assert unnamed_in(referred) == ["step"]  # it names tree and x
