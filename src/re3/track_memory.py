"""What a tracker remembers of one object, and how that is saved and restored."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import astuple, dataclass, field

import numpy as np
from numpy.typing import NDArray

from re3.confidence import ScoreMemory
from re3.engine import State
from re3.framing_bias import NO_BIAS
from re3.geometry import Floats
from re3.model_spec import ModelSpec
from re3.motion import Motion
from re3.result import Result, Status


@dataclass
class Track:
    """All that is remembered of one object.

    Attributes:
        box_xyxy: `[4]`, in the frame last seen.
        previous_crop: uint8 `[S, S, 3]` about that box in that frame, so that the frame itself
            need not be kept; None for a model without previous crop.
        state: recurrent state, arrays without the batch dimension.
        first_state: the state after the first forward pass, to which it is reset.
        steps: since the last reset.
        result: of the frame last seen.
        trusted_xyxy: `[4]`, the latest box that was neither uncertain nor lost.
        first_patch, last_patch: the object in the first frame, and in one of the last in which it
            had its usual score, to find what looks like it; as `re3.search.cut_patch` gives them.
        framing_bias: `[4]`, left, top, right, bottom in sides of a box: what is taken off each box
            that the network finds, as `re3.framing_bias.framing_bias` gives it.
        searched_for: frames on end with a score low enough for a search.
        scores: what is remembered of them.
        motion: what is remembered of how it moves.
        lost_at_xyxy: `[4]`, the box last trusted before the object was searched for.
        sure_sides: `[2]`, width and height of the box that last had the usual score.
        doubted_frames: for which that place is looked at again.
    """

    box_xyxy: Floats
    previous_crop: NDArray[np.uint8] | None
    state: State
    first_state: State
    steps: int
    result: Result
    trusted_xyxy: Floats
    lost_at_xyxy: Floats
    sure_sides: Floats
    first_patch: NDArray[np.uint8]
    last_patch: NDArray[np.uint8]
    framing_bias: Floats = field(default_factory=lambda: NO_BIAS)
    searched_for: int = 0
    doubted_frames: int = 0
    scores: ScoreMemory = field(default_factory=ScoreMemory)
    motion: Motion = field(default_factory=Motion)

    def save(self) -> dict[str, NDArray]:
        """All of it as plain arrays, copies, each under the object's id and a name."""
        result = self.result
        saved = {
            "box_xyxy": self.box_xyxy.copy(),
            "steps": np.array(self.steps),
            "trusted_xyxy": self.trusted_xyxy.copy(),
            "first_patch": self.first_patch.copy(),
            "last_patch": self.last_patch.copy(),
            "framing_bias": self.framing_bias.copy(),
            "searched_for": np.array(self.searched_for),
            "lost_at_xyxy": self.lost_at_xyxy.copy(),
            "sure_sides": self.sure_sides.copy(),
            "doubted_frames": np.array(self.doubted_frames),
            "scores": np.array(astuple(self.scores), np.float64),
            "motion_errors": np.array(self.motion.errors, np.float64),
            "motion_steps": np.array([self.motion.step, self.motion.own_step], np.float64),
            "result": np.array([*result.box_xywh, result.score, result.frame_index], np.float64),
            "status": np.array(result.status.value),
        }
        if self.previous_crop is not None:
            saved["previous_crop"] = self.previous_crop.copy()
        if result.name is not None:
            saved["name"] = np.array(result.name)
        for name, values in self.state.items():
            saved[f"state/{name}"] = values.copy()
            saved[f"first_state/{name}"] = self.first_state[name].copy()
        return {f"{result.object_id}/{name}": value for name, value in saved.items()}

    @classmethod
    def restore(cls, saved: Mapping[str, NDArray], object_id: int, spec: ModelSpec) -> Track:
        """From what `save` gave, among that of other objects.

        Args:
            saved: arrays by name.
            object_id: whose.
            spec: of the model that goes on with it.

        Raises:
            KeyError: something is missing.
            ValueError: a recurrent state of another shape than the model's.
        """

        def floats(name: str) -> Floats:
            return np.array(saved[f"{object_id}/{name}"], np.float64)

        def pixels(name: str) -> NDArray[np.uint8]:
            return np.array(saved[f"{object_id}/{name}"], np.uint8)

        def whole(name: str) -> int:
            return int(saved[f"{object_id}/{name}"])

        x, y, w, h, score, index = floats("result").tolist()
        usual, recent, low_frames, lost = floats("scores").tolist()
        step_x, step_y, own_x, own_y = floats("motion_steps").ravel().tolist()
        name = f"{object_id}/name"
        return cls(
            box_xyxy=floats("box_xyxy"),
            previous_crop=None if spec.previous is None else pixels("previous_crop"),
            state=_restored_state(saved, f"{object_id}/state", spec),
            first_state=_restored_state(saved, f"{object_id}/first_state", spec),
            steps=whole("steps"),
            trusted_xyxy=floats("trusted_xyxy"),
            first_patch=pixels("first_patch"),
            last_patch=pixels("last_patch"),
            framing_bias=floats("framing_bias"),
            searched_for=whole("searched_for"),
            lost_at_xyxy=floats("lost_at_xyxy"),
            sure_sides=floats("sure_sides"),
            doubted_frames=whole("doubted_frames"),
            scores=ScoreMemory(usual, recent, int(low_frames), bool(lost)),
            motion=Motion(
                errors=tuple(floats("motion_errors").tolist()),
                step=(step_x, step_y),
                own_step=(own_x, own_y),
            ),
            result=Result(
                box_xywh=(x, y, w, h),
                score=score,
                status=Status(str(saved[f"{object_id}/status"])),
                frame_index=int(index),
                object_id=object_id,
                name=str(saved[name]) if name in saved else None,
            ),
        )


def _restored_state(saved: Mapping[str, NDArray], prefix: str, spec: ModelSpec) -> State:
    state = {name: np.array(saved[f"{prefix}/{name}"], np.float32) for name in spec.state}
    for name, shape in spec.state.items():
        if state[name].shape != shape:
            raise ValueError(
                f"saved {prefix}/{name} has shape {state[name].shape}; model {spec.name!r} "
                f"expects {shape}"
            )
    return state
