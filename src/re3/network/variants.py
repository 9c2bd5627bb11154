"""The named networks."""

from __future__ import annotations

from re3.network.alexnet import AlexNetConfig, Re3AlexNet
from re3.network.authors import AuthorsConfig, AuthorsSmall, AuthorsSmallConfig
from re3.network.re3 import Re3, Re3Config
from re3.network.re3_lite import LiteConfig, Re3Lite

Network = Re3 | Re3Lite | AuthorsSmall
Config = Re3Config | LiteConfig | AuthorsSmallConfig

VARIANTS: dict[str, Config] = {
    "re3": Re3Config(),
    "re3-lite": LiteConfig(),
    "re3-authors": AuthorsConfig(),
    "re3-authors-small": AuthorsSmallConfig(),
    "re3-alexnet": AlexNetConfig(),
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
    if isinstance(variant, AuthorsSmallConfig):
        return AuthorsSmall(variant)
    if isinstance(variant, AlexNetConfig):
        return Re3AlexNet(variant)
    return Re3(variant) if isinstance(variant, Re3Config) else Re3Lite(variant)
