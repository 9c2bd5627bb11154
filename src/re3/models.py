"""The named models: what there is, what ships, and what was measured of it.

A shipped model has files in `re3/weights`: `<name>.onnx` in full precision, `<name>-int8.onnx`, the
same in eight bits, and its card `<name>.json`.
"""

from __future__ import annotations

import json
from dataclasses import dataclass, field, replace
from pathlib import Path

WEIGHTS = Path(__file__).parent / "weights"
DEFAULT_MODEL = "re3-base"
FAST_MODEL = "re3-lite"
"""The one for many objects and slow processors."""


@dataclass(frozen=True)
class ModelCard:
    """A named model.

    Attributes:
        name: as given to `Tracker(model=...)`.
        description: one line.
        parameters: number of learnt values.
        crop_size: side of the current crop in pixels.
        shipped: whether weights are part of the package.
        size_bytes: of the file that is run by default; 0 where none ships.
        accuracy: what was measured, such as {"DAVIS AUC": 0.68}; empty where nothing was.
        speed_fps: tracked frames a second, one object, or None; on the machine the card names.
        details: everything else the card says: data, recipe, machine, commands, licence.
        mirrored: whether it looks at each crop mirrored as well (`re3.engine.mirrored`); its files
            are of one look.
    """

    name: str
    description: str
    parameters: int
    crop_size: int
    shipped: bool
    size_bytes: int = 0
    accuracy: dict[str, float] = field(default_factory=dict)
    speed_fps: float | None = None
    details: dict[str, object] = field(default_factory=dict)
    mirrored: bool = False


_CATALOGUE = (
    ModelCard(
        name="re3-base",
        description="like re3-lite, but looking twice, at each crop and its mirror image",
        parameters=5_171_239,
        crop_size=192,
        shipped=True,
        mirrored=True,
    ),
    ModelCard(
        name="re3-lite",
        description="ours, sized for a CPU: spatial readout, EfficientNet-Lite0 trunk",
        parameters=5_170_439,
        crop_size=192,
        shipped=True,
    ),
    ModelCard(
        name="re3",
        description="the paper's network (CaffeNet trunk, LSTM 1024); import or train its weights",
        parameters=190_004_324,
        crop_size=227,
        shipped=False,
    ),
)
_CARDS = {card.name: card for card in _CATALOGUE}


def list_models() -> list[ModelCard]:
    """All named models, with the figures of those that ship."""
    return [_with_figures(card) for card in _CATALOGUE]


def _with_figures(card: ModelCard) -> ModelCard:
    weights, written = WEIGHTS / f"{card.name}.onnx", WEIGHTS / f"{card.name}.json"
    if not card.shipped or not weights.is_file():
        return card
    details = json.loads(written.read_text(encoding="utf-8")) if written.is_file() else {}
    return replace(
        card,
        size_bytes=(find_eight_bits(card.name) or weights).stat().st_size,
        accuracy=details.pop("accuracy", {}),
        speed_fps=details.pop("speed_fps", None),
        details=details,
    )


def is_mirrored(model: str | Path) -> bool:
    """Whether a named model looks at each crop mirrored as well."""
    card = _CARDS.get(str(model))
    return card is not None and card.mirrored


def find_eight_bits(model: str | Path) -> Path | None:
    """The file of a named model that computes in eight bits, where there is one."""
    card = _CARDS.get(str(model))
    if card is None:
        return None
    path = WEIGHTS / f"{card.name}-int8.onnx"
    return path if path.is_file() else None


def find_weights(model: str | Path) -> Path:
    """The weights file of a named model, in full precision, or the path given itself.

    Raises:
        FileNotFoundError: a path that does not exist.
        ValueError: an unknown name, or a model whose weights do not ship.
    """
    path = Path(model)
    if path.suffix in (".onnx", ".safetensors", ".xml"):
        if not path.is_file():
            raise FileNotFoundError(f"model file {path} does not exist")
        return path
    card = _CARDS.get(str(model))
    if card is None:
        raise ValueError(
            f"unknown model {str(model)!r}; expected one of {', '.join(_CARDS)}, "
            "or the path of an .onnx, .safetensors or OpenVINO .xml file"
        )
    weights = WEIGHTS / f"{card.name}.onnx"
    if not weights.is_file():
        if card.shipped:
            raise ValueError(
                f"{weights} is missing; the installation is damaged, install re3 again"
            )
        raise ValueError(
            f"model {str(model)!r} comes without weights; give the path of a file with its weights"
            f", or take {DEFAULT_MODEL!r}"
        )
    return weights
