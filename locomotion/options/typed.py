"""Plain values into typed options, with one line about what is wrong with them."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any, TypeVar

from omegaconf import OmegaConf
from omegaconf.errors import ConfigAttributeError, ConfigKeyError, OmegaConfBaseException

from locomotion.options.checked import ConfigError, fitted, suggestion
from locomotion.options.registry import Registry

T = TypeVar("T")


def typed(schema: type[T], *layers: Any, prefix: str | None = None) -> T:
    """Merges mappings, the last of which wins, into an instance of a dataclass.

    Args:
        schema: the dataclass.
        layers: mappings, or configurations of OmegaConf.
        prefix: where the keys stand in the configuration, for messages; by default the schema's own.

    Raises:
        ConfigError: for an unknown key, or a value of the wrong type or range.
    """
    prefix = getattr(schema, "PREFIX", "") if prefix is None else prefix
    where = prefix.rstrip(".") or "the configuration"
    for layer in layers:
        if not (isinstance(layer, Mapping) or dataclasses.is_dataclass(layer)):
            raise ConfigError(f"{where}={layer} must be keys and values")
    try:
        # Plain containers: a DictConfig could smuggle in keys that the schema does not have.
        plain = (
            OmegaConf.to_container(layer, resolve=True) if OmegaConf.is_config(layer) else layer
            for layer in layers
        )
        fitting = [fitted(schema, layer) for layer in plain]
        merged = OmegaConf.unsafe_merge(OmegaConf.structured(schema), *fitting)  # of no one else
        missing = sorted(str(name) for name in OmegaConf.missing_keys(merged))
        if missing:
            raise ConfigError(f"{prefix}{missing[0]} is missing")
        return OmegaConf.to_object(merged)
    except RecursionError as error:
        raise ConfigError(f"{where} is nested too deeply") from error
    except OmegaConfBaseException as error:
        raise ConfigError(explain(error, prefix)) from error
    except ConfigError as error:
        if prefix == getattr(schema, "PREFIX", "") or str(error).startswith(prefix):
            raise
        raise ConfigError(f"{prefix}{error}") from error  # the schema does not know where it stands
    except (TypeError, ValueError) as error:
        raise ConfigError(f"{where}: {' '.join(str(error).split())}") from error


def chosen(registry: Registry, options: Mapping[str, Any], section: str) -> Any:
    """An instance of the choice that ``options["name"]`` names, made of the other options.

    Args:
        registry: where the name is looked up.
        options: ``name``, and keys of the choice.
        section: where they stand in the configuration, for messages.

    Raises:
        ConfigError: for an unknown name or option, or a value of the wrong type or range.
    """
    values = dict(OmegaConf.to_container(options) if OmegaConf.is_config(options) else options)
    if "name" not in values:
        raise ConfigError(f"{section}.name is missing; choose from {', '.join(registry.names())}")
    choice = registry.get(values.pop("name"), f"{section}.name")
    return typed(choice, values, prefix=f"{section}.")


def explain(error: OmegaConfBaseException, prefix: str = "") -> str:
    """One line about a key or value that a schema does not accept.

    Args:
        error: raised by OmegaConf.
        prefix: where the schema stands in the configuration, such as ``"ppo."``.
    """
    key = f"{prefix}{error.full_key}"
    if isinstance(error, (ConfigAttributeError, ConfigKeyError)):
        if not dataclasses.is_dataclass(error.object_type):
            return f"{key} is not a key; + adds one"
        known = [field.name for field in dataclasses.fields(error.object_type)]
        parent, dot, name = key.rpartition(".")
        hint = suggestion(name, known, f"{parent}{dot}")
        return f"{key} is not a key; {hint}allowed are {', '.join(known) or 'none'}"
    return f"{key or 'the configuration'}: {str(error.msg).splitlines()[0]}"
