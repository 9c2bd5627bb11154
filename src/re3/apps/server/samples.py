"""Clips that anybody may try: those in `examples/clips`, which a wheel carries as `re3_clips`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

INSTALLED = Path(__file__).parents[3] / "re3_clips"
IN_REPOSITORY = Path(__file__).parents[4] / "examples" / "clips"


@dataclass(frozen=True)
class Sample:
    """A clip to try.

    Attributes:
        name: of the file, by which it is asked for.
        title: for people.
        credit: whose it is and under which licence; to be shown with it.
    """

    name: str
    title: str
    credit: str

    @property
    def path(self) -> Path:
        """Of the file, beside the installed package or in the repository."""
        installed = INSTALLED / self.name
        return installed if installed.is_file() else IN_REPOSITORY / self.name


_CATALOGUE = (
    Sample(
        "person.mp4",
        "a person at a table",
        "Intel IoT DevKit sample videos, © Intel Corporation, CC BY 4.0; shortened and scaled",
    ),
)


def samples() -> list[Sample]:
    """The clips that are there."""
    return [sample for sample in _CATALOGUE if sample.path.is_file()]


def find_sample(name: str) -> Sample:
    """A clip by name; raises KeyError that says which there are."""
    for sample in samples():
        if sample.name == name:
            return sample
    raise KeyError(
        f"there is no sample {name!r}; there are {', '.join(s.name for s in samples()) or 'none'}"
    )
