"""Tables of models and trackers, written where README and docs mark a place for them.

    python tools/tables.py            # write them
    python tools/tables.py --check    # exit code 1 where one is not up to date

Figures come from the model cards (src/re3/weights/*.json) and from the pages docs/benchmarks*.md,
which `re3 eval` writes (`make measure`). A place is marked by two comments:

    <!-- table: models -->
    <!-- end of table -->
"""

from __future__ import annotations

import argparse
import re
import sys
from pathlib import Path

from re3.models import ModelCard, list_models
from report_pages import ABSENT, ACCURACY, HIDDEN, SPEED, Rows, column, read_page

ROOT = Path(__file__).parents[1]
PAGES = (ROOT / "README.md", ROOT / "docs" / "models.md", ROOT / "docs" / "occlusion.md")
NOT_MEASURED = "\N{EN DASH}"
PLACE = re.compile(r"(<!-- table: ([a-z-]+) -->\n).*?(<!-- end of table -->)", re.DOTALL)


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
    report, speed = read_page(ACCURACY), read_page(SPEED)
    accuracy = [column(tables[""], "AUC") for tables in report.datasets.values()]
    (fast,) = speed.datasets.values()
    fps = column(fast[""], "FPS")
    rows = [["tracker", *(f"{name} AUC" for name in report.folders()), "FPS on four DAVIS clips"]]
    for tracker in accuracy[0]:
        frames = f"{float(fps[tracker]):.0f}" if tracker in fps else NOT_MEASURED
        rows.append([tracker, *(values[tracker] for values in accuracy), frames])
    return markdown(rows, numbers=True)


def alive() -> str:
    """Share of tracks that are alive again after so many hidden frames, and how many clips."""
    values = _hidden("alive")
    clips = _hidden("clips")
    first = next(iter(clips))
    short = [[tracker, *(f"{float(v):.2f}" for v in row)] for tracker, row in values.items()]
    return markdown([["tracker", *_hidden_names()], *short, ["clips", *clips[first]]], numbers=True)


def overlap() -> str:
    """Mean overlap once a hidden object is back."""
    rows = [[tracker, *row] for tracker, row in _hidden("overlap").items()]
    return markdown([["tracker", *_hidden_names()], *rows], numbers=True)


def absent() -> str:
    """AUC and precision over clips in which the object leaves."""
    (tables,) = read_page(ABSENT).datasets.values()
    auc, precise = column(tables[""], "AUC"), column(tables[""], "P@20")
    rows = [[tracker, auc[tracker], precise[tracker]] for tracker in auc]
    return markdown([["tracker", "AUC", "P@20"], *rows], numbers=True)


def absent_clips() -> str:
    """AUC of each of these clips."""
    (tables,) = read_page(ABSENT).datasets.values()
    return markdown(tables["AUC by sequence"], numbers=True)


def _hidden_names() -> list[str]:
    """`davis 5` for davis-hidden-5: all lengths of one dataset, then of the next."""
    return [f"{dataset} {frames}" for dataset, frames in _hidden_order()]


def _hidden_order() -> list[tuple[str, int]]:
    pages = [name.split("-hidden-") for name in read_page(HIDDEN).datasets]
    datasets = list(dict.fromkeys(dataset for dataset, _ in pages))
    pairs = [(dataset, int(frames)) for dataset, frames in pages]
    return sorted(pairs, key=lambda pair: (datasets.index(pair[0]), pair[1]))


def _hidden(measure: str) -> dict[str, list[str]]:
    """Tracker -> a measure of every dataset and length."""
    found = read_page(HIDDEN).datasets
    columns = [
        column(found[f"{dataset}-hidden-{frames}"][""], measure)
        for dataset, frames in _hidden_order()
    ]
    return {tracker: [values[tracker] for values in columns] for tracker in columns[0]}


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


def markdown(rows: Rows, numbers: bool) -> str:
    """A table; `numbers` puts all but the first column to the right."""
    rest = "---:" if numbers else "---"
    lines = [rows[0], ["---", *[rest] * (len(rows[0]) - 1)], *rows[1:]]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


TABLES = {
    "models": models,
    "trackers": trackers,
    "cards": cards,
    "alive": alive,
    "overlap": overlap,
    "absent": absent,
    "absent-clips": absent_clips,
}


if __name__ == "__main__":
    sys.exit(main())
