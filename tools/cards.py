"""Write into the model cards what was measured of the shipped weights.

    python tools/cards.py

Accuracy, with its command, machine, date and versions, comes from docs/benchmarks.md, speed from
docs/benchmarks-speed.md. What a card says of training is written by hand.
"""

from __future__ import annotations

import json
from typing import Any

from re3.models import WEIGHTS, list_models
from report_pages import ACCURACY, SPEED, column, read_page


def main() -> None:
    """Write the cards of all models that ship."""
    for name in (card.name for card in list_models() if card.shipped):
        path = WEIGHTS / f"{name}.json"
        card = json.loads(path.read_text(encoding="utf-8"))
        path.write_text(
            json.dumps({**card, **measured(name)}, indent=2, ensure_ascii=False) + "\n",
            encoding="utf-8",
        )
        print(f"{path}: written")


def measured(model: str) -> dict[str, Any]:
    """The fields of a model's card that the two pages know."""
    accuracy, speed = read_page(ACCURACY), read_page(SPEED)
    (fast,) = speed.datasets.values()
    return {
        "accuracy": {
            f"{name} AUC": float(column(tables[""], "AUC")[model])
            for name, tables in zip(accuracy.folders(), accuracy.datasets.values(), strict=True)
        },
        "speed_fps": float(column(fast[""], "FPS")[model]),
        "speed_command": speed.head["command"].strip("`"),
        "command": accuracy.head["command"].strip("`"),
        "machine": accuracy.head["machine"].partition(", load")[0],
        "date": accuracy.head["date"],
        "versions": dict(part.split(" ") for part in accuracy.head["versions"].split(", ")),
    }


if __name__ == "__main__":
    main()
