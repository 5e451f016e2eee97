"""An extension of griffe, which reads the sources for the reference: the fields of a pytree are its arguments."""

from typing import Any

import griffe


class Pytrees(griffe.Extension):
    """Gives every class under `@pytree` the signature that the decorator makes."""

    def on_class_members(self, *, cls: griffe.Class, **kwargs: Any) -> None:
        if not any(str(decorator.value) == "pytree" for decorator in cls.decorators):
            return
        fields = [a for a in cls.attributes.values() if a.annotation is not None and "instance-attribute" in a.labels]
        arguments = [griffe.Parameter("self", kind=griffe.ParameterKind.positional_or_keyword)]
        arguments += [
            griffe.Parameter(
                field.name,
                annotation=field.annotation,
                kind=griffe.ParameterKind.positional_or_keyword,
                default=_default(field.value),
            )
            for field in fields
        ]
        cls.set_member("__init__", griffe.Function("__init__", parameters=griffe.Parameters(*arguments), parent=cls))
        for field in fields:
            cls.members.pop(field.name, None)  # not of a base that is told of by itself


def _default(value: Any) -> Any:
    """The default of a field; of one that is `static(...)`, the default given there."""
    if not isinstance(value, griffe.ExprCall) or str(value.function) != "static":
        return value
    named = {a.name: a.value for a in value.arguments if isinstance(a, griffe.ExprKeyword)}
    return named.get("default")
