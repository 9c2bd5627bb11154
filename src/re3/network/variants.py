"""The named networks."""

from __future__ import annotations

from re3.network.re3 import Re3, Re3Config
from re3.network.re3_lite import LiteConfig, Re3Lite

Network = Re3 | Re3Lite
Config = Re3Config | LiteConfig

VARIANTS: dict[str, Config] = {
    "re3": Re3Config(),
    "re3-lite": LiteConfig(),
}


def build(variant: str | Config) -> Network:
    """A network with fresh weights.

    Args:
        variant: a name in `VARIANTS`, or a configuration of your own.

    Raises:
        ValueError: unknown name.
    """
    if isinstance(variant, str):
        if variant not in VARIANTS:
            raise ValueError(f"unknown variant {variant!r}; expected one of {', '.join(VARIANTS)}")
        variant = VARIANTS[variant]
    return Re3(variant) if isinstance(variant, Re3Config) else Re3Lite(variant)
