"""Frames in and out: video files, folders of images, cameras, streams; annotated video, results."""

from re3.video.base import FirstFrameKept, Frame, SourceError, VideoSource
from re3.video.draw import draw_results
from re3.video.results import ResultsWriter, open_results
from re3.video.sources import open_source
from re3.video.writer import VideoWriter

__all__ = [
    "FirstFrameKept",
    "Frame",
    "ResultsWriter",
    "SourceError",
    "VideoSource",
    "VideoWriter",
    "draw_results",
    "open_results",
    "open_source",
]
