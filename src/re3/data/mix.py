"""What a network is trained on, declared in a YAML file: sources with weights, and how clips are
drawn from them.

    simulated: 0.6                # share of clips simulated from stills
    sources:
      - path: got10k/train        # relative to this file
        kind: videos
        weight: 2                 # among the sources of its kind; 1 by default
        exclude: ["GOT-10k_Train_000001"]
      - path: coco
        kind: stills
        format: coco              # by default what the folder looks like
    sampling: {reversed: 0.5, strides: [1, 1, 2, 3]}
    photometric: {grey: 0.1}
    simulation: {occluders: 1.5}  # or: paper

`sampling: paper` stands for what the paper describes: no temporal gaps, reversal, strides or camera
effects, and its simulation.

Everything but `sources` may be left out; see `docs/training.md`.
"""

from __future__ import annotations

import difflib
import typing
from collections.abc import Callable, Mapping
from collections.abc import Sequence as Several
from dataclasses import dataclass, fields, replace
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any, TypeVar, get_args

from re3.data.clip import Kind
from re3.data.formats import read_dataset
from re3.data.formats.files import dataset_name
from re3.data.frame_store import FrameStore
from re3.data.photometric_config import PhotometricConfig
from re3.data.sampling import ClipSampler, Source
from re3.data.sampling_config import PAPER_SAMPLING, SamplingConfig
from re3.data.sequence import Sequence
from re3.data.simulation_config import PAPER_SIMULATION, SimulationConfig
from re3.data.still_formats import read_stills
from re3.data.stills import SMALLEST_SHARE, Still

SUFFIXES = (".yaml", ".yml")
PAPER = "paper"
"""Stands for sampling, or the simulation alone, as the paper describes it."""

T = TypeVar("T")

_NESTED = ("simulation", "photometric", "simulated")
"""Fields of the sampling's configuration that are written one level up."""


@dataclass(frozen=True)
class MixSource:
    """A folder to train on.

    Attributes:
        path: the folder.
        kind: what is in it.
        name: of the source, by default that of its folder.
        format: of the data; None for the one the folder looks like.
        weight: among the sources of the same kind; 0 leaves the source out.
        exclude: names, or patterns with `*` and `?`, that are left out: of datasets, clips and
            tracks, or of pictures without their suffix.
        smallest_share: of stills, the share of its picture that an object has to cover.
    """

    path: Path
    kind: Kind
    name: str
    format: str | None = None
    weight: float = 1.0
    exclude: tuple[str, ...] = ()
    smallest_share: float = SMALLEST_SHARE


@dataclass(frozen=True)
class Mix:
    """What is trained on, and how clips are drawn from it."""

    sources: tuple[MixSource, ...]
    sampling: SamplingConfig = SamplingConfig()


def read_mix(path: str | Path) -> Mix:
    """Read a mix and check all that can be checked without reading the data.

    Raises:
        FileNotFoundError, NotADirectoryError: no such file, or no folder of a source.
        ValueError: not YAML, an unknown key, a value of another kind or out of its range; the
            message names the file and the place in it.
        ImportError: PyYAML is not installed.
    """
    path = Path(path)
    if not path.is_file():
        raise FileNotFoundError(f"{path} does not exist; expected a YAML file of a mix")
    content = _load_yaml(path)
    known = ("sources", "simulated", "sampling", "photometric", "simulation")
    section = _mapping(content, known, str(path))
    listed = section.get("sources")
    if not isinstance(listed, list) or not listed:
        raise ValueError(f"{path}: no sources; expected a list of them, each with path and kind")
    sources = tuple(
        _source(item, path.parent, f"{path}: sources[{index}]") for index, item in enumerate(listed)
    )
    names = [source.name for source in sources]
    if twice := sorted({name for name in names if names.count(name) > 1}):
        raise ValueError(
            f"{path}: several sources are called {', '.join(twice)}; give them names that differ"
        )
    used = {source.kind for source in sources if source.weight > 0}
    if not used:
        raise ValueError(f"{path}: all sources have weight 0; expected one above 0")
    asked = section.get("sampling") or {}
    sampling = (
        PAPER_SAMPLING
        if asked == PAPER
        else _configuration(SamplingConfig, asked, f"{path}: sampling", without=_NESTED)
    )
    simulated = section.get("simulated", sampling.simulated if len(used) == 2 else None)
    if simulated is not None:
        changed = {"simulated": _value(float, simulated, f"{path}: simulated")}
        sampling = _checked(lambda: replace(sampling, **changed), str(path))
        needed = {"stills": sampling.simulated, "videos": 1 - sampling.simulated}
        for kind, share in needed.items():
            if share > 0 and kind not in used:
                raise ValueError(
                    f"{path}: simulated is {sampling.simulated:g}, but no source with a weight "
                    f"above 0 is of kind {kind}; add one, or leave simulated out"
                )
    return Mix(
        sources,
        replace(
            sampling,
            photometric=(
                _configuration(PhotometricConfig, section["photometric"], f"{path}: photometric")
                if section.get("photometric")
                else sampling.photometric
            ),
            simulation=(
                _simulation(section["simulation"], f"{path}: simulation")
                if section.get("simulation")
                else sampling.simulation
            ),
        ),
    )


def mix_sampler(mix: Mix, store: FrameStore) -> ClipSampler:
    """Read the sources of a mix and draw clips from them.

    Raises:
        ValueError, OSError: a source cannot be read or has nothing to train on, or a name to leave
            out fits nothing in it.
    """
    return ClipSampler.of(mix_sources(mix), store, mix.sampling)


def mix_sources(mix: Mix) -> list[Source]:
    """The sources of a mix with their tracks and stills, those of weight 0 left out.

    Raises:
        ValueError, OSError: a source cannot be read, or a name to leave out fits nothing in it.
    """
    sources = []
    for source in mix.sources:
        if source.weight == 0:
            continue
        if source.kind == "videos":
            sequences = _sequences(source)
            sources.append(Source(source.name, sequences=sequences, weight=source.weight))
        else:
            sources.append(Source(source.name, stills=_stills(source), weight=source.weight))
    return sources


def _sequences(source: MixSource) -> list[Sequence]:
    sequences = read_dataset(source.path, source.format, training=True)

    def names(sequence: Sequence) -> tuple[str, ...]:
        return sequence.dataset, sequence.name, sequence.name.partition("/")[0]

    _check_names(source, {name for sequence in sequences for name in names(sequence)})
    return [s for s in sequences if not any(_excluded(source, name) for name in names(s))]


def _stills(source: MixSource) -> list[Still]:
    stills = read_stills(source.path, source.format, source.smallest_share)
    _check_names(source, {name for still in stills for name in (still.dataset, still.image.stem)})
    kept = [
        still
        for still in stills
        if not _excluded(source, still.dataset) and not _excluded(source, still.image.stem)
    ]
    if not kept:
        raise ValueError(f"source {source.name!r}: every picture is excluded; exclude fewer")
    return kept


def _excluded(source: MixSource, name: str) -> bool:
    return any(fnmatchcase(name, pattern) for pattern in source.exclude)


def _check_names(source: MixSource, known: set[str]) -> None:
    """Raise ValueError where a name to leave out fits nothing: it may be misspelt."""
    for pattern in source.exclude:
        if not any(fnmatchcase(name, pattern) for name in known):
            raise ValueError(
                f"source {source.name!r}: nothing is called {pattern!r}, which is to be excluded"
                f"{_suggestion(pattern, sorted(known))}"
            )


def _source(item: Any, folder: Path, where: str) -> MixSource:
    known = tuple(field.name for field in fields(MixSource))
    section = _mapping(item, known, where)
    for needed in ("path", "kind"):
        if needed not in section:
            raise ValueError(
                f"{where}: no {needed}; expected path and kind, and any of {known[2:]}"
            )
    kind = section["kind"]
    if kind not in get_args(Kind):
        raise ValueError(f"{where}: kind is {kind!r}; expected {' or '.join(get_args(Kind))}")
    if kind == "videos" and "smallest_share" in section:
        raise ValueError(f"{where}: smallest_share is of stills; {where} holds videos")
    path = folder / Path(_value(str, section["path"], f"{where}: path")).expanduser()
    if not path.exists():
        raise FileNotFoundError(
            f"{where}: path {path} does not exist; paths are relative to the folder of the mix"
        )
    if not path.is_dir():
        raise NotADirectoryError(f"{where}: path {path} is not a folder; expected one with {kind}")
    values = {
        name: _value(_hints(MixSource)[name], section[name], f"{where}: {name}")
        for name in known
        if name in section and name not in ("path", "kind")
    }
    source = MixSource(**{"name": dataset_name(path), **values}, path=path, kind=kind)
    if not 0 <= source.weight < float("inf"):
        raise ValueError(f"{where}: weight is {source.weight}; expected 0 or more")
    if not 0 <= source.smallest_share < 1:
        raise ValueError(
            f"{where}: smallest_share is {source.smallest_share}; expected 0 or more and below 1"
        )
    return source


def _simulation(content: Any, where: str) -> SimulationConfig:
    if content == PAPER:
        return PAPER_SIMULATION
    if isinstance(content, str):
        raise ValueError(f"{where} is {content!r}; expected {PAPER!r} or settings")
    return _configuration(SimulationConfig, content, where)


def _configuration(kind: type[T], content: Any, where: str, without: tuple[str, ...] = ()) -> T:
    """A dataclass of settings from what the file says of them."""
    hints = {name: hint for name, hint in _hints(kind).items() if name not in without}
    section = _mapping(content, tuple(hints), where)
    values = {
        name: _value(hints[name], value, f"{where}.{name}") for name, value in section.items()
    }
    return _checked(lambda: kind(**values), where)


def _checked(make: Callable[[], T], where: str) -> T:
    try:
        return make()
    except ValueError as error:
        raise ValueError(f"{where}: {error}") from error


def _hints(kind: type) -> dict[str, Any]:
    return typing.get_type_hints(kind)


def _mapping(content: Any, known: tuple[str, ...], where: str) -> Mapping[str, Any]:
    if not isinstance(content, dict):
        raise ValueError(f"{where}: {content!r}; expected keys, of {', '.join(known)}")
    for key in content:
        if key not in known:
            raise ValueError(
                f"{where}: unknown key {key!r}; expected one of {', '.join(known)}"
                f"{_suggestion(str(key), known)}"
            )
    return content


def _value(hint: Any, value: Any, where: str) -> Any:
    """A value of the file as the type that a setting has."""
    inner = [kind for kind in get_args(hint) if kind not in (type(None), Ellipsis)]
    if typing.get_origin(hint) is tuple:
        if not isinstance(value, list):
            raise ValueError(f"{where} is {value!r}; expected a list [..., ...]")
        return tuple(_value(inner[0], item, f"{where}[{i}]") for i, item in enumerate(value))
    if inner:  # or nothing
        return None if value is None else _value(inner[0], value, where)
    if hint is str and isinstance(value, (str, int, float)) and not isinstance(value, bool):
        return str(value)
    if hint is int and isinstance(value, int) and not isinstance(value, bool):
        return value
    if hint is float and not isinstance(value, bool):
        try:
            # YAML takes 1e-3 for a text: its numbers have a point.
            return float(value)
        except (TypeError, ValueError):
            pass
    wanted = {str: "a text", int: "a whole number", float: "a number"}[hint]
    raise ValueError(f"{where} is {value!r}; expected {wanted}")


def _suggestion(name: str, known: Several[str]) -> str:
    near = difflib.get_close_matches(name, known, n=1)
    return f"; did you mean {near[0]!r}?" if near else ""


def _load_yaml(path: Path) -> Any:
    try:
        import yaml
    except ImportError as error:
        raise ImportError(
            f"{path} needs PyYAML to be read ({error}); pip install 're3[train]'"
        ) from error

    class Loader(yaml.SafeLoader):
        """YAML that refuses a key that comes twice, where the first would be lost silently."""

        def construct_mapping(self, node: Any, deep: bool = False) -> dict[Any, Any]:
            seen = set()
            for key, _ in node.value:
                name = self.construct_object(key, deep=True)
                if name in seen:
                    raise ValueError(f"{name!r} comes twice in line {key.start_mark.line + 1}")
                seen.add(name)
            values: dict[Any, Any] = super().construct_mapping(node, deep)
            return values

    try:
        return yaml.load(path.read_text(encoding="utf-8-sig"), Loader)  # a SafeLoader
    except RecursionError as error:
        raise ValueError(f"{path} is nested too deeply; expected a mix as YAML") from error
    except (yaml.YAMLError, ValueError) as error:
        raise ValueError(f"{path} is not well formed: {error}; expected YAML") from error
