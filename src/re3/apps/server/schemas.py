"""What the API takes and gives, as its OpenAPI page shows it."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field

from re3.apps.server.names import LONGEST

Box = Annotated[
    list[float],
    Field(
        min_length=4,
        max_length=4,
        description="x, y, width, height in pixels of the video; (0, 0) is its top-left corner",
        examples=[[368, 58, 158, 374]],
    ),
]
Colour = Annotated[str, Field(pattern="^#[0-9a-fA-F]{6}$", examples=["#3cc850"])]
Name = Annotated[str, Field(min_length=1, max_length=LONGEST, examples=["person"])]


SLOWEST = 0.05
"""Times the video's own speed at which it can be played."""


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid")


class NewSession(_Strict):
    """Where the frames come from."""

    source: Literal["sample", "upload", "camera"] = Field(
        description="a sample clip, a video to be uploaded, or frames to be sent one by one"
    )
    name: str = Field(
        "", max_length=255, description="of the sample, or of the file, for people", examples=[""]
    )


class NewObject(_Strict):
    """An object to follow from the frame shown on."""

    box_xywh: Box
    name: Name | None = Field(None, description="left out, it is 'object 1' and so on")
    colour: Colour | None = None


class ChangedObject(_Strict):
    """What is to be otherwise; a box is a correction in the frame shown."""

    box_xywh: Box | None = None
    name: Name | None = None
    colour: Colour | None = None


class Seek(_Strict):
    """A frame to go to."""

    frame: int = Field(ge=0, description="0-based")
    track: bool = Field(
        True, description="whether frames that have not been tracked are tracked on the way"
    )


class Track(_Strict):
    """How far to track, as fast as possible."""

    until: int | None = Field(None, ge=0, description="last frame; left out, the video's end")


class ObjectState(BaseModel):
    """An object of a session."""

    id: int
    name: str
    colour: str
    first: int = Field(description="the frame it was first drawn in")
    given: list[int] = Field(description="frames in which its box was drawn")
    ends: list[int] = Field(
        description="frames from which on it is not followed, until a box is drawn again"
    )
    tracked: list[tuple[int, int]] = Field(
        description="first and last frames in which its boxes are known, for each drawn box"
    )


class SessionState(BaseModel):
    """How things are; from `width` on, once there is a video."""

    id: str
    source: Literal["sample", "upload", "camera", "select"]
    title: str
    ready: bool = Field(description="whether there is a video")
    playing: bool
    ended: bool = Field(description="whether it has come to the video's end by itself")
    fps: float
    width: int | None = None
    height: int | None = None
    frame_count: int | None = Field(None, description="as far as known")
    position: int | None = Field(None, description="the frame shown, 0-based")
    start: int | None = Field(None, description="the first frame with a box given")
    tracked_until: int | None = Field(
        None, description="the last frame up to which all objects are known"
    )
    untracked: list[str] = Field([], description="what is not tracked to the video's end")
    catching_up: int = Field(0, description="frames still to track again after a change")
    undo: str | None = Field(None, description="what undo takes back")
    redo: str | None = Field(None, description="what redo makes again")
    broken: str | None = Field(None, description="why the video ended early")
    objects: list[ObjectState] = []


class FoundObject(BaseModel):
    """An object in a frame."""

    object: int
    name: str
    box_xywh: Box
    score: float | None = Field(description="expected overlap, 0 to 1; 1 where the box was given")
    status: Literal["tracked", "uncertain", "lost"]


class FoundFrame(BaseModel):
    """What was found in a frame."""

    index: int = Field(description="0-based")
    timestamp: float = Field(description="seconds from the first frame")
    results: list[FoundObject]


class Problem(BaseModel):
    """Why a request was refused."""

    detail: str
    limit: str | None = Field(None, description="the limit that it was over, if it was one")


class SampleClip(BaseModel):
    """A clip to try."""

    name: str
    title: str
    credit: str


class ExportKind(BaseModel):
    """A file that can be downloaded."""

    kind: str
    title: str


class About(BaseModel):
    """What the server is and allows."""

    version: str
    model: str
    limits: dict[str, float]
    samples: list[SampleClip]
    exports: list[ExportKind]
