"""Tables of models and trackers, written where README and docs mark a place for them.

    python tools/tables.py            # write them
    python tools/tables.py --check    # exit code 1 where one is not up to date

Figures come from the model cards (src/re3/weights/*.json), docs/benchmarks.md and
docs/benchmarks-speed.md, which `re3 eval` writes. A place is marked by two comments:

    <!-- table: models -->
    <!-- end of table -->
"""

from __future__ import annotations

import argparse
import re
import sys
from pathlib import Path

from re3.models import ModelCard, list_models

ROOT = Path(__file__).parents[1]
PAGES = (ROOT / "README.md", ROOT / "docs" / "models.md")
ACCURACY = ROOT / "docs" / "benchmarks.md"
SPEED = ROOT / "docs" / "benchmarks-speed.md"
NOT_MEASURED = "\N{EN DASH}"
PLACE = re.compile(r"(<!-- table: ([a-z]+) -->\n).*?(<!-- end of table -->)", re.DOTALL)

Rows = list[list[str]]


def main() -> int:
    """Write or check the tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--check", action="store_true", help="write nothing")
    check = parser.parse_args().check
    stale = 0
    for page in PAGES:
        text = page.read_text(encoding="utf-8")
        fresh = PLACE.sub(lambda found: f"{found[1]}\n{TABLES[found[2]]()}\n\n{found[3]}", text)
        if fresh != text:
            stale += 1
            print(f"{page}: {'not up to date, run tools/tables.py' if check else 'written'}")
            if not check:
                page.write_text(fresh, encoding="utf-8")
    return 1 if check and stale else 0


def models() -> str:
    """The named models with what their cards say."""
    cards = list_models()
    sets = list(dict.fromkeys(name for card in cards for name in card.accuracy))
    rows = [["model", "what it is", "weights", "parameters", *sets, "speed"]]
    for card in cards:
        figures = [
            f"{card.accuracy[s]:.3f}" if s in card.accuracy else "not measured" for s in sets
        ]
        rows.append(
            [
                f"`{card.name}`",
                card.description,
                f"{card.size_bytes / 1e6:.1f} MB" if card.size_bytes else "none shipped",
                f"{card.parameters / 1e6:.1f} M",
                *figures,
                f"{card.speed_fps:.0f} FPS" if card.speed_fps else "not measured",
            ]
        )
    return markdown(rows, numbers=False)


def trackers() -> str:
    """AUC of every tracker on every dataset of the report; its speed where that was measured."""
    report = ACCURACY.read_text(encoding="utf-8")
    (data,) = re.findall(r"^- data: (.*)$", report, flags=re.MULTILINE)
    names = ["/".join(path.split("/")[-2:]) for path in re.findall(r"`([^`]+)`", data)]
    accuracy = [column(section, "AUC") for section in first_tables(report)]
    (speed_report,) = first_tables(SPEED.read_text(encoding="utf-8"))
    fps = column(speed_report, "FPS")
    rows = [["tracker", *(f"{name} AUC" for name in names), "FPS on four DAVIS clips"]]
    for tracker in accuracy[0]:
        speed = f"{float(fps[tracker]):.0f}" if tracker in fps else NOT_MEASURED
        rows.append([tracker, *(values[tracker] for values in accuracy), speed])
    return markdown(rows, numbers=True)


def cards() -> str:
    """What the cards of the shipped models say besides."""
    return "\n\n".join(
        f"### {card.name}\n\n{_card(card)}" for card in list_models() if card.details
    )


def _card(card: ModelCard) -> str:
    details = card.details
    training, data = details["training"], details["training_data"]
    assert isinstance(training, dict) and isinstance(data, dict)
    limits, versions = details["limits"], details["versions"]
    assert isinstance(limits, list) and isinstance(versions, dict)
    lines = {
        "Network": details["network"],
        "Figures": f"{details['data']}. {str(details['selection']).capitalize()}",
        "Printed by": f"`{details['command']}`",
        "Speed printed by": f"`{details['speed_command']}`",
        "Machine": f"{details['machine']}; {', '.join(f'{k} {v}' for k, v in versions.items())}",
        "Date": details["date"],
        "Training": f"{training['hours']} hours on {training['machine']}, "
        f"{training['crop_pairs']:,} crop pairs",
        **{f"Trained on, {kind}": ", ".join(names) for kind, names in data.items()},
        "Licence": details["licence"],
        "Limits": "; ".join(limits),
    }
    return markdown([["", ""], *([k, str(v)] for k, v in lines.items())], numbers=False)


def first_tables(report: str) -> list[Rows]:
    """The first table of each dataset in a report of `re3 eval`."""
    sections = re.split(r"^## .*sequences, ope$", report, flags=re.MULTILINE)[1:]
    tables = [re.search(r"(^\|.*\n)+", section, flags=re.MULTILINE) for section in sections]
    return [
        [[cell.strip() for cell in line.strip("|").split("|")] for line in found[0].splitlines()]
        for found in tables
        if found
    ]


def column(table: Rows, name: str) -> dict[str, str]:
    """First cell of each row -> its cell under a heading."""
    index = table[0].index(name)
    return {row[0]: row[index] for row in table[2:]}


def markdown(rows: Rows, numbers: bool) -> str:
    """A table; `numbers` puts all but the first column to the right."""
    rest = "---:" if numbers else "---"
    lines = [rows[0], ["---", *[rest] * (len(rows[0]) - 1)], *rows[1:]]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


TABLES = {"models": models, "trackers": trackers, "cards": cards}


if __name__ == "__main__":
    sys.exit(main())
