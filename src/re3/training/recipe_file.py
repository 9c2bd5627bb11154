"""Recipes as YAML files: the fields of `Recipe`, in part or all of them.

base: frozen-trunk          # the recipe whose values the rest changes; default frozen-trunk
learning_rate: 5e-4
phases:
  - {unroll: 2, batch: 64, own: 0.0, iterations: 700}
noise: {drift: 0.07}        # other fields of the base's noise stay
"""

from __future__ import annotations

import dataclasses
import types
import typing
from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeVar

import yaml

from re3.training.packed.recipe import PACKED_RECIPES, PackedRecipe
from re3.training.recipe import FROZEN_TRUNK, RECIPES, Recipe

T = TypeVar("T")

BASE_KEY = "base"
SUFFIXES = (".yaml", ".yml")


def find_recipe(name: str) -> Recipe:
    """A recipe by its name, or from a YAML file.

    Raises:
        FileNotFoundError: no such file.
        ValueError: neither a known name nor the path of a YAML file; see `read_recipe`.
    """
    if name in RECIPES:
        return RECIPES[name]
    if Path(name).suffix in SUFFIXES:
        return read_recipe(name)
    raise ValueError(
        f"no recipe {name!r}; expected one of {', '.join(RECIPES)}, or the path of a .yaml file"
    )


def read_recipe(path: str | Path) -> Recipe:
    """The recipe in a YAML file.

    Raises:
        FileNotFoundError: no such file.
        ValueError: not YAML, a key that is no field, or a value that does not fit its field.
    """
    return typing.cast(Recipe, _read(Path(path), FROZEN_TRUNK, RECIPES))


def find_packed_recipe(name: str) -> PackedRecipe:
    """A recipe for packed data by its name, or from a YAML file; raises as `find_recipe` does."""
    if name in PACKED_RECIPES:
        return PACKED_RECIPES[name]
    if Path(name).suffix in SUFFIXES:
        start = next(iter(PACKED_RECIPES.values()))
        return typing.cast(PackedRecipe, _read(Path(name), start, PACKED_RECIPES))
    raise ValueError(
        f"no recipe {name!r} for packed data; expected one of {', '.join(PACKED_RECIPES)}, or the "
        "path of a .yaml file"
    )


def with_values(base: T, values: dict[str, Any]) -> T:
    """A frozen configuration with fields replaced by plain values, as JSON and YAML have them.

    Raises:
        ValueError: a key that is no field, or a value that does not fit its field.
    """
    return typing.cast(T, _changed(base, values, ""))


def _read(path: Path, default: Any, known: Mapping[str, Any]) -> Any:
    if not path.is_file():
        raise FileNotFoundError(f"recipe {path} does not exist")
    try:
        values = yaml.safe_load(path.read_text(encoding="utf-8"))
    except RecursionError as error:
        raise ValueError(f"{path} is nested too deeply; expected fields of a recipe") from error
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise ValueError(f"{path} cannot be read as YAML: {error}") from error
    if not isinstance(values, dict):
        raise ValueError(
            f"{path} holds {_called(values)}; expected fields of a recipe, such as "
            "'learning_rate: 5e-4'"
        )
    base = values.pop(BASE_KEY, None)
    if base is not None and base not in known:
        raise ValueError(f"{path}: {BASE_KEY} is {base!r}; expected one of {', '.join(known)}")
    start = default if base is None else known[base]
    try:
        return _changed(start, values, "")
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error


def recipe_yaml(recipe: Recipe | PackedRecipe) -> str:
    """All fields of a recipe as YAML; `read_recipe` reads the same recipe back."""
    return yaml.safe_dump(_plain(dataclasses.asdict(recipe)), sort_keys=False)


def differences(before: dict[str, Any], after: dict[str, Any]) -> list[str]:
    """Fields of two recipes (`dataclasses.asdict`) that differ, such as `passes 1 -> 2`."""
    before, after = _plain(before), _plain(after)
    return [
        f"{name} {before.get(name)} -> {after.get(name)}"
        for name in {**before, **after}
        if before.get(name) != after.get(name)
    ]


def _changed(base: Any, values: dict[Any, Any], where: str) -> Any:
    """A frozen dataclass with some of its fields replaced."""
    kinds = _checked_fields(type(base), values, where)
    changes = {
        key: _value(value, kinds[key], f"{where}{key}", getattr(base, key))
        for key, value in values.items()
    }
    return dataclasses.replace(base, **changes)


def _made(kind: Any, values: dict[Any, Any], where: str) -> Any:
    """A new dataclass from its fields; those without a default are needed."""
    kinds = _checked_fields(kind, values, where)
    missing = [
        field.name
        for field in dataclasses.fields(kind)
        if field.default is dataclasses.MISSING and field.name not in values
    ]
    if missing:
        raise ValueError(f"{where.rstrip('.')} lacks {', '.join(missing)}")
    return kind(**{k: _value(v, kinds[k], f"{where}{k}", None) for k, v in values.items()})


def _checked_fields(kind: Any, values: dict[Any, Any], where: str) -> dict[str, Any]:
    kinds = typing.get_type_hints(kind)
    unknown = [key for key in values if key not in kinds]
    if unknown:
        raise ValueError(f"unknown key {where}{unknown[0]}; expected one of {', '.join(kinds)}")
    return kinds


def _value(value: Any, kind: Any, where: str, base: Any) -> Any:
    """A value of YAML as a field's type has it."""
    if isinstance(kind, types.UnionType):  # such as `float | None`
        if value is None:
            return None
        (kind,) = (one for one in typing.get_args(kind) if one is not type(None))
    if typing.get_origin(kind) is tuple:
        if not isinstance(value, list):
            raise ValueError(f"{where} is {_called(value)}; expected a list")
        inner = typing.get_args(kind)[0]
        return tuple(_value(v, inner, f"{where}[{i}]", None) for i, v in enumerate(value))
    if dataclasses.is_dataclass(kind):
        if not isinstance(value, dict):
            raise ValueError(f"{where} is {_called(value)}; expected keys and values")
        if base is not None:
            return _changed(base, value, f"{where}.")
        return _made(kind, value, f"{where}.")
    if kind is str:
        if not isinstance(value, str):
            raise ValueError(f"{where} is {_called(value)}; expected a name")
        return value
    return _number(value, kind, where)


def _number(value: Any, kind: Any, where: str) -> bool | int | float:
    if kind is bool:
        if not isinstance(value, bool):
            raise ValueError(f"{where} is {_called(value)}; expected true or false")
        return value
    try:
        # YAML 1.1 takes 1e-5, without a point, for text.
        number = float(value) if not isinstance(value, bool) else None
    except (TypeError, ValueError):
        number = None
    if number is None or (kind is int and not number.is_integer()):
        wanted = "a whole number" if kind is int else "a number"
        raise ValueError(f"{where} is {_called(value)}; expected {wanted}")
    return int(number) if kind is int else number


def _plain(value: Any) -> Any:
    """Tuples as lists, at any depth: YAML and JSON have no others."""
    if isinstance(value, dict):
        return {key: _plain(one) for key, one in value.items()}
    return [_plain(one) for one in value] if isinstance(value, list | tuple) else value


def _called(value: Any) -> str:
    return "nothing" if value is None else repr(value)
