"""The named networks: `re3`, `re3-lite`, and the models of Table I as `paper-A` to `lite-K`."""

from __future__ import annotations

from re3.model_spec import CropSpec
from re3.network.authors import AuthorsConfig, AuthorsSmall, AuthorsSmallConfig
from re3.network.base import TrackingNetwork
from re3.network.lite_config import LiteConfig
from re3.network.mirrored import LOOK, Mirrored, MirroredConfig
from re3.network.re3 import Re3, Re3Config
from re3.network.re3_lite import Re3Lite
from re3.network.table_one import CONFIGS

Network = Re3 | Re3Lite | Mirrored | AuthorsSmall
Config = Re3Config | LiteConfig | MirroredConfig | AuthorsSmallConfig

VARIANTS: dict[str, Config] = {
    "re3": Re3Config(),
    "re3-lite": LiteConfig(),
    "re3-base": MirroredConfig(),
    "re3-look": LOOK,
    "re3-lite-wide": LiteConfig(name="re3-lite-wide", current=CropSpec(context=4.0, size=192)),
    "re3-base-wide": LiteConfig(name="re3-base-wide", current=CropSpec(context=4.0, size=256)),
    "re3-authors": AuthorsConfig(),
    "re3-authors-small": AuthorsSmallConfig(),
    "re3-alexnet": Re3Config(name="re3-alexnet", trunk="alexnet"),
    **CONFIGS,
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
    if isinstance(variant, MirroredConfig):
        return Mirrored(Re3Lite(variant.once), variant.name)
    if isinstance(variant, AuthorsSmallConfig):
        return AuthorsSmall(variant)
    return Re3(variant) if isinstance(variant, Re3Config) else Re3Lite(variant)


def trainable(network: Network) -> TrackingNetwork:
    """The same network, seen to be one that can be trained.

    Raises:
        ValueError: it is of a kind that is only there to run weights of others.
    """
    if not isinstance(network, TrackingNetwork):
        raise ValueError(
            f"{network.spec().name!r} can be tracked with, not trained; expected re3-lite, re3 or "
            "a model of the ablation study"
        )
    return network
