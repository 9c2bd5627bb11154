"""Mixes in YAML: what they say, and what is drawn."""

import re
from collections import Counter
from pathlib import Path

import cv2
import numpy as np
import pytest

pytest.importorskip("yaml", reason="mixes need PyYAML (the train extra)")

from re3.data.frame_store import FrameStore
from re3.data.mix import mix_sampler, read_mix
from re3.data.sampling import ClipSampler, Source
from re3.data.sampling_config import SamplingConfig
from re3.data.simulation_config import PAPER_SIMULATION, SimulationConfig
from re3.data.stills import SMALLEST_SHARE


def clips(folder, *names, frames=12):
    """Plain clips of 64 x 48 pixels with a square that walks."""
    for name in names:
        (folder / name).mkdir(parents=True)
        for t in range(frames):
            image = np.full((48, 64, 3), 40, np.uint8)
            image[10:30, 2 + 2 * t : 22 + 2 * t] = 220
            cv2.imwrite(str(folder / name / f"{t:04d}.png"), image)
        boxes = "".join(f"{2 + 2 * t},10,20,20\n" for t in range(frames))
        (folder / f"{name}.txt").write_text(boxes)
    return folder


def pictures(folder, *names):
    """Images with YOLO labels."""
    for name in names:
        (folder / "images").mkdir(parents=True, exist_ok=True)
        (folder / "labels").mkdir(parents=True, exist_ok=True)
        image = np.random.default_rng(0).integers(0, 255, (48, 64, 3), dtype=np.uint8)
        cv2.imwrite(str(folder / "images" / f"{name}.png"), image)
        (folder / "labels" / f"{name}.txt").write_text("0 0.5 0.5 0.4 0.4\n")
    return folder


@pytest.fixture(scope="module")
def data(tmp_path_factory):
    folder = tmp_path_factory.mktemp("data")
    clips(folder / "few", "a")
    clips(folder / "many", *"bcdef", frames=20)
    pictures(folder / "dogs", "rex")
    pictures(folder / "cats", "tom", "kit", "leo")
    return folder


def write(folder, text):
    path = folder / "mix.yaml"
    path.write_text(text)
    return path


FOUR = """
simulated: 0.4
sources:
  - {path: few, kind: videos, weight: 3}
  - {path: many, kind: videos}
  - {path: dogs, kind: stills, weight: 0.5}
  - {path: cats, kind: stills, weight: 1.5, name: felines}
"""


def test_weights_are_what_is_drawn(data, tmp_path):
    sampler = mix_sampler(read_mix(write(data, FOUR)), FrameStore(tmp_path))
    wanted = {
        ("few", "videos"): 0.6 * 3 / 4,
        ("many", "videos"): 0.6 * 1 / 4,
        ("dogs", "stills"): 0.4 * 0.5 / 2,
        ("felines", "stills"): 0.4 * 1.5 / 2,
    }
    assert sampler.shares() == pytest.approx(wanted)
    draws = 1500
    counts = Counter(
        (clip.origin.source, clip.origin.kind)
        for clip in (sampler.sample(2, np.random.default_rng(seed)) for seed in range(draws))
    )
    assert set(counts) == set(wanted)
    for source, share in wanted.items():
        # Four standard deviations of a count.
        assert abs(counts[source] - draws * share) < 4 * np.sqrt(draws * share * (1 - share))


def test_clips_that_begin_without_the_object_do_not_shift_the_weights(data, tmp_path):
    """A track with a box in one frame of ten, beside one that is whole."""
    gaps = data / "gaps"
    if not gaps.exists():
        clips(gaps, "g", frames=40)
        lines = ["4,10,20,20\n" if t % 10 == 5 else "nan,nan,nan,nan\n" for t in range(40)]
        (gaps / "g.txt").write_text("".join(lines))
    text = "sources: [{path: gaps, kind: videos}, {path: few, kind: videos}]"
    sampler = mix_sampler(read_mix(write(data, text)), FrameStore(tmp_path))
    counts = Counter()
    for seed in range(600):
        clip = sampler.sample(4, np.random.default_rng(seed))
        assert not np.isnan(clip.boxes_xyxy[0]).any()
        counts[clip.origin.source] += 1
    assert abs(counts["gaps"] - 300) < 4 * np.sqrt(600 / 4)


def test_what_is_said_is_what_is_set(data):
    mix = read_mix(
        write(
            data,
            """
            simulated: 0.25
            sources:
              - {path: few, kind: videos, format: plain, exclude: [a]}
              - {path: dogs, kind: stills, smallest_share: 0.05}
            sampling: {mirrored: 0, reversed: 1.0, strides: [1, 2], smallest: 8}
            photometric: {grey: 1e-1, noise: 0.5}
            simulation: {occluders: 2, speed: [0.01, 0.5], fill: [1, 2, 3], leaves_by: [walks]}
            """,
        )
    )
    few, dogs = mix.sources
    assert (few.path, few.format, few.exclude, few.weight) == (data / "few", "plain", ("a",), 1.0)
    assert (few.smallest_share, dogs.smallest_share, dogs.name) == (SMALLEST_SHARE, 0.05, "dogs")
    sampling = mix.sampling
    assert (sampling.simulated, sampling.mirrored, sampling.reversed) == (0.25, 0.0, 1.0)
    assert (sampling.strides, sampling.smallest) == ((1, 2), 8.0)
    # YAML takes 1e-1 for a text.
    assert (sampling.photometric.grey, sampling.photometric.noise) == (0.1, 0.5)
    assert sampling.simulation == SimulationConfig(
        occluders=2.0, speed=(0.01, 0.5), fill=(1.0, 2.0, 3.0), leaves_by=("walks",)
    )


def test_what_is_not_said_is_as_for_folders(data):
    mix = read_mix(write(data, "sources: [{path: few, kind: videos}, {path: dogs, kind: stills}]"))
    assert mix.sampling == SamplingConfig()


def test_the_papers_simulation_has_a_name(data):
    text = "sources: [{path: dogs, kind: stills}]\nsimulation: paper"
    assert read_mix(write(data, text)).sampling.simulation == PAPER_SIMULATION


ONE = "sources: [{path: few, kind: videos}]\n"


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("", r"None; expected keys, of sources"),
        ("sources: []", "no sources; expected a list"),
        ("[1, 2]", r"\[1, 2\]; expected keys"),
        ("sources: [", "is not well formed"),
        pytest.param("sources: " + 20_000 * "[", "nested too deeply", id="nested"),
        ("sources: []\nsources: []", "'sources' comes twice in line 2"),
        (ONE + "simulatd: 0.5", "unknown key 'simulatd'; .* did you mean 'simulated'"),
        ("sources: [{path: few}]", r"sources\[0\]: no kind; expected path and kind"),
        ("sources: [{kind: videos}]", r"sources\[0\]: no path"),
        ("sources: [few]", r"sources\[0\]: 'few'; expected keys, of path, kind"),
        ("sources: [{path: few, kind: video}]", "kind is 'video'; expected videos or stills"),
        ("sources: [{path: few, kind: videos, wieght: 2}]", "'wieght'.* did you mean 'weight'"),
        ("sources: [{path: few, kind: videos, weight: x}]", "weight is 'x'; expected a number"),
        ("sources: [{path: few, kind: videos, weight: true}]", "is True; expected a number"),
        ("sources: [{path: few, kind: videos, weight: -1}]", "weight is -1.0; expected 0 or more"),
        ("sources: [{path: few, kind: videos, weight: 0}]", "all sources have weight 0"),
        ("sources: [{path: few, kind: videos, exclude: a}]", "exclude is 'a'; expected a list"),
        ("sources: [{path: few, kind: videos, smallest_share: 0}]", "smallest_share is of stills"),
        (
            "sources: [{path: few, kind: videos}, {path: ./few, kind: videos}]",
            "several sources are called few",
        ),
        (ONE + "simulated: 0.5", "simulated is 0.5, but no source .* is of kind stills"),
        ("simulated: 0.9\nsources: [{path: dogs, kind: stills}]", "is of kind videos"),
        (ONE + "simulated: 2", "simulated is 2.0; expected a probability"),
        (ONE + "sampling: {strides: [0]}", r"sampling: strides is \[0\]; expected .* from 1 on"),
        (ONE + "sampling: {strides: [1.5]}", r"strides\[0\] is 1.5; expected a whole number"),
        (ONE + "sampling: {simulated: 0.5}", "unknown key 'simulated'; expected one of mirrored"),
        (ONE + "sampling: 3", "sampling: 3; expected keys, of mirrored"),
        (ONE + "photometric: {gray: 1}", "photometric: unknown key 'gray'.* did you mean 'grey'"),
        (ONE + "photometric: {grey: 1.5}", "photometric: grey is 1.5; expected a probability"),
        (ONE + "simulation: {speed: [2, 1]}", r"simulation: speed is \[2.0, 1.0\]; expected two"),
        (ONE + "simulation: papper", "simulation is 'papper'; expected 'paper' or settings"),
    ],
)
def test_what_is_wrong_is_told_with_its_place(data, text, told):
    with pytest.raises(ValueError, match=rf"(?s)mix\.yaml.*{told}"):
        read_mix(write(data, text))


def test_missing_paths_are_told(data):
    with pytest.raises(FileNotFoundError, match=r"sources\[0\]: path .*gone does not exist"):
        read_mix(write(data, "sources: [{path: gone, kind: videos}]"))
    with pytest.raises(NotADirectoryError, match=r"path .*a\.txt is not a folder"):
        read_mix(write(data, "sources: [{path: few/a.txt, kind: videos}]"))
    with pytest.raises(FileNotFoundError, match=r"other\.yaml does not exist"):
        read_mix(data / "other.yaml")


@pytest.mark.parametrize(
    ("source", "left"),
    [
        ("{path: many, kind: videos, exclude: [b, e]}", {"c", "d", "f"}),
        ("{path: many, kind: videos, exclude: ['[b-e]']}", {"f"}),
        ("{path: ., kind: videos, exclude: [many, gaps]}", {"a"}),
    ],
)
def test_sequences_and_datasets_are_left_out_by_name(data, tmp_path, source, left):
    clips(data / "gaps", "g") if not (data / "gaps").exists() else None
    sampler = mix_sampler(read_mix(write(data, f"sources: [{source}]")), FrameStore(tmp_path))
    assert {sequence.name for sequence in sampler.sequences} == left


def test_pictures_are_left_out_by_name(data, tmp_path):
    text = "sources: [{path: cats, kind: stills, exclude: [kit]}]"
    sampler = mix_sampler(read_mix(write(data, text)), FrameStore(tmp_path))
    assert {still.image.stem for still in sampler.stills} == {"tom", "leo"}


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("{path: many, kind: videos, exclude: [bb]}", "nothing is called 'bb'.* did you mean 'b'"),
        ("{path: cats, kind: stills, exclude: ['*']}", "every picture is excluded"),
        ("{path: few, kind: videos, exclude: ['*']}", "source 'few': nothing to train on"),
        ("{path: few, kind: videos, format: otb}", "no clip in the format otb"),
        ("{path: cats, kind: stills, format: coco}", "holds nothing in the format coco"),
    ],
)
def test_data_that_does_not_fit_the_mix_is_told(data, tmp_path, text, told):
    mix = read_mix(write(data, f"sources: [{text}]"))
    with pytest.raises(ValueError, match=told):
        mix_sampler(mix, FrameStore(tmp_path))


def test_a_source_of_weight_0_is_not_read(data, tmp_path):
    text = "sources: [{path: few, kind: videos}, {path: dogs, kind: videos, weight: 0}]"
    sampler = mix_sampler(read_mix(write(data, text)), FrameStore(tmp_path))
    assert list(sampler.shares()) == [("few", "videos")]


def test_a_weight_of_0_is_no_source_of_a_sampler(tmp_path):
    with pytest.raises(ValueError, match="source 'x' has weight 0; expected above 0"):
        Source("x", weight=0)
    with pytest.raises(ValueError, match="no source has tracks or stills"):
        ClipSampler.of([], FrameStore(tmp_path))


PAGE = (Path(__file__).parents[2] / "docs" / "training.md").read_text(encoding="utf-8")


BLOCKS = re.findall(r"```yaml\n(.*?)```", PAGE, flags=re.DOTALL)


@pytest.mark.parametrize("block", [block for block in BLOCKS if "sources:" in block])
def test_the_mixes_of_the_docs_can_be_read(tmp_path, block):
    for path in re.findall(r"path: ([\w./-]+)", block):
        (tmp_path / path).mkdir(parents=True)
    mix = read_mix(write(tmp_path, block))
    if "photometric" in block:  # the page says that these are the defaults
        assert mix.sampling == SamplingConfig()


def test_the_papers_sampling(tmp_path):
    (tmp_path / "films").mkdir()
    (tmp_path / "mix.yaml").write_text(
        "sources: [{path: films, kind: videos}]\nsampling: paper\nphotometric: {grey: 0.5}\n"
    )
    sampling = read_mix(tmp_path / "mix.yaml").sampling
    assert (sampling.leaps, sampling.reversed, sampling.strides) == (0.0, 0.0, (1,))
    assert sampling.simulation == PAPER_SIMULATION
    assert sampling.photometric.grey == 0.5
