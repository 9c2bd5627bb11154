"""The protocols by name, each described in `docs/evaluation.md`.

A figure that is not defined is NaN.
"""

from __future__ import annotations

import math
from dataclasses import asdict, replace
from functools import lru_cache, partial

from re3.data.framing import FRAMINGS, frame_otherwise
from re3.data.hiding import AFTER, DURATIONS, LEAD, hide
from re3.data.sequence import Sequence
from re3.data.starts import (
    LEAST_FRAMES,
    SAMPLED_FRAMES,
    SAMPLED_STARTS,
    SHIFTED_STARTS,
    STARTS,
    sample_starts,
    start_later,
    start_shifted,
)
from re3.evaluation.ablation import ABLATION, SENSITIVITY, ablation
from re3.evaluation.clip_means import MeanWithError, clip_means
from re3.evaluation.imagenet_vid import pooled_success
from re3.evaluation.metrics import LOST_BELOW, Scores
from re3.evaluation.protocol import Axis, Figures, Measure, Protocol, clip_of
from re3.evaluation.reappearance import ALIVE, reappearance
from re3.evaluation.sequence_result import SequenceResult
from re3.evaluation.supervised import SupervisedConfig
from re3.evaluation.vot import VotRuns, VotStack, find_stack, score_vot

DEFAULT_STACK = "vot2016"
_OTB = ("ope", "tre", "sre")


def find_protocol(
    name: str, stack: str | VotStack = DEFAULT_STACK, *, occluded: bool = False
) -> Protocol:
    """A protocol by name.

    Args:
        name: `ope`, `tre`, `sre`, `starts`, `imagenet-vid`, `ablation`, `hidden`, `framed` or
            `vot`.
        stack: of the VOT protocol, the challenge whose lengths its EAO averages over.
        occluded: of the VOT protocol, also the expected overlap on occluded frames.

    Raises:
        ValueError: no such protocol, or no such challenge.
    """
    if isinstance(stack, str):
        stack = find_stack(stack)
    if name == "vot":
        return _vot(stack, occluded)
    if name not in _PROTOCOLS:
        raise ValueError(f"no protocol {name!r}; expected one of {', '.join(PROTOCOLS)}")
    return _PROTOCOLS[name]


def with_otb_rules(protocol: Protocol) -> Protocol:
    """A protocol whose figures count frames as OTB's toolkit does; see `re3.evaluation.metrics`.

    Its results have to be made with `otb_rules`, too.

    Raises:
        ValueError: its figures are not OTB's.
    """
    if protocol.name not in _OTB:
        raise ValueError(
            f"--otb-rules is of OTB's experiments, {', '.join(_OTB)}, not of {protocol.name}; "
            "leave it out, or take one of them"
        )
    return replace(
        protocol,
        title=f"{protocol.title}, OTB's rules",
        conventions=(
            f"{protocol.conventions} By the rules of OTB's toolkit: where a tracker has no box its "
            "last one is repeated; a frame without a true box, or whose true box has x or y at or "
            "below 0, counts as a miss in success and as a hit in precision."
        ),
    )


def _ope_figures(results: list[SequenceResult]) -> Figures:
    scores = Scores.mean([result.scores for result in results])
    return {measure.name: float(getattr(scores, measure.name)) for measure in _OPE_MEASURES}


def _starts_figures(results: list[SequenceResult]) -> Figures:
    """Means over clips, each the mean over its starts."""
    scored = [result for result in results if not result.track.unscored]

    def over_clips(name: str) -> MeanWithError:
        pairs = ((clip_of(r.sequence.name), float(getattr(r.scores, name))) for r in scored)
        return MeanWithError.of(list(clip_means(pairs).values()))

    auc, lost, ends_lost = (over_clips(name) for name in ("auc", "lost", "ends_lost"))
    return {
        "auc": auc.mean,
        "auc_error": auc.error,
        "sr50": over_clips("sr50").mean,
        "sr75": over_clips("sr75").mean,
        "lost": lost.mean,
        "lost_error": lost.error,
        "ends_lost": ends_lost.mean,
        "ends_lost_error": ends_lost.error,
        "clips": float(auc.count),
    }


def _imagenet_vid_figures(results: list[SequenceResult]) -> Figures:
    success = pooled_success(results)
    return {
        "auc": success.auc,
        "auc_after_first": success.auc_after_first,
        "tracks": float(success.tracks),
        "boxes": float(success.boxes),
    }


def _hidden_figures(results: list[SequenceResult]) -> Figures:
    return {**asdict(reappearance(results)), "sequences": float(len(results))}


def _ablation_figures(results: list[SequenceResult]) -> Figures:
    return {name: float(value) for name, value in asdict(ablation(results)).items()}


def _vot_figures(
    results: list[SequenceResult], stack: VotStack, measures: tuple[Measure, ...]
) -> Figures:
    groups: dict[tuple[str, str], list[SequenceResult]] = {}
    for result in results:
        if not result.track.unscored:
            key = (result.sequence.dataset, result.sequence.name)
            groups.setdefault(key, []).append(result)
    names = [measure.name for measure in measures]
    if not groups:
        return dict.fromkeys(names, math.nan)
    runs = []
    for group in groups.values():
        sequence = group[0].sequence
        tracks = [result.supervised for result in group if result.supervised is not None]
        size = _frame_size(sequence)
        truth, marks = sequence.boxes_xywh, sequence.occluded
        runs.append(VotRuns(sequence.name, truth, size, tracks, sequence.polygons, marks))
    scores = score_vot(runs, stack)
    return {name: float(getattr(scores, name)) for name in names}


@lru_cache(maxsize=4096)
def _frame_size(sequence: Sequence) -> tuple[int, int]:
    """Width and height: the toolkit leaves out what lies outside the frame."""
    height, width = next(sequence.frames()).shape[:2]
    return width, height


_VOT_MEASURES = (
    Measure("eao", "EAO"),
    Measure("accuracy", "A"),
    Measure("robustness", "R", "low"),
    Measure("reliability", "S(30)"),
    Measure("failures", "failures", "low", counts=True),
)


_OCCLUDED_EAO = Measure("eao_occluded", "EAO occluded")


def _vot(stack: VotStack, occluded: bool) -> Protocol:
    measures: tuple[Measure, ...] = _VOT_MEASURES
    if occluded:
        measures = (measures[0], _OCCLUDED_EAO, *measures[1:])
    lengths = (
        "which has no EAO"
        if stack.interval is None
        else f"EAO over lengths {stack.interval[0]} to {stack.interval[1]}"
    )
    return Protocol(
        name="vot",
        title=f"VOT's supervised experiment, {stack.name}",
        conventions=(
            f"The supervised experiment of VOT with the settings of {stack.name}, {lengths}: a "
            "tracker has failed where its box and the truth have no pixel in common, and is "
            f"started again with the truth {stack.restart_after} frames later. Where the truth is "
            f"a polygon, overlap is that with the polygon. {stack.burn_in} frames from a start on "
            "do not count for accuracy (A). Robustness (R) is failures a sequence, less is better; "
            "both are weighted by the sequences' lengths. S(30): chance of following for "
            "30 frames."
            + (
                " EAO occluded: stretches weighted by their share of frames marked as occluded."
                if occluded
                else ""
            )
        ),
        supervised=SupervisedConfig(restart_after=stack.restart_after, by_pixels=True),
        summarise=partial(_vot_figures, stack=stack, measures=measures),
        measures=measures,
        by_sequence=("accuracy", "failures"),
        pools_repeats=True,
        trade_off=(
            Axis("accuracy", "accuracy A: mean overlap, burn-in left out"),
            Axis("reliability", "robustness S(30): chance of following for 30 frames"),
        ),
    )


_OPE_MEASURES = (
    Measure("auc", "AUC"),
    Measure("precision", "P@20"),
    Measure("normalised_precision", "NP"),
    Measure("ao", "AO"),
    Measure("sr50", "SR.50"),
    Measure("sr75", "SR.75"),
)

_PROTOCOLS = {
    protocol.name: protocol
    for protocol in (
        Protocol(
            name="ope",
            title="One-pass evaluation",
            conventions=(
                "One pass, started at the first annotated frame with the truth, never "
                "re-initialised. AUC: 21 thresholds, first frame included. P@20: centres within "
                "20 pixels. NP: area under the precision curve normalised by the true size, 0 to "
                "0.5. AO, SR.50, SR.75: first frame left out. Each figure is the mean over "
                "sequences."
            ),
            supervised=None,
            summarise=_ope_figures,
            measures=_OPE_MEASURES,
            by_sequence=("auc", "precision"),
        ),
        Protocol(
            name="tre",
            title="Temporal robustness",
            conventions=(
                f"One pass from each of up to {STARTS} frames of a clip to its end, {LEAST_FRAMES} "
                "frames or more, started with the truth. Figures as of ope, means over all starts."
            ),
            supervised=None,
            summarise=_ope_figures,
            measures=_OPE_MEASURES,
            by_sequence=("auc", "precision"),
            prepare=start_later,
            many_starts=True,
        ),
        Protocol(
            name="sre",
            title="Spatial robustness",
            conventions=(
                f"One pass from each of {len(SHIFTED_STARTS)} boxes beside the truth: moved by a "
                "tenth of its sides, or of .8, .9, 1.1 and 1.2 times its sides. Compared with the "
                "truth as it is. Figures as of ope, means over all starts."
            ),
            supervised=None,
            summarise=_ope_figures,
            measures=_OPE_MEASURES,
            by_sequence=("auc", "precision"),
            prepare=start_shifted,
            many_starts=True,
        ),
        Protocol(
            name="starts",
            title="Temporal and spatial robustness, on a subset",
            conventions=(
                f"One pass from each of {SAMPLED_STARTS} frames of a clip, as of tre, and from "
                f"{SAMPLED_STARTS} boxes beside the truth, as of sre, for {SAMPLED_FRAMES} frames "
                "at most. AUC, SR.50, SR.75 as of ope. Frames lost: share with an overlap below "
                f"{LOST_BELOW:g}, first frame left out. Ends lost: share of tracks whose last "
                "frame is lost. Each figure is the mean over clips, of a clip the mean over its "
                "starts; ± is the standard error over clips."
            ),
            supervised=None,
            summarise=_starts_figures,
            measures=(
                Measure("auc", "AUC"),
                Measure("auc_error", "±", None),
                Measure("sr50", "SR.50"),
                Measure("sr75", "SR.75"),
                Measure("lost", "frames lost", "low"),
                Measure("lost_error", "±", None),
                Measure("ends_lost", "ends lost", "low"),
                Measure("ends_lost_error", "±", None),
                Measure("clips", "clips", None, counts=True),
            ),
            by_sequence=("auc", "lost"),
            prepare=sample_starts,
            many_starts=True,
        ),
        Protocol(
            name="imagenet-vid",
            title="Imagenet Video, one pass",
            conventions=(
                "One pass (Re3, sec. IV-B), started at the first annotated frame with the truth, "
                "never re-initialised. AUC of one success curve over all boxes of all tracks, 21 "
                "thresholds, first frames included with overlap 1; the other AUC leaves them out."
            ),
            supervised=None,
            summarise=_imagenet_vid_figures,
            measures=(
                Measure("auc", "AUC"),
                Measure("auc_after_first", "AUC without first frames"),
                Measure("tracks", "tracks", None, counts=True),
                Measure("boxes", "boxes", None, counts=True),
            ),
            by_sequence=("auc",),
            pools_boxes=True,
        ),
        Protocol(
            name="ablation",
            title="Ablation study, with restarts",
            conventions=(
                "Re3, Table I. A track is dropped where box and truth do not overlap; five frames "
                "are passed over and the tracker is started with the truth in the sixth, and ten "
                "frames from there on do not count. Accuracy: mean overlap over the counted "
                "frames of all sequences. Robustness: e^(-30 drops / frames), over all annotated "
                "frames. Average: the mean of both."
            ),
            supervised=ABLATION,
            summarise=_ablation_figures,
            measures=(
                Measure("accuracy", "accuracy"),
                Measure("drops", "drops", "low", counts=True),
                Measure("robustness", "robustness"),
                Measure("average", "average"),
                Measure("frames", "frames", None, counts=True),
            ),
            by_sequence=("accuracy", "drops"),
            pools_boxes=True,
            trade_off=(
                Axis("accuracy", "accuracy: mean overlap of the counted frames"),
                Axis("robustness", f"robustness: exp(-{SENSITIVITY:.0f} · drops / frames)"),
            ),
        ),
        Protocol(
            name="hidden",
            title="Hidden and back again",
            conventions=(
                f"One pass over clips in which the object is hidden, from {LEAD} frames after the "
                f"start, for {', '.join(map(str, DURATIONS))} frames: a window about it shows "
                "another part of the scene. Alive: share of tracks that overlap the object by "
                f"{ALIVE:g} or more {AFTER} frames after it is back; before: in the frame before "
                "it is hidden, which no tracker can better. Overlap: the mean from then to the end."
            ),
            supervised=None,
            summarise=_hidden_figures,
            measures=(
                Measure("alive", "alive"),
                Measure("alive_before", "before"),
                Measure("overlap_after", "overlap"),
                Measure("sequences", "clips", None, counts=True),
            ),
            by_sequence=("overlap_after", "alive"),
            prepare=hide,
        ),
        Protocol(
            name="framed",
            title="Boxes of other framings",
            conventions=(
                "One pass from boxes that hold a part of the object, or more than it "
                f"({', '.join(FRAMINGS)}), compared with the true boxes framed alike. Figures as "
                "of ope."
            ),
            supervised=None,
            summarise=_ope_figures,
            measures=_OPE_MEASURES,
            by_sequence=("auc",),
            prepare=frame_otherwise,
        ),
    )
}

PROTOCOLS = (*_PROTOCOLS, "vot")
"""Names of the protocols."""
