"""Annotated clips and their readers."""

from re3.data.plain import read_folder, read_track, read_tracks
from re3.data.sequence import Sequence

__all__ = ["Sequence", "read_folder", "read_track", "read_tracks"]
